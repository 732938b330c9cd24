"""The tracker of one part, and the only frame loop: predict, look, solve, recover, learn, report.

What it does in each stage is its method's (see `method`); the loop is the same for all. How a frame's pose is found is
in `pursuit`, whether the part is there in `whereabouts`. The state that goes from frame to frame is the paper's: four
image control points I with their 3D points W, or the pose that says the same.
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from acp_lab.cad.part import box_corners
from acp_lab.control_points.view_regions import REGION_COUNT
from acp_lab.errors import PreparationError, SequenceError, TrackingError, check_kind
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import check_pose, transform
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame, UnreadableFrame, check_frame
from acp_lab.sequences.protocol import Sequence
from acp_lab.tracking.assessment import Assessment
from acp_lab.tracking.camera_motion import CameraFollower, CameraMotion
from acp_lab.tracking.denoising import NoiseFilter
from acp_lab.tracking.find import LateFinder
from acp_lab.tracking.first_frame import FirstFrame
from acp_lab.tracking.frame_solver import FrameSolver
from acp_lab.tracking.frame_view import LEAST_PART_PX, Box, crop_box
from acp_lab.tracking.kalman import KalmanPrediction, PoseKalman
from acp_lab.tracking.learning.knowledge import Off
from acp_lab.tracking.magnification import MagnifyingGlass
from acp_lab.tracking.method import ACP, Method, method_named
from acp_lab.tracking.observer import Observer
from acp_lab.tracking.pursuit import Pursuit
from acp_lab.tracking.recovery import Alternatives
from acp_lab.tracking.repeated_picture import ShownPicture
from acp_lab.tracking.result import NOT_PREPARED, TrackResult
from acp_lab.tracking.search import Look
from acp_lab.tracking.second_opinion import Question, second_opinion
from acp_lab.tracking.session import TrackRun, track_sequence
from acp_lab.tracking.solution import SeenFrame, Solution
from acp_lab.tracking.start import LOOK_LEVEL, Started, TrustedStart, begin
from acp_lab.tracking.stopwatch import Stopwatch
from acp_lab.tracking.time_step import FrameTimes, TimeStep
from acp_lab.tracking.tones import Tones
from acp_lab.tracking.turn_check import TurnCheck
from acp_lab.tracking.turned import TurnChecker, Turned
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
        self._pursuit = Pursuit(self.solver)
        self.records_steps = False
        self.records_target = False
        self._first: FirstFrame | None = None
        self._tones = None if isinstance(self.method.tones, Off) else Tones(self.method.tones)
        self._noise = None if isinstance(self.method.denoising, Off) else NoiseFilter(self.method.denoising)
        self._finder = LateFinder(model)
        self._assessment = Assessment(model.part, self.solver.method)
        self._whereabouts = Whereabouts(model, self.solver.method, self._assessment, self._finder)
        turns, has_turns = self.method.turns, len(model.near_turns) > 0
        self._turn_checker: TurnChecker | None = None
        if isinstance(turns, TurnCheck) and has_turns:
            self._turn_checker = TurnChecker(model.near_turns, turns, self._pursuit)
        self._corners_obj = box_corners(model.part)
        camera, takes_jerks = self.method.camera, isinstance(self.method.prediction, KalmanPrediction)
        self._camera = CameraFollower(model.part, camera) if isinstance(camera, CameraMotion) and takes_jerks else None
        self._times = FrameTimes()
        self._shown = ShownPicture(model.part, self.method.margin_px)
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

    def start(self, frame: Frame, cam_T_obj: FloatArray) -> TrackResult:
        """Begin at a pose (4, 4) in the first frame.

        Raises:
            GeometryError: it is no pose: mirrored, scaled, not finite.
            TrackingError: the part at that pose is behind the camera, outside the image or shows too few edges.
            PreparationError: it is seen from a view region that the method's generator was not trained for.
        """
        begin_s, clock = time.perf_counter(), Stopwatch()
        check_frame(frame)
        check_pose(cam_T_obj, f"{self.part.name}: the start pose")
        self._forget()
        self.solver.records_steps = self.records_steps
        pose, as_given = np.array(cam_T_obj, np.float64), frame
        frame = self._steady(frame, pose, clock)
        self.solver.magnify(frame.camera, pose)
        self._pursuit.region = self._first_region(pose)
        seen = self._pursuit.look(frame, pose, clock)
        started = None if seen is None else self._begin(frame, seen, clock)
        if seen is None or started is None:
            depth_mm = float(transform(pose, self.part.box_centre)[2])
            how = f", or it is smaller than {LEAST_PART_PX} px"
            if depth_mm <= 0.0:
                how = " and lies behind the camera"
            elif depth_mm < self.part.radius:
                how = f", as its middle is {depth_mm:.0f} mm from the lens, nearer than its own size"
            size = f"{frame.camera.width}x{frame.camera.height}"
            raise TrackingError(
                f"{self.part.name}: at the start pose t = {np.round(pose[:3, 3], 1).tolist()} mm the part is not seen "
                f"in frame {frame.index} ({size}){how}; check pose, unit and camera"
            )
        seen, solution, self._trusted = started.seen, started.solution, started.trusted
        self._pursuit.region = seen.view.region
        matches = solution.judgement.matches
        if started.measures and matches is not None:
            self.solver.knowledge.measure_offsets(matches)
            self._first = FirstFrame(frame, solution.cam_T_obj, self._pursuit.region)
        self._started = True
        self._learn(frame, solution, clock, self._trusted)
        score = 0.0
        if isinstance(self.method.recovery, Alternatives) or self.method.prediction.weighs_images:
            # Again, with what the first frame taught; later frames are compared with it.
            again = self.solver.look_at(seen, seen.view.at_pose(solution.cam_T_obj), LOOK_LEVEL, clock)
            score = (again or solution).score
        self._pursuit.begin(solution, score)
        if self._turn_checker is not None:
            self._turn_checker.begin(frame, solution, clock)
        quality = self._assessment.quality(solution)
        note = self._whereabouts.begin(solution.cam_T_obj, quality)
        if not isinstance(self.method.way_back, Off) and self.model.views is not None:
            self._finder()  # before it is needed
        note = "; ".join(filter(None, (started.note, note)))
        if not self._trusted and not isinstance(self.method.uncertainty, Off):
            solution = self.solver.weigh(seen, solution)
        if self._camera is not None:
            self._camera.begin(frame, solution.cam_T_obj)
        self._shown.keep(as_given, solution.cam_T_obj)
        self._times.begin(as_given)
        return self._result(frame, pose, solution, quality, clock, begin_s, note)

    def track(self, frame: Frame | UnreadableFrame) -> TrackResult:
        """The pose in the next frame; an unreadable frame gets the predicted pose and quality 0.

        Raises:
            TrackingError: `start` was not called.
            ParameterError: it is no frame, such as a bare image.
        """
        self._check_started("track was called")
        if not isinstance(frame, UnreadableFrame):
            check_frame(frame)
        begin_s, clock = time.perf_counter(), Stopwatch()
        pursuit, whereabouts = self._pursuit, self._whereabouts
        self.solver.records_steps = self.records_steps
        if self._first is not None:
            self._first.next_frame()
        step = self._times.step_to(frame)
        pursuit.predictor.elapse(step)
        whereabouts.next_frame()
        if isinstance(frame, UnreadableFrame):
            if self._camera is not None:
                self._camera.miss()
            if self._turn_checker is not None:
                self._turn_checker.interrupt()
            predicted = pursuit.predicted
            pursuit.predictor.coast()
            note = "; ".join(filter(None, (frame.reason, whereabouts.miss())))
            return self._blind(frame, predicted, predicted, clock, begin_s, note)
        if comes_again := self._shown.is_again_in(frame):
            pursuit.predictor.repeat()
        as_given, frame = frame, self._steady(frame, pursuit.predicted, clock)
        if not comes_again:
            self._follow_camera(frame, step, clock)
        self.solver.magnify(frame.camera, pursuit.predicted)
        proposals, other, turned = whereabouts.proposals(frame, clock), None, None
        if proposals:
            predicted, solution = pursuit.predicted, pursuit.best_of(frame, proposals, clock)
            whereabouts.tried(solution)
        else:
            predicted, solution = pursuit.follow(frame, clock)
            if not whereabouts.is_looked_for:
                solution = pursuit.recover(frame, predicted, solution, clock, whereabouts.states)
            other = self._elsewhere(frame, solution, clock)
            solution = other or solution
        asks = not (proposals or other is not None or whereabouts.is_looked_for)
        if not comes_again:  # the same picture says nothing new
            turned = self._turned(frame, solution if asks else None, clock)
        solution = solution if turned is None else turned.solution
        if whereabouts.is_looked_for and whereabouts.is_another(frame, solution, bool(proposals), pursuit.solve, clock):
            pursuit.turn_back(whereabouts.last_seen)
            solution = None
        if solution is None:
            # Prediction without sight runs away; the last pose is the better guess.
            pursuit.restart(pursuit.last)
            note = whereabouts.miss() or "the part is not seen"
            return self._blind(frame, predicted, pursuit.last, clock, begin_s, note)
        quality = self._assessment.quality(solution)
        note = whereabouts.take_in(frame, solution, quality, clock)
        if whereabouts.is_looked_for:
            # A search that follows what does not fit ends up anywhere, and a leap is no velocity.
            pursuit.restart(solution.cam_T_obj if whereabouts.fits else whereabouts.last_seen)
            if whereabouts.fits:
                pursuit.remember(frame, solution.cam_T_obj)  # how fast it is nobody knows: the next frame has to see it
        elif other is not None or (turned is not None and turned.is_leap):
            pursuit.begin(solution, solution.score)  # a leap, too, and how well the wrong pose fitted says nothing
            pursuit.remember(frame, solution.cam_T_obj)
        else:
            pursuit.go_on_from(solution, quality)
            if self._camera is not None:
                self._camera.found(solution.cam_T_obj, frame.camera)
        if whereabouts.may_teach:
            self._learn(frame, solution, clock)
            self._measure_again(solution.cam_T_obj, clock)
        elif not whereabouts.is_lost:
            pursuit.remember(frame, solution.cam_T_obj)
        if not whereabouts.is_lost:
            self._shown.keep(as_given, solution.cam_T_obj)
            # Also from poor frames: a part that stays half hidden must not count as a sudden loss for ever.
            pursuit.usual.take_in(solution)
        if other is not None:
            note = "; ".join(filter(None, ("the detector finds it elsewhere", note)))
        if turned is not None:
            note = "; ".join(filter(None, ("turned: only there the edges that tell are found", note)))
        # Where the region was chosen at.
        at = predicted if other is None and turned is None and not proposals else solution.cam_T_obj
        note = "; ".join(filter(None, (self._unprepared(at), note)))
        return self._result(frame, predicted, solution, quality, clock, begin_s, note)

    def run(
        self,
        sequence: Sequence,
        start: FloatArray,
        observers: Iterable[Observer] = (),
        object_id: int | None = None,
        max_frames: int | None = None,
    ) -> TrackRun:
        """Track one object through a sequence, from a start pose (4, 4) in its first frame; see `track_sequence`.

        Args:
            object_id: which of the sequence's objects it is; None where there is only one.

        Raises SequenceError where the sequence has several objects and none was named; else as `follow_sequence`.
        """
        if isinstance(sequence, str | Path):
            raise SequenceError(f"{sequence}: is a path, no sequence: give acp.open_sequence or acp.open_images of it")
        if not hasattr(sequence, "frames"):
            raise SequenceError(
                f"a {type(sequence).__name__} is no sequence: give acp.open_images(images, camera) of images in memory"
            )
        check_pose(start, f"{self.part.name}: the start pose")  # before observers replace their files
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
        return track_sequence({object_id: self}, sequence, {object_id: start}, observers, max_frames)

    def look(self, frame: Frame, prior: FloatArray) -> SeenFrame | None:
        """A frame around the part at a pose (4, 4), as the next `track` would see it; changes nothing.

        But for a part that `track` magnifies or makes smaller: here it is seen as it is, in px of the frame. None where
        the part is not in sight, see `crop_box`.
        """
        check_frame(frame)
        check_pose(prior, f"{self.part.name}: the pose to look from")
        region = self.solver.choose_region(prior, self._pursuit.region if self._started else None)
        if self._tones is not None:
            frame = self._tones.preview(frame, self._middle_at(frame, prior))
        if self._noise is not None:
            frame = self._noise.preview(frame)
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
        self._first = None
        self._whereabouts.forget()
        if self._tones is not None:
            self._tones.forget()
        if self._noise is not None:
            self._noise.forget()
        self._shown.forget()
        if self._camera is not None:
            self._camera.forget()
        if self._turn_checker is not None:
            self._turn_checker.forget()
        self._started = self._trusted = False
        self._warned = len(self.solver.source.regions) == REGION_COUNT  # then there is nothing to warn of

    def _first_region(self, pose: FloatArray) -> int:
        region = self.solver.choose_region(pose)
        if not self.solver.is_prepared_for(pose, region):
            natural, trained = self.solver.natural_region(pose), self.solver.source.regions
            # Without its name other generators are prepared.
            option = " --generator autoencoder" if self.generator_name == "autoencoder" else ""
            raise PreparationError(
                f"{self.part.name}: the part is seen from view region {natural}, generator {self.generator_name} is "
                f"prepared for {', '.join(map(str, trained))} only; {self.model.prepare_command}{option} "
                f"--regions {natural}"
            )
        return region

    def _unprepared(self, predicted: FloatArray) -> str:
        """Says, once, that the part turned to where the generator was not prepared."""
        if self._warned or self.solver.is_prepared_for(predicted, self._pursuit.region):
            return ""
        self._warned = True
        natural, region = self.solver.natural_region(predicted), self._pursuit.region
        return f"view region {natural} {NOT_PREPARED}: that of region {region} is used; accuracy will fall"

    def _begin(self, frame: Frame, seen: SeenFrame, clock: Stopwatch) -> Started | None:
        config, solver = self.method.start, self.solver
        if not isinstance(config, Off):

            def look(pose: FloatArray) -> SeenFrame | None:
                return solver.look(frame.image, frame.camera, pose, solver.choose_region(pose))

            started = begin(solver, look, seen, config, clock)
            if started is None or started.trusted:
                return started
            return self._asked_again(frame, look, seen.view.prior, started, config, clock)
        solution = self.solver.solve(seen, seen.view.at_pose(seen.view.prior), clock)
        return None if solution is None else Started(seen, solution, trusted=False, measures=False)

    def _asked_again(
        self, frame: Frame, look: Look, start: FloatArray, started: Started, config: TrustedStart, clock: Stopwatch
    ) -> Started | None:
        """What was begun with from a start pose (4, 4), or what the frame is begun with where the part is elsewhere."""
        # Without stored views a first frame would have to wait for them.
        if self.model.views is None:
            return started
        question = Question(frame, look, start, started.solution.cam_T_obj)
        elsewhere = second_opinion(question, self.solver, self._finder(), config, self._assessment.quality, clock)
        if elsewhere is None:
            return started
        for pose, note in ((elsewhere, "the detector finds it elsewhere"), (start, "")):
            self.solver.forget()
            self.solver.magnify(frame.camera, pose)
            seen = look(pose)
            again = None if seen is None else begin(self.solver, look, seen, config, clock)
            if again is not None:
                # Nobody gave that pose, or it was doubted: there is nothing to trust.
                return replace(again, trusted=False, measures=config.measures, note=note)
        return None

    def _elsewhere(self, frame: Frame, solution: Solution | None, clock: Stopwatch) -> Solution | None:
        """A frame solved from where second thoughts find a part that is followed; None where its solution stays."""
        pursuit, region = self._pursuit, self._pursuit.region
        best = pursuit.best_of(frame, self._whereabouts.second_thoughts(frame, solution, clock), clock)
        if (
            best is None
            or solution is None
            or not self._whereabouts.prefers(frame, best, solution, pursuit.solve, clock)
        ):
            pursuit.region = region
            return None
        return best

    def _turned(self, frame: Frame, solution: Solution | None, clock: Stopwatch) -> Turned | None:
        """A frame solved at another turn of a part that looks nearly the same there; None where its solution stays.

        solution: None where it is not asked.
        """
        checker = self._turn_checker
        if checker is None:
            return None
        if solution is None:
            checker.interrupt()
            return None
        turned = checker.other(frame, solution, clock)
        if turned is not None:
            self._pursuit.region = turned.solution.estimate.view.region
        return turned

    def _follow_camera(self, frame: Frame, step: TimeStep, clock: Stopwatch) -> None:
        """Expect the part where a camera that turned otherwise than before takes it."""
        if self._camera is None:
            return
        clock.lap()
        further, predictor = (
            self._camera.acceleration(frame, self._pursuit.predicted, step.of_last),
            self._pursuit.predictor,
        )
        # A part that rests for all that is known may as well rest beside the camera.
        if isinstance(predictor, PoseKalman) and predictor.moves and further is not None:
            predictor.accelerate(further)
        clock.image_s += clock.lap()

    def _steady(self, frame: Frame, expected: FloatArray, clock: Stopwatch) -> Frame:
        """The frame without a sudden change of light, bands of it, or much noise.

        expected: (4, 4) the pose of the part there.
        """
        clock.lap()
        if self._tones is not None:
            frame = self._tones.steady(frame, self._middle_at(frame, expected))
        if self._noise is not None:
            frame = self._noise.smoothed(frame)
        clock.image_s += clock.lap()
        return frame

    def _middle_at(self, frame: Frame, pose: FloatArray) -> Box | None:
        """The middle of the part's box at a pose (4, 4), half as wide and high: there it is mostly part."""
        box = crop_box(self._corners_obj, pose, frame.camera, 0.0)
        if box is None:
            return None
        x0, y0, x1, y1 = box
        return (3 * x0 + x1) // 4, (3 * y0 + y1) // 4, (x0 + 3 * x1) // 4, (y0 + 3 * y1) // 4

    def _learn(self, frame: Frame, solution: Solution, clock: Stopwatch, trusted: bool = False) -> None:
        clock.lap()
        knowledge, quality = self.solver.knowledge, solution.judgement.quality
        if knowledge.learns_from(quality, self._pursuit.usual.mean_quality):
            if knowledge.is_new(frame.camera, solution.cam_T_obj, quality):
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
        clock: Stopwatch,
        begin_s: float,
        note: str,
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
            timings=clock.timings(frame.undistort_s, time.perf_counter() - begin_s),
            note=note,
            steps=glass.steps(solution.steps),
            covariance=covariance,
            exactness=self._assessment.exactness(solution.cam_T_obj, covariance),
            target=glass.target(judgement.target_view) if self.records_target else None,
            sought=self._whereabouts.sought,
        )

    def _blind(
        self,
        frame: Frame | UnreadableFrame,
        predicted: FloatArray,
        pose: FloatArray,
        clock: Stopwatch,
        begin_s: float,
        note: str,
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
            timings=clock.timings(
                frame.undistort_s if isinstance(frame, Frame) else 0.0, time.perf_counter() - begin_s
            ),
            note=note,
            sought=self._whereabouts.sought,
        )

    def _project(self, camera: Camera | None, pose: FloatArray) -> FloatArray:
        if camera is None:
            return np.full((4, 2), np.nan)
        return camera.project(transform(pose, self.solver.control_points_obj[self._pursuit.region]))


def _has_truth(sequence: Sequence) -> bool:
    try:
        return bool(sequence.first_poses)
    except SequenceError:
        return False
