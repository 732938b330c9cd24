"""The tracker of one part, and the only frame loop: predict, look, solve, recover, learn, report.

What it does in each stage is its method's (see `method`); the loop is the same for all. How a track begins is in
`beginning`, how a frame's pose is found in `locating`, whether the part is there in `whereabouts`. The state that goes
from frame to frame is the paper's: four image control points I with their 3D points W, or the pose that says the same.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from acp_lab.control_points.view_regions import REGION_COUNT
from acp_lab.errors import SequenceError, TrackingError, check_kind
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import check_pose, transform
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame, UnreadableFrame, check_frame
from acp_lab.sequences.protocol import Sequence
from acp_lab.tracking.assessment import Assessment
from acp_lab.tracking.beginning import Beginning
from acp_lab.tracking.camera_motion import CameraFollower
from acp_lab.tracking.find import LateFinder
from acp_lab.tracking.first_frame import FirstFrame
from acp_lab.tracking.frame_solver import FrameSolver
from acp_lab.tracking.kalman import KalmanPrediction, PoseKalman
from acp_lab.tracking.learning.knowledge import Off
from acp_lab.tracking.locating import Locator
from acp_lab.tracking.magnification import MagnifyingGlass
from acp_lab.tracking.method import ACP, Method, method_named
from acp_lab.tracking.observer import Observer
from acp_lab.tracking.pursuit import Pursuit
from acp_lab.tracking.recovery import Alternatives
from acp_lab.tracking.repeated_picture import ShownPicture
from acp_lab.tracking.result import NOT_PREPARED, TrackResult
from acp_lab.tracking.session import TrackRun, track_sequence
from acp_lab.tracking.solution import SeenFrame, Solution
from acp_lab.tracking.start import LOOK_LEVEL
from acp_lab.tracking.steadying import SteadyPictures
from acp_lab.tracking.stopwatch import Stopwatch
from acp_lab.tracking.time_step import FrameTimes, TimeStep
from acp_lab.tracking.turned import TurnChecker
from acp_lab.tracking.whereabouts import Whereabouts


class Tracker:
    """Tracks one prepared part: `start` with a pose, then `track` frame after frame.

    records_steps, records_target: whether results carry the iterations that led to them and the image edges
    that were found; for those who look inside, off by default. They change nothing else.

    Example:
        >>> import acp_lab as acp
        >>> from acp_lab.sample import sample_dataset
        >>> scene = acp.open_sequence(sample_dataset())
        >>> model = acp.prepare(scene.dataset.part(1), out="parts")  # doctest: +SKIP
        >>> tracker = acp.Tracker(model)
        >>> result = tracker.start(scene.frame(0), scene.first_pose)
        >>> result = tracker.track(scene.frame(1))
        >>> str(result.state), result.control_points.shape
        ('tracking', (4, 2))
    """

    def __init__(self, model: PreparedPart, method: Method | str = ACP) -> None:
        """method: one of `method.METHODS` by its name, or any other `Method`.

        Raises PreparationError when the part lacks the generator that the method needs, TrackingError for an
        unknown name.
        """
        check_kind(model, PreparedPart, "model", "acp.PreparedPart.load('parts/bracket'), or what acp.prepare returned")
        self.model = model
        self.part = model.part
        self.method = method_named(method) if isinstance(method, str) else method
        check_kind(self.method, Method, "method", f"one of acp.METHODS by its name, such as {ACP.name!r}, or a Method")
        self.solver = FrameSolver(model, self.method)
        self.records_steps = False
        self.records_target = False
        part, method, finder = model.part, self.solver.method, LateFinder(model)
        self._assessment = Assessment(part, method)
        self._pursuit = Pursuit(self.solver)
        self._whereabouts = Whereabouts(model, method, self._assessment, finder)
        self._turn_checker = TurnChecker(model.near_turns, method.turns, self._pursuit)
        self._beginning = Beginning(model, self.solver, self._assessment, finder, self._turn_checker)
        self._locator = Locator(self._pursuit, self._whereabouts, self._turn_checker)
        self._pictures = SteadyPictures(part, method)
        takes_jerks = isinstance(method.prediction, KalmanPrediction)
        self._camera = CameraFollower(part, method.camera if takes_jerks else Off())
        self._shown = ShownPicture(part, method.margin_px)
        self._times = FrameTimes()
        self._first: FirstFrame | None = None
        self._forget()

    @property
    def name(self) -> str:
        """Of the method; what results are called."""
        return self.method.name

    @property
    def generator_name(self) -> str:
        """'learned', 'templates' or 'autoencoder': which t(I) is in use."""
        return self.solver.source.name

    @property
    def control_points_obj(self) -> tuple[FloatArray, ...]:
        """(4, 3) mm per view region 0..5: the control points W."""
        return tuple(points.copy() for points in self.solver.control_points_obj)

    @property
    def start_was_trusted(self) -> bool:
        """Whether the start pose was taken for exact enough to go on from (see `start.is_trusted`)."""
        return self._trusted

    @property
    def predicted(self) -> FloatArray:
        """(4, 4) mm: the pose expected in the next frame; the last pose is `last`. TrackingError before `start`."""
        self._check_started("predicted was asked")
        return self._pursuit.predicted.copy()  # whoever gets it may change it

    @property
    def last(self) -> FloatArray:
        """(4, 4) mm: the pose that the next frame is predicted from. TrackingError before `start`."""
        self._check_started("last was asked")
        return self._pursuit.last.copy()

    @property
    def readout(self) -> FloatArray | None:
        """(2,) how long the camera seems to take to read a picture, as shares of the time between two frames.

        From its left edge to its right one, and from top to bottom: one of them, above 0 or below, of a rolling
        shutter. None while nothing was seen of one.
        """
        readout = self.solver.knowledge.readout
        return None if readout is None else readout.copy()

    @property
    def gamma(self) -> float | None:
        """1.0 where the camera seems to store light as it is: light is the grey level to this power.

        None for a camera that encodes light for displays, as the method expects (`SearchConfig.gamma`), and as long as
        no moving edges told.
        """
        return self.solver.knowledge.gamma

    def check_region(self, cam_T_obj: FloatArray) -> None:
        """PreparationError where the method's generator was not trained for the view region of a pose (4, 4)."""
        self._beginning.prepared_region(cam_T_obj)

    def start(self, frame: Frame, cam_T_obj: FloatArray, found: bool = False) -> TrackResult:
        """Begin at a pose (4, 4) in the first frame.

        found: whether the pose was found in this very frame, by `acp.detect` or `acp.snap`: then it is not taken for
        exact, however well the frame agrees with it, see `tracking.start`.
        One that is refused for the pose alone leaves an earlier track as it is.

        Raises:
            ParameterError: it is no frame, such as a bare image, or `found` is neither True nor False.
            GeometryError: it is no pose: mirrored, scaled, not finite.
            TrackingError: the part at that pose is behind the camera, outside the image or shows too few edges.
            PreparationError: it is seen from a view region that the method's generator was not trained for.
        """
        clock = Stopwatch()
        check_frame(frame)
        told: object = found
        check_kind(told.item() if isinstance(told, np.bool_) else told, bool, "found", "True or False")
        pose = check_pose(cam_T_obj, f"{self.part.name}: the start pose")
        region = self._beginning.region(frame, pose)
        self._forget()
        self.solver.records_steps = self.records_steps
        as_given, pursuit = frame, self._pursuit
        frame = self._steady(frame, pose, clock)
        self.solver.magnify(frame.camera, pose)
        pursuit.region = region
        seen = pursuit.look(frame, pose, clock)
        started = None if seen is None else self._beginning.begin(frame, seen, found, clock)
        if started is None:
            raise self._beginning.not_seen(frame, pose)
        seen, solution, self._trusted = started.seen, started.solution, started.trusted
        pursuit.region = seen.view.region
        matches = solution.judgement.matches
        if started.measures and matches is not None:
            self.solver.knowledge.measure_offsets(matches)
            self._first = FirstFrame(frame, solution.cam_T_obj, pursuit.region)
        self._started = True
        self._learn(frame, solution, clock, self._trusted)
        score = 0.0
        if isinstance(self.method.recovery, Alternatives) or self.method.prediction.weighs_images:
            # Again, with what the first frame taught; later frames are compared with it.
            again = self.solver.look_at(seen, seen.view.at_pose(solution.cam_T_obj), LOOK_LEVEL, clock)
            score = (again or solution).score
        pursuit.begin(solution, score)
        self._turn_checker.begin(frame, solution, clock)
        quality = self._assessment.quality(solution)
        note = self._whereabouts.begin(solution.cam_T_obj, quality)
        if not self._trusted and not isinstance(self.method.uncertainty, Off):
            solution = self.solver.weigh(seen, solution)
        self._camera.begin(frame, solution.cam_T_obj)
        self._shown.keep(as_given, solution.cam_T_obj)
        self._times.begin(as_given)
        return self._result(frame, pose, solution, quality, _joined(started.note, note), clock)

    def track(self, frame: Frame | UnreadableFrame) -> TrackResult:
        """The pose in the next frame; an unreadable frame gets the predicted pose and quality 0.

        Raises:
            TrackingError: `start` was not called.
            ParameterError: it is no frame, such as a bare image.
        """
        self._check_started("track was called")
        if not isinstance(frame, UnreadableFrame):
            check_frame(frame)
        clock = Stopwatch()
        self.solver.records_steps = self.records_steps
        step = self._elapse(frame)
        if isinstance(frame, UnreadableFrame):
            return self._unread(frame, clock)
        as_given, is_repeated = frame, self._shown.is_again_in(frame)
        frame = self._expect(frame, step, is_repeated, clock)
        located = self._locator.locate(frame, is_repeated, clock)
        solution = located.solution
        if solution is None:
            # Prediction without sight runs away; the last pose is the better guess.
            self._pursuit.restart(self._pursuit.last)
            note = self._whereabouts.miss() or "the part is not seen"
            return self._blind(frame, located.predicted, self._pursuit.last, note, clock)
        quality = self._assessment.quality(solution)
        note = self._whereabouts.take_in(frame, solution, quality, clock)
        self._go_on_from(frame, solution, quality, located.is_leap)
        self._keep(frame, as_given, solution, clock)
        note = _joined(self._unprepared(located.region_at), located.note, note)
        return self._result(frame, located.predicted, solution, quality, note, clock)

    def run(
        self,
        sequence: Sequence,
        start: FloatArray,
        observers: Iterable[Observer] = (),
        object_id: int | None = None,
        max_frames: int | None = None,
        found: bool = False,
    ) -> TrackRun:
        """Track one object through a sequence, from a start pose (4, 4) in its first frame; see `track_sequence`.

        Args:
            object_id: which of the sequence's objects it is; None where there is only one.
            found: whether the start pose was found in the first frame, see `start`.

        Raises SequenceError where the sequence has several objects and none was named; else as `follow_sequence`.
        """
        if isinstance(sequence, str | Path):
            raise SequenceError(f"{sequence}: is a path, no sequence: give acp.open_sequence or acp.open_images of it")
        if not hasattr(sequence, "frames"):
            raise SequenceError(
                f"a {type(sequence).__name__} is no sequence: give acp.open_images(images, camera) of images in memory"
            )
        start = check_pose(start, f"{self.part.name}: the start pose")  # before observers replace their files
        ids = sequence.object_ids or (1,)
        if object_id is not None and object_id not in ids and (len(ids) > 1 or _has_truth(sequence)):
            raise SequenceError(
                f"{sequence.name}: the first frame does not show object {object_id}, but {', '.join(map(str, ids))}"
            )
        if object_id is None and len(ids) > 1:
            raise SequenceError(
                f"{sequence.name}: the first frame shows objects {', '.join(map(str, ids))}: say which is tracked, "
                f"such as object_id={ids[0]}"
            )
        object_id = ids[0] if object_id is None else object_id
        where_found = (object_id,) if found else ()
        return track_sequence({object_id: self}, sequence, {object_id: start}, observers, max_frames, found=where_found)

    def look(self, frame: Frame, prior: FloatArray) -> SeenFrame | None:
        """A frame around the part at a pose (4, 4), as the next `track` would see it; changes nothing.

        But for a part that `track` magnifies or makes smaller: here it is seen as it is, in px of the frame. None where
        the part is not in sight, see `crop_box`.
        """
        check_frame(frame)
        prior = check_pose(prior, f"{self.part.name}: the pose to look from")
        region = self.solver.choose_region(prior, self._pursuit.region if self._started else None)
        frame = self._pictures.preview(frame, prior)
        glass, self.solver.glass = self.solver.glass, MagnifyingGlass(None)
        try:
            return self.solver.look(frame.image, frame.camera, prior, region, motion=self._pursuit.predictor.motion)
        finally:
            self.solver.glass = glass

    def _check_started(self, what: str) -> None:
        if not self._started:
            raise TrackingError(f"{self.part.name}: {what} before start; give the first frame to start")

    def _forget(self) -> None:
        self.solver.forget()
        self._pursuit.forget()
        self._whereabouts.forget()
        self._turn_checker.forget()
        self._pictures.forget()
        self._camera.forget()
        self._shown.forget()
        self._first = None
        self._started = self._trusted = False
        self._warned = len(self.solver.source.regions) == REGION_COUNT  # then there is nothing to warn of

    def _elapse(self, frame: Frame | UnreadableFrame) -> TimeStep:
        """Time goes by until this frame."""
        if self._first is not None:
            self._first.next_frame()
        step = self._times.step_to(frame)
        self._pursuit.predictor.elapse(step)
        self._whereabouts.next_frame()
        return step

    def _expect(self, frame: Frame, step: TimeStep, is_repeated: bool, clock: Stopwatch) -> Frame:
        """The frame as it is to be seen, and the part where it is expected in it; is_repeated: see `Locator.locate`."""
        predictor = self._pursuit.predictor
        if is_repeated:
            predictor.repeat()
        frame = self._steady(frame, self._pursuit.predicted, clock)
        if not is_repeated:
            further = self._camera.acceleration(frame, self._pursuit.predicted, step.of_last)
            # A part that rests for all that is known may as well rest beside the camera.
            if further is not None and isinstance(predictor, PoseKalman) and predictor.moves:
                predictor.accelerate(further)
            clock.image_s += clock.lap()
        self.solver.magnify(frame.camera, self._pursuit.predicted)
        return frame

    def _steady(self, frame: Frame, expected: FloatArray, clock: Stopwatch) -> Frame:
        clock.lap()
        frame = self._pictures.steady(frame, expected)
        clock.image_s += clock.lap()
        return frame

    def _go_on_from(self, frame: Frame, solution: Solution, quality: float, is_leap: bool) -> None:
        """Where the next frame is expected from."""
        pursuit, whereabouts = self._pursuit, self._whereabouts
        if whereabouts.is_looked_for:
            # A search that follows what does not fit ends up anywhere, and a leap is no velocity.
            pursuit.restart(solution.cam_T_obj if whereabouts.fits else whereabouts.last_seen)
            if whereabouts.fits:
                pursuit.remember(frame, solution.cam_T_obj)  # how fast it is nobody knows: the next frame has to see it
        elif is_leap:
            pursuit.begin(solution, solution.score)  # how well the wrong pose fitted says nothing
            pursuit.remember(frame, solution.cam_T_obj)
        else:
            pursuit.go_on_from(solution, quality)
            self._camera.found(solution.cam_T_obj, frame.camera)

    def _keep(self, frame: Frame, as_given: Frame, solution: Solution, clock: Stopwatch) -> None:
        """What the frame teaches, as far as it may; as_given: before it was steadied."""
        whereabouts, pose = self._whereabouts, solution.cam_T_obj
        if whereabouts.may_teach:
            self._learn(frame, solution, clock)
            self._measure_again(pose, clock)
        elif not whereabouts.is_lost:
            self._pursuit.remember(frame, pose)
        if not whereabouts.is_lost:
            self._shown.keep(as_given, pose)
            # Also from poor frames: a part that stays half hidden must not count as a sudden loss for ever.
            self._pursuit.usual.take_in(solution)

    def _unread(self, frame: UnreadableFrame, clock: Stopwatch) -> TrackResult:
        self._camera.miss()
        self._turn_checker.interrupt()
        predicted = self._pursuit.predicted
        self._pursuit.predictor.coast()
        return self._blind(frame, predicted, predicted, _joined(frame.reason, self._whereabouts.miss()), clock)

    def _unprepared(self, cam_T_obj: FloatArray) -> str:
        """Says, once, that the part turned to where the generator was not prepared: to a pose (4, 4)."""
        if self._warned or self.solver.is_prepared_for(cam_T_obj, self._pursuit.region):
            return ""
        self._warned = True
        natural, region = self.solver.natural_region(cam_T_obj), self._pursuit.region
        return f"view region {natural} {NOT_PREPARED}: that of region {region} is used; accuracy will fall"

    def _learn(self, frame: Frame, solution: Solution, clock: Stopwatch, trusted: bool = False) -> None:
        clock.lap()
        knowledge, quality = self.solver.knowledge, solution.judgement.quality
        if knowledge.trusts(quality, self._pursuit.usual.mean_quality):
            if knowledge.learns and knowledge.is_new(frame.camera, solution.cam_T_obj, quality):
                for judgement in solution.judgements:
                    judgement.learn(trusted)
            self._pursuit.remember(frame, solution.cam_T_obj)
        clock.learn_s += clock.lap()

    def _measure_again(self, cam_T_obj: FloatArray, clock: Stopwatch) -> None:
        """The first frame, once more is known of the camera."""
        if self._first is not None:
            clock.lap()
            if not self._first.measure_again(self.solver, cam_T_obj, clock):
                self._first = None
            clock.learn_s += clock.lap()

    def _result(
        self,
        frame: Frame,
        predicted: FloatArray,
        solution: Solution,
        quality: float,
        note: str,
        clock: Stopwatch,
    ) -> TrackResult:
        judgement, covariance, glass = solution.judgement, self._assessment.covariance(solution), self.solver.glass
        return TrackResult(
            frame_id=frame.index,
            # Copies: whoever gets the result may change them, to metres say, and the tracker goes on from its own.
            cam_T_obj=solution.cam_T_obj.copy(),
            predicted=predicted.copy(),
            control_points=glass.points(solution.estimate.control_points).copy(),
            loss=solution.loss,
            quality=quality,
            state=self._whereabouts.state,
            region=self._pursuit.region,
            edges=glass.edges(self.solver.shown_edges(solution)),
            residuals_px=glass.lengths(judgement.residuals_px),
            iterations=solution.iterations,
            timings=clock.timings(frame.undistort_s),
            note=note,
            steps=glass.steps(solution.steps),
            covariance=covariance,
            exactness=self._assessment.exactness(solution.cam_T_obj, covariance),
            target=glass.target(judgement.target_view) if self.records_target else None,
            sought=self._whereabouts.sought,
        )

    def _blind(
        self, frame: Frame | UnreadableFrame, predicted: FloatArray, pose: FloatArray, note: str, clock: Stopwatch
    ) -> TrackResult:
        return TrackResult(
            frame_id=frame.index,
            cam_T_obj=pose.copy(),
            predicted=predicted.copy(),
            control_points=self._project(frame.camera, pose),
            loss=float("nan"),
            quality=0.0,
            state=self._whereabouts.state,
            region=self._pursuit.region,
            edges=None,
            residuals_px=None,
            iterations=0,
            timings=clock.timings(frame.undistort_s if isinstance(frame, Frame) else 0.0),
            note=note,
            sought=self._whereabouts.sought,
        )

    def _project(self, camera: Camera | None, pose: FloatArray) -> FloatArray:
        if camera is None:
            return np.full((4, 2), np.nan)
        return camera.project(transform(pose, self.solver.control_points_obj[self._pursuit.region]))


def _joined(*notes: str) -> str:
    return "; ".join(filter(None, notes))


def _has_truth(sequence: Sequence) -> bool:
    try:
        return bool(sequence.first_poses)
    except SequenceError:
        return False
