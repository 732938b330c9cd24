"""The frame loop of a configured method: `--method acp-paper`, its ablations, and any other `MethodConfig`.

The same protocol as `acp_lab.Tracker`: start with a pose, then follow. What goes from frame to frame is the paper's I.
"""

from __future__ import annotations

import time
from collections.abc import Iterable

import numpy as np

from acp_lab.cad.part import Part
from acp_lab.control_points.canonical_frame import CANONICAL_SIZE, canonical_frame, eye_position
from acp_lab.control_points.view_regions import ALL_REGIONS, REGION_COUNT, choose_region
from acp_lab.errors import GeometryError, PreparationError, TrackingError
from acp_lab.generator.base import GeneratedEdges, RigidGenerator
from acp_lab.generator.painted.edge_points import ridge, threshold
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import rotation_angle_deg
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.sequences.protocol import Sequence
from acp_lab.tracking.frame_solver import MIN_EDGES, FrameSolver, FrameView, SolvedFrame
from acp_lab.tracking.frame_view import EdgeSource, View
from acp_lab.tracking.learning.contour_offsets import ContourOffsets, OffsetConfig
from acp_lab.tracking.learning.edge_memory import EdgeMemory, MemoryConfig
from acp_lab.tracking.learning.reliability import ReliabilityConfig, SampleReliability
from acp_lab.tracking.measure import SearchMeasure
from acp_lab.tracking.method import MethodConfig
from acp_lab.tracking.observer import Observer, TargetView, TrackResult
from acp_lab.tracking.prediction import ConstantVelocity
from acp_lab.tracking.session import TrackRun, track_sequence
from acp_lab.tracking.sources.lift import EdgeLifter
from acp_lab.tracking.sources.painted import RidgeSource, SampleSource
from acp_lab.tracking.sources.rigid import RigidEdgeSource
from acp_lab.tracking.states import StateConfig, StateMachine
from acp_lab.tracking.stopwatch import Stopwatch
from acp_lab.tracking.targets.distance_map import distance_target
from acp_lab.tracking.targets.image_edges import image_patch

_MARGIN_PX = 40.0
_LARGEST_TURN_DEG = 45.0
_QUALITY_SIGMA_PX = 1.5


class MethodTracker:
    """Tracks one prepared part by a configured method."""

    def __init__(self, model: PreparedPart, config: MethodConfig | None = None) -> None:
        """PreparationError when the part lacks the generator that the method needs."""
        self.model = model
        self.config = config or MethodConfig()
        self.part: Part = model.part
        self.records_steps = False
        self.records_target = False
        self._regions, self._canonical_size = tuple(range(REGION_COUNT)), CANONICAL_SIZE
        source = self._edge_source()
        lifter = EdgeLifter(self.part, model.edges) if self.config.variables == "pose" else None
        self._solver = FrameSolver(self.config, source, lifter, self.part.diameter)
        self._half_size = 0.5 * self.part.box_size
        low, high = self.part.box_min, self.part.box_max
        self._corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, 8).T
        self._motion = ConstantVelocity(self.part.box_centre)
        self._points: np.ndarray | None = None
        self._started = False

    @property
    def generator_name(self) -> str:
        """Which t(I) is in use."""
        return self.config.generator

    def start(self, frame: Frame, cam_T_obj: np.ndarray) -> TrackResult:
        """Begin at a pose (4, 4) in the first frame.

        Raises:
            TrackingError: the part at that pose is behind the camera, outside the image or shows too few edges.
        """
        begin, clock = time.perf_counter(), Stopwatch()
        pose = np.array(cam_T_obj, np.float64)
        self._forget()
        self._region = self._choose_region(pose, None)
        solved, seen = self._solve(frame, pose, None, clock)
        if solved is None or seen is None:
            raise TrackingError(
                f"{self.part.name}: at the start pose t = {np.round(pose[:3, 3], 1).tolist()} mm the part is not seen "
                f"in frame {frame.index} ({frame.camera.width}x{frame.camera.height}); check pose, unit and camera"
            )
        self._motion.restart(solved.cam_T_obj)
        self._points = solved.control_points
        self._started = True
        return self._result(frame, solved, seen, clock, begin, is_first=True)

    def track(self, frame: Frame | UnreadableFrame) -> TrackResult:
        """The pose in the next frame; an unreadable frame gets the predicted pose and quality 0.

        Raises:
            TrackingError: `start` was not called.
        """
        if not self._started:
            raise TrackingError(f"{self.part.name}: track was called before start; give the first frame to start")
        begin, clock = time.perf_counter(), Stopwatch()
        moves_on = self.config.prediction == "constant-velocity"
        predicted = self._motion.predict() if moves_on else self._motion.last
        if isinstance(frame, UnreadableFrame):
            self._motion.observe(predicted)
            return self._blind(frame, predicted, clock, begin, frame.reason)
        before, self._region = self._region, self._choose_region(predicted, self._region)
        # Another region has another W, so I begins anew as the projection of the pose.
        carried = self._carried(frame.camera, predicted) if before == self._region else None
        solved, seen = self._solve(frame, predicted, carried, clock)
        if solved is None or seen is None or not self._is_plausible(solved.cam_T_obj):
            note = self._states.update(0.0) or "no pose was found"
            self._motion.restart(self._motion.last)
            self._points = None
            return self._blind(frame, self._motion.last, clock, begin, note)
        self._motion.observe(solved.cam_T_obj)
        self._points = solved.control_points
        return self._result(frame, solved, seen, clock, begin, is_first=False)

    def run(self, sequence: Sequence, start: np.ndarray, observers: Iterable[Observer] = ()) -> TrackRun:
        """Track a sequence of one object from a start pose (4, 4) in its first frame."""
        object_id = sequence.object_ids[0] if sequence.object_ids else 1
        return track_sequence({object_id: self}, sequence, {object_id: start}, observers, method=self.config.name)

    def _edge_source(self) -> EdgeSource:
        config, model = self.config, self.model
        offsets = ContourOffsets(model.edges, self.part.diameter, model.edge_break_mm, OffsetConfig())
        if config.generator != "autoencoder":
            return RigidEdgeSource(_rigid_generator(model, config.generator), offsets, config.edges)
        generator = model.autoencoder()
        self._regions, self._canonical_size = generator.regions, generator.size
        if config.edge_points == "samples":
            return SampleSource(generator, config.control_points, offsets, config.edge_level, config.edges)
        read = ridge if config.edge_points == "ridge" else threshold
        return RidgeSource(generator, config.control_points, read, config.edge_level, config.edges)

    def _forget(self) -> None:
        self._states = StateMachine(StateConfig())
        self._points = None
        self._reliability: SampleReliability | None = None
        self._started = False
        if self.config.learned_weights:
            self._solver.memory = EdgeMemory(len(self.model.edges), MemoryConfig())
            self._solver.trust = None
            self._reliability = SampleReliability(len(self.model.edges), ReliabilityConfig())

    def _choose_region(self, cam_T_obj: np.ndarray, current: int | None) -> int:
        return choose_region(
            eye_position(cam_T_obj) - self.part.box_centre, self._half_size, current, among=self._regions
        )

    def _carried(self, camera: Camera, predicted: np.ndarray) -> np.ndarray | None:
        """(4, 2) px I to start from, None for the projection of the predicted pose."""
        if self._points is None or self.config.carry == "pose" or self.config.variables == "pose":
            return None
        w = self.model.control_points(self._region, self.config.control_points)
        ahead, behind = (camera.project(w @ pose[:3, :3].T + pose[:3, 3]) for pose in (predicted, self._motion.last))
        return self._points + ahead - behind

    def _solve(
        self, frame: Frame, prior: np.ndarray, carried: np.ndarray | None, clock: Stopwatch
    ) -> tuple[SolvedFrame | None, FrameView | None]:
        clock.lap()
        seen = self._look(frame, prior)
        clock.image_s += clock.lap()
        if seen is None:
            return None, None
        region = ALL_REGIONS[self._region]
        try:
            canonical = canonical_frame(
                eye_position(prior), self.part.box_centre, self.part.radius, region, self._canonical_size
            )
        except GeometryError:
            return None, seen
        view = View(
            frame.camera,
            prior,
            self._region,
            self.model.control_points(self._region, self.config.control_points),
            self.part.box_centre,
            canonical,
            canonical.homography_to(frame.camera, prior),
        )
        start = view.prior_points if carried is None else carried
        return self._solver.solve(seen, view, start, clock, self.records_steps), seen

    def _look(self, frame: Frame, prior: np.ndarray) -> FrameView | None:
        """The frame around the part at the prior pose; None where that is behind the camera or off the image."""
        corners_cam = self._corners @ prior[:3, :3].T + prior[:3, 3]
        if not (corners_cam[:, 2] > 0.0).all():
            return None
        corners = frame.camera.project(corners_cam)
        (x0, y0), (x1, y1) = corners.min(0) - _MARGIN_PX, corners.max(0) + _MARGIN_PX
        if x1 < 8 or y1 < 8 or x0 > frame.camera.width - 8 or y0 > frame.camera.height - 8:
            return None
        x0, y0, x1, y1 = (int(np.clip(v, -1e4, 1e4)) for v in (x0, y0, x1 + 1, y1 + 1))
        if self.config.target.search == "normals":
            return FrameView(None, image_patch(frame.image, (x0, y0, x1, y1), self.config.target.blur_px))
        return FrameView(distance_target(frame.image, (x0, y0, x1, y1), self.config.target), None)

    def _is_plausible(self, pose: np.ndarray) -> bool:
        last = self._motion.last
        far_mm = float(np.linalg.norm(pose[:3] @ self._centre() - last[:3] @ self._centre()))
        return rotation_angle_deg(pose[:3, :3], last[:3, :3]) < _LARGEST_TURN_DEG and far_mm < 2.0 * self.part.radius

    def _centre(self) -> np.ndarray:
        return np.append(self.part.box_centre, 1.0)

    def _result(
        self,
        frame: Frame,
        solved: SolvedFrame,
        seen: FrameView,
        clock: Stopwatch,
        begin: float,
        is_first: bool,
    ) -> TrackResult:
        residuals, quality = self._judge(solved.edges, seen, clock)
        note = "" if is_first else self._states.update(quality)
        elapsed_s = time.perf_counter() - begin
        return TrackResult(
            frame_id=frame.index,
            cam_T_obj=solved.cam_T_obj,
            control_points=solved.control_points,
            loss=solved.loss,
            quality=quality,
            state=self._states.state,
            region=self._region,
            edges=solved.edges,
            residuals_px=residuals,
            iterations=solved.iterations,
            timings=clock.timings(frame.undistort_s, elapsed_s),
            note=note,
            steps=solved.steps,
            target=_target_view(seen) if self.records_target else None,
        )

    def _judge(self, edges: GeneratedEdges, seen: FrameView, clock: Stopwatch) -> tuple[np.ndarray | None, float]:
        """Residuals of the final edges, (n,) px, and the quality in [0, 1]; learns where the method learns."""
        if len(edges) < MIN_EDGES:
            return None, 0.0
        measure = self._solver.measure(seen, 2.0 * _QUALITY_SIGMA_PX)
        if not isinstance(measure, SearchMeasure):
            seen_edges = measure(edges)
            residuals = seen_edges.residuals * np.sign((seen_edges.directions * edges.normals).sum(1) + 1e-12)
            near = np.exp(-0.5 * (residuals / _QUALITY_SIGMA_PX) ** 2)
            return residuals, float(near @ edges.weights / max(edges.weights.sum(), 1e-9))
        candidates, scores = measure.candidates(edges)
        fit = scores * np.exp(-0.5 * (candidates.offsets / _QUALITY_SIGMA_PX) ** 2)
        best, rows = fit.argmax(1), np.arange(len(fit))
        residuals = np.where(fit[rows, best] > 0.02, candidates.offsets[rows, best], np.nan)
        if self._solver.memory is not None and self._reliability is not None:
            ids, none = edges.sample_ids, np.zeros(len(edges), bool)
            self._solver.memory.learn(ids, candidates, best, np.nan_to_num(residuals, nan=np.inf))
            self._reliability.learn(ids, none, residuals)
            every = np.arange(len(self.model.edges))
            self._solver.trust = self._reliability.weights(every, np.zeros(len(every), bool))
            clock.learn_s += clock.lap()
        return residuals, float(fit[rows, best].mean())

    def _blind(
        self, frame: Frame | UnreadableFrame, pose: np.ndarray, clock: Stopwatch, begin: float, note: str
    ) -> TrackResult:
        points = np.full((4, 2), np.nan)
        if frame.camera is not None:
            w = self.model.control_points(self._region, self.config.control_points)
            points = frame.camera.project(w @ pose[:3, :3].T + pose[:3, 3])
        undistort_s = getattr(frame, "undistort_s", 0.0)
        return TrackResult(
            frame_id=frame.index,
            cam_T_obj=pose,
            control_points=points,
            loss=float("nan"),
            quality=0.0,
            state=self._states.state,
            region=self._region,
            edges=None,
            residuals_px=None,
            iterations=0,
            timings=clock.timings(undistort_s, time.perf_counter() - begin),
            note=note,
        )


def _rigid_generator(model: PreparedPart, name: str) -> RigidGenerator:
    if name not in model.generator_names:
        raise PreparationError(
            f"{model.part.name}: generator {name} is not prepared; "
            f"run: acp-lab prepare {model.part.path or 'MESH'} --out PARTS_DIR --generator {name}"
        )
    return model.best_generator() if name == "learned" or model.templates is None else model.templates


def _target_view(seen: FrameView) -> TargetView | None:
    if seen.target is None:
        return None
    target = seen.target
    height, width = target.edges.shape
    rows, columns = np.nonzero(target.edges)
    points = np.stack([columns, rows], 1) + np.array(target.origin)
    return TargetView(points, target.origin, (width, height), target.maps[0])
