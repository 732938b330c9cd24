"""Where did the part go? From what the last frame left to the pose that fits the new one best.

What is carried from frame to frame to answer that is kept here: how the part moves, the view region it is seen from,
its control points, its last picture, and how well frames have fitted. A frame has one try from where the part is
expected; where it then fits worse than usual it has more, from elsewhere and without the picture that led the first.
"""

from __future__ import annotations

from copy import copy

from acp_lab.geometry.arrays import FloatArray
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.frame_solver import FrameSolver
from acp_lab.tracking.frame_view import Estimate, View
from acp_lab.tracking.learning.knowledge import Off
from acp_lab.tracking.motions import ControlPointVariables
from acp_lab.tracking.picture_memory import PictureMemory
from acp_lab.tracking.recovery import Situation, recover
from acp_lab.tracking.result import TrackState
from acp_lab.tracking.schedule import Level, PixelSchedule
from acp_lab.tracking.search import CLOUD_LEVELS, better, is_plausible
from acp_lab.tracking.solution import SeenFrame, Solution
from acp_lab.tracking.states import StateMachine
from acp_lab.tracking.stopwatch import Stopwatch
from acp_lab.tracking.usual_fit import UsualFit

# Share of the last score, or of the running mean where that is less, from which on a frame fits as usual.
_USUAL = 0.90
# From this share on no other place is tried.
_AS_BEFORE = 0.98
# By how much another try must score higher to be taken.
_CLEARLY = 0.03


class Pursuit:
    """Follows one part by its solver's method.

    For a track: `forget`, then `begin` with what the first frame says. For a frame: `follow`, or `best_of` for a lost
    part, perhaps `recover`; then `go_on_from` what was found, or `restart` where that is not believed.

    Attributes:
        solver: of single frames.
        predictor: how the part moves.
        region: 0..5, the view region in use.
        carried: the last frame's estimate, from which control points go on; None where they begin anew.
        usual: how well frames have fitted.
        picture_memory: the part's last picture; None where the method does not look for it.
    """

    def __init__(self, solver: FrameSolver) -> None:
        self.solver = solver
        sight = solver.method.sight
        self.picture_memory = None if isinstance(sight, Off) else PictureMemory(solver.part, sight)
        self.forget()

    def forget(self) -> None:
        """Forget the last track."""
        self.predictor = self.solver.method.prediction.predictor(self.solver.part.box_centre)
        self.region = 0
        self.carried: Estimate | None = None
        self.usual = UsualFit()
        if self.picture_memory is not None:
            self.picture_memory.forget()

    @property
    def predicted(self) -> FloatArray:
        """(4, 4) mm: the pose expected in the next frame."""
        return self.predictor.predict()

    @property
    def last(self) -> FloatArray:
        """(4, 4) mm: the pose that the next frame is predicted from."""
        return self.predictor.last

    def begin(self, solution: Solution, score: float) -> None:
        """Take in the first frame's solution; score: what that is compared with later."""
        self.restart(solution.cam_T_obj)
        self.carried = solution.estimate
        self.usual.begin(solution.judgement.quality, score)

    def restart(self, cam_T_obj: FloatArray) -> None:
        """The part rests at a pose (4, 4), for all that is known; its control points begin anew as they project."""
        self.predictor.restart(cam_T_obj)
        self.carried = None

    def turn_back(self, cam_T_obj: FloatArray) -> None:
        """What was followed is another part: the part is expected at a pose (4, 4), and that picture is forgotten."""
        self.restart(cam_T_obj)
        if self.picture_memory is not None:
            self.picture_memory.forget()

    def go_on_from(self, solution: Solution, quality: float) -> None:
        """Take in a frame's solution: the next one is predicted from it, and its control points go on."""
        self.predictor.observe(solution.cam_T_obj, quality, solution.pose_information)
        self.carried = solution.estimate

    def look(
        self,
        frame: Frame,
        prior: FloatArray,
        clock: Stopwatch,
        information: FloatArray | None = None,
        levels: tuple[Level, ...] | None = None,
    ) -> SeenFrame | None:
        """A frame around the part at a pose (4, 4), from the region in use; the others as in `FrameSolver.look`."""
        clock.lap()
        seen = self.solver.look(
            frame.image, frame.camera, prior, self.region,
            information=information, levels=levels, motion=self.predictor.motion, steps=self.predictor.steps,
        )  # fmt: skip
        clock.image_s += clock.lap()
        return seen

    def follow(self, frame: Frame, clock: Stopwatch) -> tuple[FloatArray, Solution | None]:
        """The pose where the part was expected, which its picture may have corrected, and what is found from there.

        From a sure prediction the picture is not searched, and of the levels only the last is asked, as the others find
        the way; unless the frame then fits worse than usual. Else the part's last picture corrects the prediction, and
        what all levels find is compared with what the last alone does.
        """
        schedule, short = self.solver.method.schedule, None
        if isinstance(schedule, PixelSchedule) and self.predictor.is_sure(self.solver.glass.camera(frame.camera)):
            short = self.try_from(frame, self.predicted, clock, schedule.near)
            if self.usual.reached(short, _USUAL):
                return self.predicted, short
        unsighted = copy(self.predictor)
        was_sighted = self.sight(frame, clock)
        found = better(short, self.try_from(frame, self.predicted, clock))
        if short is None:
            found = self._nearer(frame, found, clock)
        if was_sighted and not self.usual.reached(found, _USUAL):
            # The picture may have been found elsewhere: what the motion alone foretold has its try, too.
            sighted, self.predictor = self.predictor, unsighted
            by_motion_alone = self.try_from(frame, self.predicted, clock)
            if better(found, by_motion_alone) is found:
                self.predictor = sighted
            else:
                found = by_motion_alone
        if found is not None:
            self.region = found.estimate.view.region  # of several tries the last may have been from another one
        return self.predicted, found

    def recover(
        self, frame: Frame, predicted: FloatArray, first: Solution | None, clock: Stopwatch, states: StateMachine
    ) -> Solution | None:
        """The first try, or a better one from elsewhere, see `recovery`.

        first: what was found from the predicted pose (4, 4). states: whether it is lost, and a wide search due.
        """
        config, usual = self.solver.method.recovery, self.usual
        if isinstance(config, Off) or config.is_content_with(first, usual.mean_quality, usual.mean_score):
            return first
        situation = Situation(
            predicted,
            self.last,
            self.predictor.moves,
            usual.mean_quality,
            usual.mean_score,
            usual.last_score,
            states.state is TrackState.LOST,
            states.is_time_to_search(),
            self.predictor.innovation_of,
        )
        return recover(self.solver, first, lambda pose: self.look(frame, pose, clock), situation, config, clock)

    def best_of(self, frame: Frame, poses: list[FloatArray], clock: Stopwatch) -> Solution | None:
        """The best solution from proposed poses (4, 4), without regard to the prediction; its region stays in use."""
        best, region = None, self.region
        for pose in poses:
            self.region = self.solver.choose_region(pose)
            seen = self.look(frame, pose, clock)
            wide = None if seen is None else self.solver.solve(seen, seen.view.at_pose(pose), clock, CLOUD_LEVELS)
            tried = None if seen is None or wide is None else self.solver.solve(seen, wide.estimate, clock)
            if tried is not None and (best is None or tried.score > best.score):
                best, region = tried, self.region
        self.region = region
        return best

    def solve(self, frame: Frame, cam_T_obj: FloatArray, clock: Stopwatch) -> Solution | None:
        """The best solution of any frame from a pose (4, 4); the region in use stays."""
        region = self.region
        solution = self.best_of(frame, [cam_T_obj], clock)
        self.region = region
        return solution

    def try_from(
        self, frame: Frame, predicted: FloatArray, clock: Stopwatch, levels: tuple[Level, ...] | None = None
    ) -> Solution | None:
        """What is found from the predicted pose (4, 4) or the control points that were carried on.

        levels: None for the method's. None for a part that is not seen there, or at a pose that cannot follow the last.

        Chooses the view region, which stays in use.
        """
        before, self.region = self.region, self.solver.choose_region(predicted, self.region)
        seen = self.look(frame, predicted, clock, self.predictor.information(), levels)
        if seen is None:
            return None
        # Another region has another W, so I begins anew as the projection of the pose.
        start = self._carried_on(seen.view) if before == self.region else None
        solution = self.solver.solve(seen, start or seen.view.at_pose(predicted), clock, levels)
        return solution if solution and is_plausible(solution.cam_T_obj, self.last, self.solver.part) else None

    def sight(self, frame: Frame, clock: Stopwatch) -> bool:
        """Correct the prediction by where the part's last picture is in the new frame; whether that changed it."""
        if self.picture_memory is None:
            return False
        clock.lap()
        before = self.predicted
        self.picture_memory.correct(self.predictor, frame, max(1.0 / self.solver.glass.times, 1.0))
        clock.image_s += clock.lap()
        return self.predicted is not before

    def remember(self, frame: Frame, pose: FloatArray) -> None:
        """Take the part's picture at a pose (4, 4), in which the next frame looks for it."""
        if self.picture_memory is not None:
            self.picture_memory.take(frame, pose)

    def _nearer(self, frame: Frame, found: Solution | None, clock: Stopwatch) -> Solution | None:
        """What all levels found, or what the last alone finds, where that fits clearly better.

        A part that turns edge-on has several places where its outline fits; a wide level may leave the right one.
        """
        method = self.solver.method
        if not (isinstance(method.schedule, PixelSchedule) and method.prediction.weighs_images):
            return found
        if found is None or self.usual.reached(found, _AS_BEFORE):
            return found
        near = self.try_from(frame, self.predicted, clock, method.schedule.near)
        return near if near is not None and near.score > found.score + _CLEARLY else found

    def _carried_on(self, view: View) -> Estimate | None:
        """The last I, moved as the predicted motion moves it; None where the pose is what goes on."""
        variables = self.solver.method.variables
        if self.carried is None or not isinstance(variables, ControlPointVariables) or variables.carry == "pose":
            return None
        # I is in px of the camera that it was found by, and cameras may differ from frame to frame.
        ahead, behind = view.at_pose(view.prior).control_points, self.carried.view.at_pose(self.last).control_points
        near = view.prior if variables.direction == "rigid" else None  # where that direction goes on from
        return view.at_points(self.carried.control_points + ahead - behind, near)
