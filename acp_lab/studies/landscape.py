"""The values of e(I) around a pose, over any two control coordinates or any two pose parameters.

Edges are generated once, at the pose in the middle, and moved as the paper's tracker moves them: by the homography of
the control points for the eight coordinates, as a rigid part for the six of a pose. The distances of a slice are looked
up once; the loss of another form or another alpha then takes milliseconds.

Convention: a slice runs over offsets from the middle, `reach` each way, in px, degrees or mm; grids are (v, u), row 0
at the smallest v.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.control_points.view_regions import choose_region
from acp_lab.errors import GeometryError, TrackingError
from acp_lab.generator.base import GeneratedEdges, project_samples
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import check_pose, so3_log, transform
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame, check_frame
from acp_lab.studies.manipulation import view_of
from acp_lab.tracking.frame_view import Estimate
from acp_lab.tracking.losses import LossForm, edge_loss, reference_bce
from acp_lab.tracking.motions import HomographyMotion, Motion, RigidMotion
from acp_lab.tracking.solvers import Problem, Solver, WeightedMeasure, minimise
from acp_lab.tracking.targets.distance_map import DistanceMeasure, DistanceTarget, EdgeMapConfig, distance_target

Space = Literal["control-points", "pose"]
IMAGE_SIDE = 128
"""px: edge images that are compared as images, as the authors' code does, are no larger."""


@dataclass(frozen=True)
class Coordinate:
    """One variable of e. index: of the step vector; unit_step: what one unit is there (rad for a degree)."""

    name: str
    unit: str
    index: int
    unit_step: float = 1.0


CONTROL_COORDINATES = tuple(Coordinate(f"{'xy'[k % 2]} of point {k // 2 + 1}", "px", k) for k in range(8))
POSE_COORDINATES = (
    *(Coordinate(f"turn about {axis}", "°", k, float(np.pi / 180.0)) for k, axis in enumerate("xyz")),
    *(Coordinate(f"shift along {axis}", "mm", 3 + k) for k, axis in enumerate("xyz")),
)


@dataclass(frozen=True, eq=False)
class LossSlice:
    """Distances over a grid of offsets.

    u, v: the coordinates; offsets: (g,) along both; distances: (g, g, n) px of n edge points, NaN where no homography
    exists; shares: (n,) how much each point counts.
    """

    u: Coordinate
    v: Coordinate
    offsets_u: FloatArray
    offsets_v: FloatArray
    distances: np.ndarray
    shares: FloatArray

    def values(self, form: LossForm, alpha_px: float) -> FloatArray:
        """e over the grid, (g, g): the mean over the edge points, as the solvers take it."""
        flat = self.distances.reshape(-1, self.distances.shape[2]).astype(np.float64)
        losses = edge_loss(form, flat, alpha_px).values @ self.shares / self.shares.sum()
        grid: FloatArray = losses.reshape(self.distances.shape[:2])
        return grid


@dataclass(frozen=True, eq=False)
class Descent:
    """The optimiser's path: offsets (k, 8) px or (k, 6) rad and mm from the middle, first the start; loss: (k,), the
    first one NaN."""

    offsets: FloatArray
    loss: FloatArray


class LossSurface:
    """e around one pose of one frame.

    control_points: (4, 2) px, I of the pose in the middle; edges: generated there; alpha_px: where the loss turns from
    near to far, in px of the frame.
    """

    def __init__(
        self,
        model: PreparedPart,
        frame: Frame,
        cam_T_obj: FloatArray,
        target: EdgeMapConfig | None = None,
        edges: int = 400,
        alpha: float = 0.07,
    ) -> None:
        """cam_T_obj: (4, 4), the middle; edges: how many edge points are used at most; alpha: the loss's alpha as a
        share of the part's projected diameter, by default the middle of the range that the paper gives.

        Raises GeometryError for an eye inside the part, TrackingError when fewer than 20 of its edge points are in the
        image and for an alpha that is no such share.
        """
        check_frame(frame)
        cam_T_obj = check_pose(cam_T_obj, f"{model.part.name}: the middle pose")
        if not 0.0 < alpha <= 1.0:
            raise TrackingError(f"landscape: alpha is {alpha:g}: give a share of the diameter above 0, such as 0.07")
        part, camera = model.part, frame.camera
        self._middle = np.array(cam_T_obj, np.float64)
        region = choose_region(eye_position(self._middle) - part.box_centre, 0.5 * part.box_size)
        self._view = view_of(model, camera, self._middle, region)
        centre = self._view.at_pose(self._middle)
        self.control_points = centre.control_points
        generator = model.best_generator()
        visible = generator.visible(self._middle, region, edges)
        self.edges = project_samples(generator.edges, visible, self._middle, camera)
        inside = (self.edges.points > 0.0).all(1) & (self.edges.points < (camera.width - 1, camera.height - 1)).all(1)
        if inside.sum() < 20:
            raise TrackingError(f"{part.name}: at this pose fewer than 20 edge points are in frame {frame.index}")
        depth = transform(self._middle, part.box_centre)[2]
        self.alpha_px = alpha * part.diameter * camera.fx / float(depth)
        self.target = distance_target(frame.image, _box_around(self.edges.points), target or EdgeMapConfig())
        self._motions: dict[Space, Motion] = {
            "control-points": HomographyMotion(self.edges, self.control_points),
            "pose": RigidMotion(self.edges, generator.edges.points_obj[visible.ids], centre),
        }

    @staticmethod
    def coordinates(space: Space) -> tuple[Coordinate, ...]:
        """The coordinates that a slice can vary."""
        return CONTROL_COORDINATES if space == "control-points" else POSE_COORDINATES

    def edges_at(self, space: Space, offsets: FloatArray) -> GeneratedEdges:
        """The edges moved by offsets (8,) px or (6,) rad and mm; GeometryError where I degenerates."""
        motion = self._motions[space]
        return motion.edges(motion.moved(self._start(space), offsets))

    def slice(
        self, space: Space, u: Coordinate, v: Coordinate, reach: tuple[float, float], count: int = 33
    ) -> LossSlice:
        """Distances over `count` x `count` offsets of u and v, each `reach` (in the coordinate's unit) both ways."""
        offsets_u, offsets_v = (np.linspace(-r, r, count) for r in reach)

        def distances(edges: GeneratedEdges) -> np.ndarray:
            return self.target.distances(edges.points, edges.normals).values.astype(np.float32)

        grid = self._over_grid(space, u, v, offsets_u, offsets_v, distances, len(self.edges))
        return LossSlice(u, v, offsets_u, offsets_v, grid, self.edges.weights)

    def image_values(
        self, space: Space, u: Coordinate, v: Coordinate, reach: tuple[float, float], count: int = 33
    ) -> FloatArray:
        """The loss of the authors' public code over the same grid, (count, count): binary cross entropy of the edge
        image against the frame's, mean over the pixels of a crop of at most 128 px."""
        drawing = _EdgeDrawing(self.target)
        offsets_u, offsets_v = (np.linspace(-r, r, count) for r in reach)
        grid = self._over_grid(space, u, v, offsets_u, offsets_v, drawing.entropy, 1)
        return np.asarray(grid[:, :, 0], dtype=np.float64)

    def descend(
        self, space: Space, offsets: FloatArray, form: LossForm, alphas_px: tuple[float, ...], solver: Solver
    ) -> Descent:
        """The solver's path from offsets (8,) or (6,), one level per alpha, all variables free.

        It ends early where a step leads to a degenerate I. The printed form may diverge.
        """
        motion = self._motions[space]
        at = motion.moved(self._start(space), offsets)
        way, losses = [np.asarray(offsets, np.float64)], [float("nan")]
        for alpha_px in alphas_px:
            problem = Problem(motion, [WeightedMeasure(DistanceMeasure(self.target, form, alpha_px))])
            try:
                iterates = minimise(problem, at, solver)
            except GeometryError:
                break
            steps = [self._offsets(space, iterate) for iterate in iterates]
            if not (steps and np.isfinite(steps).all()):
                break
            way += steps
            losses += [problem.loss(iterate) for iterate in iterates]
            at = iterates[-1]
        return Descent(np.array(way), np.array(losses))

    def _over_grid(
        self,
        space: Space,
        u: Coordinate,
        v: Coordinate,
        offsets_u: FloatArray,
        offsets_v: FloatArray,
        measure: Callable[[GeneratedEdges], np.ndarray],
        width: int,
    ) -> np.ndarray:
        grid = np.full((len(offsets_v), len(offsets_u), width), np.nan, np.float32)
        step = np.zeros(len(self.coordinates(space)))
        for row, along_v in enumerate(offsets_v):
            for column, along_u in enumerate(offsets_u):
                step[v.index], step[u.index] = along_v * v.unit_step, along_u * u.unit_step
                try:
                    grid[row, column] = measure(self.edges_at(space, step))
                except GeometryError:
                    continue
        return grid

    def _start(self, space: Space) -> Estimate:
        points, pose = self.control_points, self._middle
        return self._view.at_points(points) if space == "control-points" else self._view.at_pose(pose)

    def _offsets(self, space: Space, at: Estimate) -> FloatArray:
        """The inverse of a motion's `moved`, from the middle."""
        if space == "control-points":
            return (at.control_points - self.control_points).reshape(8)
        turn = so3_log(at.cam_T_obj[:3, :3] @ self._middle[:3, :3].T)
        now, before = (transform(pose, self._view.part.box_centre) for pose in (at.cam_T_obj, self._middle))
        return np.concatenate([turn, now - before])


class _EdgeDrawing:
    """Generated and captured edges as small images of the target's crop."""

    def __init__(self, target: DistanceTarget) -> None:
        height, width = target.edges.shape
        self._scale = min(IMAGE_SIDE / max(height, width), 1.0)
        self._size = max(round(width * self._scale), 1), max(round(height * self._scale), 1)
        self._origin = np.array(target.origin, np.float64)
        small = cv2.resize(target.edges.astype(np.float32), self._size, interpolation=cv2.INTER_AREA)
        # A pixel of the small image is an edge when an edge of a pixel's width runs through it.
        self._captured = (small > 0.5 * self._scale).astype(np.float64)

    def entropy(self, edges: GeneratedEdges) -> np.ndarray:
        """(1,) mean binary cross entropy."""
        points = (edges.points - self._origin + 0.5) * self._scale - 0.5
        small = GeneratedEdges(points, edges.tangents, edges.weights, edges.sample_ids)
        drawn = small.image(*self._size).astype(np.float32) / 255.0
        # A decoder's edges are soft; hard ones would make the entropy of every miss that of log 1e-6.
        belief = np.clip(1.8 * cv2.GaussianBlur(drawn, (0, 0), 0.8), 0.02, 0.98)
        return np.array([reference_bce(belief, self._captured).values.mean()])


def _box_around(points: FloatArray, margin_px: float = 40.0) -> tuple[int, int, int, int]:
    (x0, y0), (x1, y1) = points.min(0) - margin_px, points.max(0) + margin_px
    return int(x0), int(y0), int(x1) + 1, int(y1) + 1
