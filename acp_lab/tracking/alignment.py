"""Aligning generated edges with one frame: generate, search, assign, step, from coarse to fine.

One level generates the visible edge samples at the present pose (t(I)), searches image edges along their
normals, and takes a few Gauss-Newton steps on the soft assignment between the two. Levels narrow the
search and the capture range sigma (paper IV-B's alpha, annealed).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from acp_lab.cad.part import Part
from acp_lab.control_points.coplanar_points import mid_section_points
from acp_lab.control_points.view_regions import ALL_REGIONS
from acp_lab.generator.base import GeneratedEdges, RigidGenerator, VisibleSamples, image_tangents, project_samples
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose_step import (
    centre_position,
    control_point_jacobian,
    image_directions,
    move_pose,
    step_jacobian,
)
from acp_lab.tracking.gauss_newton import gauss_newton_step
from acp_lab.tracking.learning.contour_offsets import ContourOffsets, ExpectedOffsets
from acp_lab.tracking.learning.edge_memory import EdgeMemory
from acp_lab.tracking.learning.reliability import SampleReliability
from acp_lab.tracking.loss import robust_loss, soft_assignment
from acp_lab.tracking.observer import TargetView, TrackStep
from acp_lab.tracking.stopwatch import Stopwatch
from acp_lab.tracking.targets.image_edges import (
    Candidates,
    ImagePatch,
    SearchConfig,
    image_patch,
    search_along_normals,
)

# Fewer visible samples than this cannot fix six degrees of freedom with any safety.
MIN_SAMPLES = 12


@dataclass(frozen=True)
class Level:
    """One level of the coarse-to-fine search.

    Attributes:
        reach_px: of the search along normals.
        sigma_px: width of the capture range.
        samples: edge samples used at most; a long search is dear, a short one over many samples is exact.
    """

    reach_px: int
    sigma_px: float
    samples: int = 300

    def scaled(self, scale: float) -> Level:
        """The level for a part that appears `scale` times as large; never finer than the image allows."""
        return replace(self, reach_px=max(round(self.reach_px * scale), 5), sigma_px=max(self.sigma_px * scale, 1.0))


TRACKING_LEVELS = (Level(20, 6.0, 250), Level(8, 2.0, 400), Level(5, 1.0, 600))


@dataclass(frozen=True)
class SolverConfig:
    """Settings of the alignment.

    Attributes:
        levels: coarse to fine, for a part that appears at least `full_size_px` wide; shorter for smaller ones.
        steps_per_level: Gauss-Newton steps on one set of candidates.
        outlier: mass of "no image edge belongs here" in the soft assignment.
        damping: per squared px of mean control-point motion.
        min_score: candidates below it are noise.
        trust_from_sigma_px: the trust in each sample counts from this sigma downwards;
            at coarser levels every sample helps to find the way.
        quality_sigma_px: how near a candidate must lie to count as found.
    """

    levels: tuple[Level, ...] = TRACKING_LEVELS
    full_size_px: float = 150.0
    steps_per_level: int = 3
    outlier: float = 0.5
    damping: float = 2e-3
    min_score: float = 0.02
    trust_from_sigma_px: float = 2.0
    quality_sigma_px: float = 1.5


@dataclass(frozen=True)
class Observation:
    """What the image shows around the edges generated at one pose.

    Attributes:
        visible: the generated samples.
        points: (n, 2) px; normals: (n, 2) unit.
        candidates: image edges along the normals.
        scores: (n, m) their scores after the memory had its say.
        targets: (n, m) px along the normal from the generated point to where the candidate says it belongs,
            its expected offset taken off.
        expected: the offsets.
        trust: (n,) weight of each sample, from how well its offset is known and how steadily it was found.
        jacobian: (n, 6) of motion along the normals, control_jacobian: (8, 6) of the control points, by a pose
            step; taken at this pose, they serve for all steps of a level.
        patch: the part of the image that was searched.
    """

    visible: VisibleSamples
    points: np.ndarray
    normals: np.ndarray
    candidates: Candidates
    scores: np.ndarray
    targets: np.ndarray
    expected: ExpectedOffsets
    trust: np.ndarray
    jacobian: np.ndarray
    control_jacobian: np.ndarray
    patch: ImagePatch

    def target(self, min_score: float) -> TargetView:
        """The image edges that were found, those with scores above `min_score`, whatever the memory said of them."""
        rows, columns = np.nonzero(self.candidates.scores > min_score)
        offsets = self.candidates.offsets[rows, columns]
        height, width = self.patch.channels.shape[:2]
        return TargetView(
            self.points[rows] + offsets[:, None] * self.normals[rows], self.patch.origin, (width, height)
        )


@dataclass(frozen=True)
class Alignment:
    """A pose with what the frame says of it.

    Attributes:
        cam_T_obj: (4, 4) mm.
        observation: of the last level.
        distances: (n, m) px from each sample at this pose to its candidates.
        best: (n,) column of the candidate that fits best.
        found: (n,) in [0, 1], its score times its nearness.
        loss: e(I), see `loss.robust_loss`.
        iterations: Gauss-Newton steps taken.
        steps: each of them, when the aligner's `records_steps` is set.
    """

    cam_T_obj: np.ndarray
    observation: Observation
    distances: np.ndarray
    best: np.ndarray
    found: np.ndarray
    loss: float
    iterations: int
    steps: tuple[TrackStep, ...] = ()

    @property
    def quality(self) -> float:
        """In [0, 1]: mean over the samples of `found`; 0 without samples."""
        return float(self.found.mean()) if len(self.found) else 0.0

    def residuals_px(self, min_found: float = 0.02) -> np.ndarray:
        """(n,) px to the best candidate, NaN where none was found."""
        rows = np.arange(len(self.best))
        return np.where(self.found > min_found, self.distances[rows, self.best], np.nan)


class Aligner:
    """Aligns one part; holds what does not change from frame to frame, and the three memories that do."""

    def __init__(
        self,
        part: Part,
        generator: RigidGenerator,
        memory: EdgeMemory,
        offsets: ContourOffsets,
        reliability: SampleReliability,
        search: SearchConfig,
        solver: SolverConfig,
    ) -> None:
        self.part = part
        self.generator = generator
        self.memory = memory
        self.offsets = offsets
        self.reliability = reliability
        self.search = search
        self.solver = solver
        self.records_steps = False
        self.control_points_obj = [mid_section_points(part.box_min, part.box_max, r.axis) for r in ALL_REGIONS]
        low, high = part.box_min, part.box_max
        self._corners = np.array(
            [[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
        )

    def patch(self, image: np.ndarray, camera: Camera, cam_T_obj: np.ndarray, margin_px: float) -> ImagePatch | None:
        """The image around the part at a pose (4, 4); None where the part is behind the camera or off the image."""
        corners = camera.project(self._corners @ cam_T_obj[:3, :3].T + cam_T_obj[:3, 3])
        if not np.isfinite(corners).all():
            return None
        (x0, y0), (x1, y1) = corners.min(0) - margin_px, corners.max(0) + margin_px
        if x1 < 2 or y1 < 2 or x0 > camera.width - 2 or y0 > camera.height - 2:
            return None
        # A part that fills far more than the image is searched inside the image only; keep the numbers small.
        x0, y0, x1, y1 = (float(np.clip(v, -1e4, 1e4)) for v in (x0, y0, x1, y1))
        return image_patch(image, (int(x0), int(y0), int(x1) + 1, int(y1) + 1), self.search.blur_px)

    def observe(
        self,
        patch: ImagePatch,
        camera: Camera,
        cam_T_obj: np.ndarray,
        region: int,
        level: Level,
        clock: Stopwatch,
        use_memory: bool = True,
    ) -> Observation | None:
        """Generate edges at a pose and search for them; None when too few samples are visible."""
        clock.lap()
        edges = self.generator.edges
        visible = self.generator.visible(cam_T_obj, region, level.samples)
        if len(visible.ids) < MIN_SAMPLES:
            return None
        points_cam = edges.points_obj[visible.ids] @ cam_T_obj[:3, :3].T + cam_T_obj[:3, 3]
        tangents = image_tangents(points_cam, edges.tangents_obj[visible.ids] @ cam_T_obj[:3, :3].T, camera)
        normals = np.stack([-tangents[:, 1], tangents[:, 0]], 1)
        points = camera.project(points_cam)
        if not np.isfinite(points).all():
            return None
        clock.generate_s += clock.lap()
        candidates = search_along_normals(patch, points, normals, level.reach_px, self.search)
        scores = candidates.scores
        if use_memory:
            scores = scores * self.memory.factors(visible.ids, candidates)
        scores = np.where(scores > self.solver.min_score, scores, 0.0) * visible.weights[:, None]
        directions = image_directions(points_cam, normals, camera)
        expected = self.offsets.expect(visible.ids, visible.outline, directions @ cam_T_obj[:3, :3])
        targets = candidates.offsets - expected.offsets_px[:, None]
        clock.search_s += clock.lap()
        centre_cam = centre_position(cam_T_obj, self.part.box_centre)
        control_cam = self.control_points_obj[region] @ cam_T_obj[:3, :3].T + cam_T_obj[:3, 3]
        return Observation(
            visible,
            points,
            normals,
            candidates,
            scores,
            targets,
            expected,
            expected.weights * self.reliability.weights(visible.ids, visible.outline),
            step_jacobian(points_cam, directions, centre_cam),
            control_point_jacobian(control_cam, centre_cam, camera),
            patch,
        )

    def align(
        self,
        patch: ImagePatch,
        camera: Camera,
        cam_T_obj: np.ndarray,
        region: int,
        clock: Stopwatch,
        levels: tuple[Level, ...] | None = None,
        use_memory: bool = True,
    ) -> Alignment | None:
        """The pose near `cam_T_obj` whose edges fit the frame; None when the part cannot be seen there."""
        solver, iterations = self.solver, 0
        pose, observation = cam_T_obj, None
        steps: list[TrackStep] = []
        scale = self._level_scale(camera, cam_T_obj)
        for number, level in enumerate(levels or solver.levels):
            level = level.scaled(scale)
            observation = self.observe(patch, camera, pose, region, level, clock, use_memory)
            if observation is None:
                return None
            for _ in range(solver.steps_per_level):
                moved = self._step(observation, camera, pose, level.sigma_px)
                if moved is None:
                    return None
                pose, iterations = moved, iterations + 1
                if self.records_steps:
                    steps.append(self._recorded(observation, camera, pose, region, number))
            clock.solve_s += clock.lap()
        assert observation is not None, "at least one level is needed"
        alignment = replace(self.judge(observation, camera, pose, iterations), steps=tuple(steps))
        clock.solve_s += clock.lap()
        # Not finite where the last step put some samples behind the camera.
        return alignment if np.isfinite(alignment.loss) else None

    def _level_scale(self, camera: Camera, cam_T_obj: np.ndarray) -> float:
        """In [0.5, 1]: on a part that appears small, a long search finds the edges of its other side."""
        depth = centre_position(cam_T_obj, self.part.box_centre)[2]
        apparent_px = 2.0 * self.part.radius * camera.fx / max(depth, 1e-6)
        return float(np.clip(apparent_px / self.solver.full_size_px, 0.5, 1.0))

    def judge(self, observation: Observation, camera: Camera, cam_T_obj: np.ndarray, iterations: int = 0) -> Alignment:
        """How well the candidates of an observation fit a pose (4, 4) near the one it was made at."""
        distances = self._distances(observation, camera, cam_T_obj)
        sigma = self.solver.quality_sigma_px
        fit = observation.scores * np.exp(-0.5 * (distances / sigma) ** 2)
        best = fit.argmax(1)
        loss = robust_loss(distances, observation.scores, sigma, self.solver.outlier)
        return Alignment(cam_T_obj, observation, distances, best, fit[np.arange(len(fit)), best], loss, iterations)

    def control_points(self, camera: Camera, cam_T_obj: np.ndarray, region: int) -> np.ndarray:
        """(4, 2) px: I, the region's W seen at a pose (4, 4)."""
        return camera.project(self.control_points_obj[region] @ cam_T_obj[:3, :3].T + cam_T_obj[:3, 3])

    def generated(self, alignment: Alignment, camera: Camera) -> GeneratedEdges:
        """The edge points of an alignment at its final pose."""
        return project_samples(self.generator.edges, alignment.observation.visible, alignment.cam_T_obj, camera)

    def _recorded(
        self, observation: Observation, camera: Camera, cam_T_obj: np.ndarray, region: int, level: int
    ) -> TrackStep:
        distances = self._distances(observation, camera, cam_T_obj)
        loss = robust_loss(distances, observation.scores, self.solver.quality_sigma_px, self.solver.outlier)
        return TrackStep(self.control_points(camera, cam_T_obj, region), cam_T_obj, loss, level)

    def _distances(self, observation: Observation, camera: Camera, cam_T_obj: np.ndarray) -> np.ndarray:
        """(n, m) px along the normals from the samples at another pose (4, 4) to the candidates."""
        points_obj = self.generator.edges.points_obj[observation.visible.ids]
        shift = camera.project(points_obj @ cam_T_obj[:3, :3].T + cam_T_obj[:3, 3]) - observation.points
        moved: np.ndarray = np.einsum("nj,nj->n", shift, observation.normals)
        return observation.targets - moved[:, None]

    def _step(self, observation: Observation, camera: Camera, pose: np.ndarray, sigma_px: float) -> np.ndarray | None:
        distances = self._distances(observation, camera, pose)
        if not np.isfinite(distances).all():
            return None
        assigned = soft_assignment(distances, observation.scores, sigma_px, self.solver.outlier)
        weights = assigned.weights
        if sigma_px <= self.solver.trust_from_sigma_px:
            weights = weights * observation.trust
        # Half of the control points' Jacobian: the mean over four points, so that damping is per px of one.
        control = 0.5 * observation.control_jacobian
        step = gauss_newton_step(observation.jacobian, assigned.residuals, weights, control, self.solver.damping)
        moved = move_pose(pose, self.part.box_centre, step)
        # The part's centre: the origin of a CAD file may lie anywhere, also behind the camera.
        in_front = centre_position(moved, self.part.box_centre)[2] > 0.0
        return moved if np.isfinite(moved).all() and in_front else None
