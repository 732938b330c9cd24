"""The tracker of one part: predict, align, learn, frame by frame (`--method acp`).

The state that goes from frame to frame is the paper's: four image control points I with their 3D points
W. They are moved as a rigid part moves them; with that tie the pose and I say the same, and planar PnP of
I gives the pose back (paper IV-B).
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.control_points.view_regions import choose_region
from acp_lab.errors import TrackingError
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import rotation_angle_deg
from acp_lab.geometry.pose_step import centre_position
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.sequences.protocol import Sequence
from acp_lab.tracking.alignment import Aligner, Alignment, SolverConfig, Stopwatch
from acp_lab.tracking.learning.contour_offsets import ContourOffsets, OffsetConfig
from acp_lab.tracking.learning.edge_memory import EdgeMemory, MemoryConfig
from acp_lab.tracking.learning.reliability import ReliabilityConfig, SampleReliability
from acp_lab.tracking.observer import Observer, TrackResult, TrackStep
from acp_lab.tracking.prediction import ConstantVelocity
from acp_lab.tracking.recovery import shifted_poses, try_poses
from acp_lab.tracking.session import TrackRun, track_sequence
from acp_lab.tracking.start import LOOK_LEVEL, StartConfig, is_trusted, search_around
from acp_lab.tracking.states import StateConfig, StateMachine
from acp_lab.tracking.targets.image_edges import ImagePatch, SearchConfig


@dataclass(frozen=True)
class TrackerConfig:
    """Everything that can be set; the defaults are the same for every part and sequence.

    Attributes:
        search, memory, offsets, reliability, solver, start, state: settings of the stages.
        largest_turn_deg: no part turns more from one frame to the next; nor does it move by its own size.
        margin_px: image kept around the part beyond the search.
        quality_rate: share of a new frame in the running mean of the quality.
        learn_above: share of that mean below which nothing is learnt.
        second_try_below: share of that mean below which the part is also sought where it was last.
        third_try_below: share of that mean below which it is sought `shift_px` around there, too.
    """

    search: SearchConfig = field(default_factory=SearchConfig)
    memory: MemoryConfig = field(default_factory=MemoryConfig)
    offsets: OffsetConfig = field(default_factory=OffsetConfig)
    reliability: ReliabilityConfig = field(default_factory=ReliabilityConfig)
    solver: SolverConfig = field(default_factory=SolverConfig)
    start: StartConfig = field(default_factory=StartConfig)
    state: StateConfig = field(default_factory=StateConfig)
    largest_turn_deg: float = 45.0
    margin_px: float = 12.0
    quality_rate: float = 0.5
    learn_above: float = 0.7
    second_try_below: float = 0.8
    third_try_below: float = 0.8
    shift_px: float = 14.0


class Tracker:
    """Tracks one prepared part: `start` with a pose, then `track` frame after frame.

    records_steps, records_target: whether results carry the iterations that led to them and the image edges
    that were found; for those who look inside, off by default. They change nothing else.
    """

    def __init__(self, model: PreparedPart, config: TrackerConfig | None = None) -> None:
        self.model = model
        self.config = config or TrackerConfig()
        self.part = model.part
        self.generator = model.best_generator()
        self.records_steps = False
        self.records_target = False
        self._half_size = 0.5 * self.part.box_size
        self._motion = ConstantVelocity(self.part.box_centre)
        self._new_memories()

    @property
    def generator_name(self) -> str:
        """'learned' or 'templates': which t(I) is in use."""
        return self.generator.name

    @property
    def control_points_obj(self) -> tuple[np.ndarray, ...]:
        """(4, 3) mm per view region 0..5: the control points W."""
        return tuple(self.aligner.control_points_obj)

    @property
    def start_was_trusted(self) -> bool:
        """Whether edge offsets were measured in the first frame (see `start.is_trusted`)."""
        return self._trusted

    def start(self, frame: Frame, cam_T_obj: np.ndarray) -> TrackResult:
        """Begin at a pose (4, 4) in the first frame.

        Raises:
            TrackingError: the part at that pose is behind the camera, outside the image or shows too few edges.
        """
        begin, clock = time.perf_counter(), Stopwatch()
        self._new_memories()
        self.aligner.records_steps = self.records_steps
        pose = np.array(cam_T_obj, np.float64)
        self._region = self._choose_region(pose, None)
        patch = self._patch(frame, pose, clock)
        solved = None
        if patch is not None:
            solved = self.aligner.align(patch, frame.camera, pose, self._region, clock, use_memory=False)
        if patch is None or solved is None:
            raise TrackingError(
                f"{self.part.name}: at the start pose t = {np.round(pose[:3, 3], 1).tolist()} mm the part is not seen "
                f"in frame {frame.index} ({frame.camera.width}x{frame.camera.height}); check pose, unit and camera"
            )
        self._trusted = is_trusted(self.aligner, patch, frame.camera, pose, solved, self._region, self.config.start)
        steps: tuple[TrackStep, ...] = ()
        if not self._trusted:
            found = search_around(self.aligner, patch, frame.camera, pose, self._region, self.config.start) or solved
            pose, steps = found.cam_T_obj, found.steps
        # Where the search left the image, stay with what was given.
        alignment = replace(self._look(patch, frame.camera, pose, clock) or solved, steps=steps)
        if self._trusted:
            seen = alignment.observation
            residuals = alignment.residuals_px(min_found=0.1)
            self.offsets.learn(seen.visible.ids, seen.visible.outline, seen.expected, residuals)
        self._motion.restart(alignment.cam_T_obj)
        self._started = True
        self._mean_quality = alignment.quality
        self._learn(alignment, clock)
        return self._result(frame, alignment, clock, time.perf_counter() - begin, "")

    def track(self, frame: Frame | UnreadableFrame) -> TrackResult:
        """The pose in the next frame; an unreadable frame gets the predicted pose and quality 0.

        Raises:
            TrackingError: `start` was not called.
        """
        if not self._started:
            raise TrackingError(f"{self.part.name}: track was called before start; give the first frame to start")
        begin, clock = time.perf_counter(), Stopwatch()
        self.aligner.records_steps = self.records_steps
        predicted = self._motion.predict()
        if isinstance(frame, UnreadableFrame):
            self._motion.observe(predicted)
            return self._blind(frame, predicted, clock, time.perf_counter() - begin, frame.reason)
        self._region = self._choose_region(predicted, self._region)
        alignment = self._attempt(frame, predicted, clock)
        floor = self.config.second_try_below * self._mean_quality
        if alignment is None or alignment.quality < floor:
            alignment = self._second_try(frame, alignment, clock)
        if alignment is None:
            note = self._states.update(0.0) or "the part is not seen"
            # Prediction without sight runs away; the last pose is the better guess.
            pose = self._motion.last
            self._motion.restart(pose)
            return self._blind(frame, pose, clock, time.perf_counter() - begin, note)
        note = self._states.update(alignment.quality)
        if alignment.quality > self.config.state.lost_below:
            self._motion.observe(alignment.cam_T_obj)
        else:  # the motion of a pose that fits nothing is noise; extrapolating it runs away
            self._motion.restart(alignment.cam_T_obj)
        if alignment.quality > self.config.learn_above * self._mean_quality:
            self._learn(alignment, clock)
        # Also from poor frames: a part that stays half hidden must not count as a sudden loss for ever.
        self._mean_quality += self.config.quality_rate * (alignment.quality - self._mean_quality)
        return self._result(frame, alignment, clock, time.perf_counter() - begin, note)

    def run(self, sequence: Sequence, start: np.ndarray, observers: Iterable[Observer] = ()) -> TrackRun:
        """Track a sequence of one object from a start pose (4, 4) in its first frame."""
        object_id = sequence.object_ids[0] if sequence.object_ids else 1
        return track_sequence({object_id: self}, sequence, {object_id: start}, observers)

    def _new_memories(self) -> None:
        config, edges = self.config, self.generator.edges
        self.memory = EdgeMemory(len(edges), config.memory)
        self.offsets = ContourOffsets(edges, self.part.diameter, self.model.edge_break_mm, config.offsets)
        self.reliability = SampleReliability(len(edges), config.reliability)
        self.aligner = Aligner(
            self.part, self.generator, self.memory, self.offsets, self.reliability, config.search, config.solver
        )
        self._states = StateMachine(config.state)
        self._started = self._trusted = False
        self._region = 0
        self._mean_quality = 0.0

    def _choose_region(self, cam_T_obj: np.ndarray, current: int | None) -> int:
        return choose_region(eye_position(cam_T_obj) - self.part.box_centre, self._half_size, current)

    def _patch(self, frame: Frame, pose: np.ndarray, clock: Stopwatch) -> ImagePatch | None:
        clock.lap()
        margin = self.config.margin_px + self.config.solver.levels[0].reach_px
        patch = self.aligner.patch(frame.image, frame.camera, pose, margin)
        clock.image_s += clock.lap()
        return patch

    def _attempt(self, frame: Frame, pose: np.ndarray, clock: Stopwatch) -> Alignment | None:
        patch = self._patch(frame, pose, clock)
        if patch is None:
            return None
        found = self.aligner.align(patch, frame.camera, pose, self._region, clock)
        return self._plausible(found)

    def _is_plausible(self, pose: np.ndarray) -> bool:
        """Whether a pose can follow the last one at all; a diverged solution never can."""
        last, centre = self._motion.last, self.part.box_centre
        now, before = centre_position(pose, centre), centre_position(last, centre)
        turned_deg = rotation_angle_deg(pose[:3, :3], last[:3, :3])
        return bool(turned_deg < self.config.largest_turn_deg and np.linalg.norm(now - before) < 2.0 * self.part.radius)

    def _second_try(self, frame: Frame, first: Alignment | None, clock: Stopwatch) -> Alignment | None:
        """From where the part was last and from poses around there; from far around when it is lost."""
        last, best = self._motion.last, first
        patch = self._patch(frame, last, clock)
        if patch is None:
            return best
        if self._motion.moves:  # else the first try began there
            again = self.aligner.align(patch, frame.camera, last, self._region, clock)
            best = _better(best, self._plausible(again))
        if best is None or best.quality < self.config.third_try_below * self._mean_quality:
            starts = shifted_poses(last, self.part.box_centre, frame.camera, self.config.shift_px)
            best = _better(best, self._plausible(try_poses(self.aligner, patch, frame.camera, starts, self._region)))
        if self._states.is_time_to_search():
            found = search_around(
                self.aligner, patch, frame.camera, last, self._region, self.config.start, use_memory=True
            )
            best = _better(best, self._plausible(found))
        return best

    def _plausible(self, alignment: Alignment | None) -> Alignment | None:
        return alignment if alignment and self._is_plausible(alignment.cam_T_obj) else None

    def _look(self, patch: ImagePatch, camera: Camera, pose: np.ndarray, clock: Stopwatch) -> Alignment | None:
        """All visible samples at a fixed pose, for learning."""
        seen = self.aligner.observe(patch, camera, pose, self._region, LOOK_LEVEL, clock, use_memory=False)
        return None if seen is None else self.aligner.judge(seen, camera, pose)

    def _learn(self, alignment: Alignment, clock: Stopwatch) -> None:
        clock.lap()
        seen = alignment.observation
        residuals = alignment.residuals_px()
        self.memory.learn(seen.visible.ids, seen.candidates, alignment.best, np.nan_to_num(residuals, nan=np.inf))
        self.offsets.observe_scatter(seen.visible.ids, seen.visible.outline, residuals, seen.jacobian)
        self.reliability.learn(seen.visible.ids, seen.visible.outline, residuals)
        clock.learn_s += clock.lap()

    def _result(self, frame: Frame, alignment: Alignment, clock: Stopwatch, elapsed_s: float, note: str) -> TrackResult:
        pose = alignment.cam_T_obj
        return TrackResult(
            frame_id=frame.index,
            cam_T_obj=pose,
            control_points=self.aligner.control_points(frame.camera, pose, self._region),
            loss=alignment.loss,
            quality=min(max(alignment.quality, 0.0), 1.0),
            state=self._states.state,
            region=self._region,
            edges=self.aligner.generated(alignment, frame.camera),
            residuals_px=alignment.residuals_px(),
            iterations=alignment.iterations,
            timings=clock.timings(frame.undistort_s, elapsed_s),
            note=note,
            steps=alignment.steps,
            target=alignment.observation.target(self.config.solver.min_score) if self.records_target else None,
        )

    def _blind(
        self, frame: Frame | UnreadableFrame, pose: np.ndarray, clock: Stopwatch, elapsed_s: float, note: str
    ) -> TrackResult:
        camera = frame.camera
        points = np.full((4, 2), np.nan) if camera is None else self.aligner.control_points(camera, pose, self._region)
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
            timings=clock.timings(getattr(frame, "undistort_s", 0.0), elapsed_s),
            note=note,
        )


def _better(first: Alignment | None, second: Alignment | None) -> Alignment | None:
    if first is None or second is None:
        return first or second
    return second if second.quality > first.quality else first
