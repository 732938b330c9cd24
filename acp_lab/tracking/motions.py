"""What a method varies, and how the edges of one level follow it.

    ControlPointVariables   the eight coordinates of I, as in the paper; edges follow
        HomographyMotion      by the homography that moves the control points (paper III and IV-C),
        NeighbourMotion       as a rigid part where I moves like one, by the homography in the two directions left, or
        RegeneratedMotion     by generating them anew at every I, derivatives through the generator or by differences
    PoseVariables           the six numbers of a pose step; edges follow
        RigidMotion           as a rigid part does: what a 6DoF optimiser does ("w/o CP" in paper Table III)

A motion knows nothing of images or losses. It takes and gives estimates.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar, Literal, Protocol

import numpy as np

from acp_lab.generator.base import GeneratedEdges
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.homography import QuadWarp, WarpedPoints
from acp_lab.geometry.pose import transform
from acp_lab.geometry.pose_step import move_pose
from acp_lab.tracking.frame_view import Estimate, View
from acp_lab.tracking.sources import EdgeSource
from acp_lab.tracking.sources.lift import EdgeLifter
from acp_lab.tracking.sources.residual import ResidualHomography, rigid_neighbour

Rows = Callable[[FloatArray], FloatArray]
"""From image directions (n, 2) to (n, k): how each edge point moves along its direction by the k variables."""
Beside = Callable[[GeneratedEdges, FloatArray], FloatArray]
"""From edge points and image directions (n, 2) to (n, k): how these move by k unknowns beside the variables."""
Lengths = Literal["image", "part"]
"""By which length painted edges count, see `ControlPointVariables`."""


class Motion(Protocol):
    """Edge points of one level as a function of the estimate."""

    def kept(self, generated: GeneratedEdges) -> GeneratedEdges:
        """Those of the level's edges, as generated at its start, that are moved."""
        ...

    def edges(self, at: Estimate) -> GeneratedEdges:
        """The edge points at an estimate; GeometryError where it is degenerate."""
        ...

    def linearised(self, at: Estimate) -> tuple[GeneratedEdges, Rows]:
        """The edge points at an estimate, and how they move from there."""
        ...

    def moved(self, at: Estimate, step: FloatArray) -> Estimate:
        """The estimate after a step (k,)."""
        ...


@dataclass(frozen=True)
class ControlPointVariables:
    """Configuration: the eight coordinates of I are free.

    Attributes:
        direction: how edges follow I within a level: by the "homography" of the control points (the paper has
            it for the direction of a step alone), "rigid" as
            a part in space does, as far as I moves like one, and by the homography beyond that, through the generator
            ("autograd"), or by generating anew beside I ("differences").
        carry: what goes on to the next frame: "points", I itself as in the paper, lets the two directions drift that no
            rigid motion makes; "pose" is the I of the pose that PnP found.
        residual: what becomes of these two directions when edges are generated: "generated", t(I) is asked at I as it
            is (the paper); "homography", it is asked at the rigid neighbour of I, and its edges are moved by the
            homography from there to I (see `sources.residual`).
        lengths: painted edges count by their length in the "image", as in the paper, or on the "part", as the CAD's
            samples do anyway (`EdgeLifter.by_length_on_part`). Of painted ridges only direction = "rigid" knows the CAD
            edges.
    """

    kind: ClassVar[str] = "control-points"
    count: ClassVar[int] = 8
    direction: Literal["homography", "rigid", "autograd", "differences"] = "homography"
    carry: Literal["points", "pose"] = "pose"
    residual: Literal["generated", "homography"] = "generated"
    lengths: Lengths = "image"

    def around(self, source: EdgeSource) -> EdgeSource:
        """The source that generates at any I, made of one that may know rigid I only."""
        return ResidualHomography(source) if self.residual == "homography" else source

    def motion(
        self, source: EdgeSource, edges: GeneratedEdges, at: Estimate, lifter: EdgeLifter, samples: int
    ) -> Motion:
        """The motion of a level's edges, of at most `samples`, generated at an estimate."""
        if self.direction == "homography":
            return HomographyMotion(edges, at.control_points)
        if self.direction == "rigid":
            return NeighbourMotion(edges, at, lifter, self.lengths)
        return RegeneratedMotion(source, samples, self.direction == "differences")

    def scale(self, view: View) -> FloatArray | float:
        """Of each variable per px, for solvers with one rate."""
        return 1.0

    def control_jacobian(self, at: Estimate) -> FloatArray:
        """(8, 8) derivative of I by the variables."""
        return np.eye(8)

    def pose_information(self, matrix: FloatArray, at: Estimate) -> FloatArray:
        """(6 + k, 6 + k) information of a pose step, from that of the variables (8 + k, 8 + k); k unknowns beside."""
        beside = len(matrix) - self.count
        by_pose = np.zeros((len(matrix), 6 + beside))
        by_pose[: self.count, :6] = at.view.control_jacobian(at.cam_T_obj)
        by_pose[self.count :, 6:] = np.eye(beside)
        return by_pose.T @ matrix @ by_pose

    def pose_jacobian(self, at: Estimate) -> FloatArray:
        """(6, 8) derivative of a pose step (rad, mm) by the variables: of the rigid motion next to that of I."""
        return np.asarray(np.linalg.pinv(at.view.control_jacobian(at.cam_T_obj)), np.float64)


@dataclass(frozen=True)
class PoseVariables:
    """Configuration: a pose is varied, in steps of rotation and shift about the part's centre ("w/o CP").

    Attributes:
        linearise: at every "step", or once per "level", at its start.
        lengths: painted edges count by their length in the "image" or on the "part", as there.
    """

    kind: ClassVar[str] = "pose"
    count: ClassVar[int] = 6
    linearise: Literal["step", "level"] = "step"
    lengths: Lengths = "image"

    def around(self, source: EdgeSource) -> EdgeSource:
        """The source as it is: a pose is rigid."""
        return source

    def motion(
        self, source: EdgeSource, edges: GeneratedEdges, at: Estimate, lifter: EdgeLifter, samples: int
    ) -> Motion:
        """The motion of a level's edges, of at most `samples`, generated at an estimate."""
        counted, points_obj = _on_part(edges, at, lifter, self.lengths)
        return RigidMotion(counted, points_obj, at, self.linearise == "level", source.is_exact)

    def scale(self, view: View) -> FloatArray | float:
        """(6,) how much of each pose parameter moves the part's rim by about a pixel, for solvers with one rate."""
        depth = float(transform(view.prior, view.part.box_centre)[2])
        shift = depth / view.camera.fx
        turn = shift / (0.5 * view.part.diameter)
        return np.array([turn, turn, turn, shift, shift, shift])

    def control_jacobian(self, at: Estimate) -> FloatArray:
        """(8, 6) derivative of I by the variables."""
        return at.view.control_jacobian(at.cam_T_obj)

    def pose_information(self, matrix: FloatArray, at: Estimate) -> FloatArray:
        """(6 + k, 6 + k) information of a pose step and of k unknowns beside it: that of the variables."""
        return matrix

    def pose_jacobian(self, at: Estimate) -> FloatArray:
        """(6, 6) derivative of a pose step (rad, mm) by the variables, which are just that."""
        return np.eye(6)


class _ControlPointMotion:
    """Variables I: a step is added."""

    def kept(self, generated: GeneratedEdges) -> GeneratedEdges:
        """All."""
        return generated

    def moved(self, at: Estimate, step: FloatArray) -> Estimate:
        """I after a step (8,) px."""
        return at.view.at_points(at.control_points + step.reshape(4, 2))


class HomographyMotion(_ControlPointMotion):
    """x' = H x with H from the four control points (paper eq. 8), analytic in all eight coordinates."""

    def __init__(self, edges: GeneratedEdges, control_points: FloatArray) -> None:
        self._edges = edges
        self._warp = QuadWarp(control_points, edges.points)

    def edges(self, at: Estimate) -> GeneratedEdges:
        """The edges moved by the homography."""
        return self._moved(self._warp.to(at.control_points))

    def linearised(self, at: Estimate) -> tuple[GeneratedEdges, Rows]:
        """The same, and rows of eight columns."""
        warped = self._warp.to(at.control_points)
        return self._moved(warped), lambda directions: np.einsum("nj,njk->nk", directions, warped.jacobian())

    def _moved(self, warped: WarpedPoints) -> GeneratedEdges:
        return _warped(self._edges, warped)


class NeighbourMotion(_ControlPointMotion):
    """Edge points follow the rigid neighbour of I in space, and go on from there to I by the residual homography.

    A homography moves all edges as if they lay on the plane of W. Those that lie off it go elsewhere when the part
    tilts: the paper's direction cannot tell a tilt from what it is (`acp_lab.studies.sensitivity`). Six of the eight
    directions of I are rigid motions, and along them edges move as the CAD model says. This is how edges depend on I
    where they are generated with a residual homography (`sources.residual`), derivative included. Edges without a CAD
    edge near them are left out. GeometryError where I, or its neighbour, is degenerate.
    """

    def __init__(self, edges: GeneratedEdges, start: Estimate, lifter: EdgeLifter, lengths: Lengths = "image") -> None:
        neighbour = rigid_neighbour(start)
        rigid = _warped(edges, QuadWarp(start.control_points, edges.points).to(neighbour.control_points))
        self._rigid = RigidMotion(*_on_part(rigid, neighbour, lifter, lengths), neighbour)
        self._start = start

    def kept(self, generated: GeneratedEdges) -> GeneratedEdges:
        """Those whose 3D points are known."""
        return self.edges(self._start)

    def moved(self, at: Estimate, step: FloatArray) -> Estimate:
        """I after a step (8,) px; its pose goes on from that of I before."""
        return at.view.at_points(at.control_points + step.reshape(4, 2), near=at.cam_T_obj)

    def edges(self, at: Estimate) -> GeneratedEdges:
        """The edges of the pose next to I, moved to I."""
        return _warped(*self._at(rigid_neighbour(at), at))

    def linearised(self, at: Estimate) -> tuple[GeneratedEdges, Rows]:
        """The same, and rows of eight columns, to first order in what of I is not rigid."""
        neighbour = rigid_neighbour(at)
        edges, warped = self._at(neighbour, at)
        by_pose = at.view.control_jacobian(neighbour.cam_T_obj)
        pose_by = np.linalg.pinv(by_pose)
        beside = np.eye(8) - by_pose @ pose_by

        def rows_along(directions: FloatArray) -> FloatArray:
            rigid: FloatArray = self._rigid.rows(neighbour, directions) @ pose_by
            return rigid + warped.rows_along(directions) @ beside

        return _warped(edges, warped), rows_along

    def _at(self, neighbour: Estimate, at: Estimate) -> tuple[GeneratedEdges, WarpedPoints]:
        edges = self._rigid.edges(neighbour)
        return edges, QuadWarp(neighbour.control_points, edges.points).to(at.control_points)


class RegeneratedMotion(_ControlPointMotion):
    """t(I) itself, generated at every I."""

    def __init__(self, source: EdgeSource, count: int, by_differences: bool) -> None:
        self._source = source
        self._count = count
        self._by_differences = by_differences

    def edges(self, at: Estimate) -> GeneratedEdges:
        """t(I)."""
        return self._source.generate(at, self._count)

    def linearised(self, at: Estimate) -> tuple[GeneratedEdges, Rows]:
        """The same, and rows of eight columns."""
        edges = self.edges(at)
        flow = self._source.flow(at, edges, self._by_differences)
        return edges, lambda directions: np.einsum("nj,njk->nk", directions, flow)


class RigidMotion:
    """Edge points with their 3D points (n, 3) mm, NaN for those to leave out, moved by a pose.

    per_level: keep the rows of the level's start. is_exact: the edge points lie where their 3D points project to.

    Attributes:
        points_obj: (n, 3) mm.
    """

    def __init__(
        self,
        edges: GeneratedEdges,
        points_obj: FloatArray,
        start: Estimate,
        per_level: bool = False,
        is_exact: bool = False,
    ) -> None:
        if not np.isfinite(points_obj.sum()):
            known = np.asarray(np.isfinite(points_obj).all(1))
            edges, points_obj = edges.take(known), points_obj[known]
        self._edges = edges
        self.points_obj = points_obj
        self._view = start.view
        self._start = start
        self._per_level = per_level
        self._is_exact = is_exact
        # Lifting puts points on the nearest CAD edge; what it moved them by stays with them as a constant.
        self._lift_px = 0.0 if is_exact else edges.points - self._project(start.cam_T_obj)

    @property
    def keeps_rows(self) -> bool:
        """Whether the rows of the level's start are kept, and its points are where their 3D points project to."""
        return self._per_level and self._is_exact

    def kept(self, generated: GeneratedEdges) -> GeneratedEdges:
        """Those whose 3D points are known."""
        return self._edges

    def edges(self, at: Estimate) -> GeneratedEdges:
        """The edges at a pose; directions are kept, a level turns them little."""
        start = self._edges
        if at is self._start:
            return start
        points = self._project(at.cam_T_obj) + self._lift_px
        return GeneratedEdges(points, start.tangents, start.weights, start.sample_ids, start.outline)

    def linearised(self, at: Estimate) -> tuple[GeneratedEdges, Rows]:
        """The same, and rows of six columns: rotation (rad) and shift (mm), camera axes."""
        return self.edges(at), lambda directions: self.rows(at, directions)

    def rows(self, at: Estimate, directions: FloatArray) -> FloatArray:
        """(n, 6) derivative of the motion along image directions (n, 2) by a pose step."""
        # The directions of a level are one array that is asked for in every step, and its lines are kept.
        return (self._start if self._per_level else at).lines(self.points_obj, directions).jacobian

    def moved(self, at: Estimate, step: FloatArray) -> Estimate:
        """The pose after a step (6,)."""
        return at.view.at_pose(move_pose(at.cam_T_obj, self._view.part.box_centre, step))

    def _project(self, cam_T_obj: FloatArray) -> FloatArray:
        return self._view.camera.project(transform(cam_T_obj, self.points_obj))


def _on_part(
    edges: GeneratedEdges, at: Estimate, lifter: EdgeLifter, lengths: Lengths
) -> tuple[GeneratedEdges, FloatArray]:
    """The edges as they count, and their 3D points (n, 3) mm, NaN where unknown."""
    if lengths == "image":
        return edges, lifter.lift(edges, at)
    samples = lifter.samples(edges, at)
    return lifter.by_length_on_part(edges, samples, at), lifter.points_obj(samples)


def _warped(edges: GeneratedEdges, by: WarpedPoints) -> GeneratedEdges:
    return replace(edges, points=by.points, tangents=by.tangents(edges.tangents))
