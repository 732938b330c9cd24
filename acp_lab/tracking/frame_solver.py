"""One frame of the paper's path: from the I that it starts with to the I that fits (paper IV-B, eqs 5 to 7).

Per level of the annealed alpha: edges are generated at the present variables, taken to move as the configuration
says, and a few steps of the solver go down e. The variables are the eight coordinates of I, or a pose for the
ablation "w/o CP".
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acp_lab.errors import GeometryError
from acp_lab.generator.base import GeneratedEdges
from acp_lab.geometry.pose_step import centre_position
from acp_lab.tracking.frame_view import EdgeSource, View
from acp_lab.tracking.learning.edge_memory import EdgeMemory
from acp_lab.tracking.measure import DistanceMeasure, SearchMeasure
from acp_lab.tracking.method import MethodConfig
from acp_lab.tracking.motions import HomographyMotion, Motion, RegeneratedMotion, RigidMotion
from acp_lab.tracking.observer import TrackStep
from acp_lab.tracking.solvers import Iterate, Measure, minimise
from acp_lab.tracking.sources.lift import EdgeLifter
from acp_lab.tracking.stopwatch import Stopwatch
from acp_lab.tracking.targets.distance_map import DistanceTarget
from acp_lab.tracking.targets.image_edges import ImagePatch, SearchConfig

# Fewer edge points than this cannot fix eight numbers with any safety.
MIN_EDGES = 20
# No annealing goes below this: the edges of a distance map lie on whole pixels.
_LEAST_ALPHA_PX = 1.5


@dataclass(frozen=True)
class SolvedFrame:
    """What one frame gave.

    Attributes:
        control_points: (4, 2) px; cam_T_obj: (4, 4) of them.
        edges: those of the last level, where the pose has them; painted anew, at I, where they are ridges.
        loss: e(I) on the last level; iterations: of the solver, on all levels; steps: each of them, when recorded.
    """

    control_points: np.ndarray
    cam_T_obj: np.ndarray
    edges: GeneratedEdges
    loss: float
    iterations: int
    steps: tuple[TrackStep, ...]


@dataclass(frozen=True)
class RigidWish:
    """The wish that I stays a projection of W: its part in the two directions that no rigid motion makes.

    rigid: (8,) I of the pose of the level's start; jacobian: (2, 8) unit rows across all rigid motions there.
    """

    weight: float
    rigid: np.ndarray
    jacobian: np.ndarray

    def residual(self, variables: np.ndarray) -> np.ndarray:
        """(2,) px still to go."""
        wish: np.ndarray = self.jacobian @ (self.rigid - variables.reshape(8))
        return wish

    @classmethod
    def at(cls, view: View, control_points: np.ndarray, weight: float) -> RigidWish:
        """The wish around I (4, 2); GeometryError where I is degenerate."""
        pose = view.pose(control_points)
        basis, _ = np.linalg.qr(view.control_jacobian(pose), mode="complete")
        return cls(weight, view.project(pose).reshape(8), basis[:, 6:].T)


@dataclass(frozen=True)
class FrameView:
    """What a frame offers to be compared with; `target` for the distance map, `patch` for the search along normals."""

    target: DistanceTarget | None
    patch: ImagePatch | None


class FrameSolver:
    """Solves frames of one part by one method."""

    def __init__(self, config: MethodConfig, source: EdgeSource, lifter: EdgeLifter | None, diameter: float) -> None:
        self.config = config
        self.memory: EdgeMemory | None = None
        self.trust: np.ndarray | None = None
        self._source = source
        self._lifter = lifter
        self._diameter = diameter

    def solve(
        self, seen: FrameView, view: View, control_points: np.ndarray, clock: Stopwatch, records_steps: bool
    ) -> SolvedFrame | None:
        """argmin e from I (4, 2) px; None where too few edges are generated or I degenerates."""
        is_pose = self.config.variables == "pose"
        alpha_px = self.alpha_px(view)
        iterations, loss, steps = 0, float("nan"), []
        try:
            variables = view.pose(control_points) if is_pose else control_points
            for level, share in enumerate(self.config.loss.schedule):
                clock.lap()
                points = view.project(variables) if is_pose else variables
                edges = self._source.generate(view, points)
                if len(edges) < MIN_EDGES:
                    return None
                clock.generate_s += clock.lap()
                motion = self._motion(view, edges, variables)
                prior = None
                if self.config.rigid_prior > 0.0 and not is_pose:
                    prior = RigidWish.at(view, variables, self.config.rigid_prior)
                measure = self.measure(seen, max(share * alpha_px, _LEAST_ALPHA_PX))
                iterates = minimise(motion, measure, variables, self.config.solver, prior, self._scale(view, is_pose))
                variables, loss = iterates[-1].variables, iterates[-1].loss
                iterations += len(iterates)
                if records_steps:
                    steps += [self._step(view, iterate, level) for iterate in iterates]
                clock.solve_s += clock.lap()
            pose = variables if is_pose else view.pose(variables)
            points = view.project(pose) if is_pose else variables
            clock.solve_s += clock.lap()
            edges = self._source.settled(view, points, pose, edges)
            clock.generate_s += clock.lap()
        except GeometryError:
            return None
        if not (np.isfinite(pose).all() and np.isfinite(points).all()):
            return None
        return SolvedFrame(points, pose, edges, loss, iterations, tuple(steps))

    def alpha_px(self, view: View) -> float:
        """Alpha in px: its share of the part's diameter as projected at the prior pose."""
        depth = centre_position(view.prior, view.centre_obj)[2]
        return self.config.loss.alpha * self._diameter * view.camera.fx / max(float(depth), 1e-6)

    def measure(self, seen: FrameView, alpha_px: float) -> Measure:
        """How edge points are compared with the frame, with alpha at alpha_px."""
        if seen.target is not None:
            return DistanceMeasure(seen.target, self.config.loss.form, alpha_px)
        assert seen.patch is not None, "a frame offers a distance map or a patch to search in"
        return SearchMeasure(seen.patch, alpha_px, SearchConfig(), self.memory, self.trust)

    def _motion(self, view: View, edges: GeneratedEdges, variables: np.ndarray) -> Motion:
        if self.config.variables == "pose":
            assert self._lifter is not None, "a pose moves edges by their 3D points"
            return RigidMotion(edges, self._lifter.lift(edges, variables, view.camera), view, variables)
        if self.config.direction == "homography":
            return HomographyMotion(edges, variables)
        return RegeneratedMotion(self._source, view, self.config.direction == "regeneration")

    def _scale(self, view: View, is_pose: bool) -> np.ndarray | None:
        """(6,) how much of each pose parameter moves the part's rim by about a pixel, for Adam's one rate."""
        if not is_pose:
            return None
        mm_per_px = float(centre_position(view.prior, view.centre_obj)[2]) / view.camera.fx
        return np.repeat([mm_per_px / (0.5 * self._diameter), mm_per_px], 3)

    def _step(self, view: View, iterate: Iterate, level: int) -> TrackStep:
        if self.config.variables == "pose":
            return TrackStep(view.project(iterate.variables), iterate.variables, iterate.loss, level)
        try:
            pose = view.pose(iterate.variables)
        except GeometryError:
            pose = np.full((4, 4), np.nan)
        return TrackStep(iterate.variables, pose, iterate.loss, level)
