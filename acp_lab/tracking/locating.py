"""Where is the part in this frame? Followed from where it was expected, seen elsewhere by the detector, or turned.

How it is followed is in `pursuit`, where a lost part may be, and where else one that is followed, in `whereabouts`, by
which tooth a wheel is turned in `turned`.
"""

from __future__ import annotations

from dataclasses import dataclass

from acp_lab.geometry.arrays import FloatArray
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.pursuit import Pursuit
from acp_lab.tracking.solution import Solution
from acp_lab.tracking.stopwatch import Stopwatch
from acp_lab.tracking.turned import TURNED, TurnChecker
from acp_lab.tracking.whereabouts import Whereabouts


@dataclass(frozen=True, eq=False)
class Located:
    """A frame's solution.

    Attributes:
        predicted: (4, 4) mm, where the part was expected.
        solution: None where it is not seen.
        region_at: (4, 4) mm, the pose at which the view region was chosen.
        is_leap: it may have been there all along, so that nothing is known of how it moves.
        note: what is said of it; empty where it was followed.
    """

    predicted: FloatArray
    solution: Solution | None
    region_at: FloatArray
    is_leap: bool = False
    note: str = ""


class Locator:
    """Of one tracked part."""

    def __init__(self, pursuit: Pursuit, whereabouts: Whereabouts, turn_checker: TurnChecker) -> None:
        self._pursuit, self._whereabouts, self._turn_checker = pursuit, whereabouts, turn_checker

    def locate(self, frame: Frame, is_repeated: bool, clock: Stopwatch) -> Located:
        """A frame; is_repeated: it shows the last one's picture again, which says nothing new."""
        pursuit, whereabouts = self._pursuit, self._whereabouts
        proposals = whereabouts.proposals(frame, clock)
        located = self._proposed(frame, proposals, clock) if proposals else self._followed(frame, clock)
        solution = located.solution
        if whereabouts.is_looked_for:
            self._turn_checker.interrupt()
            if whereabouts.is_another(frame, solution, bool(proposals), pursuit.solve, clock):
                pursuit.turn_back(whereabouts.last_seen)
                return Located(located.predicted, None, located.region_at)
            return located
        elsewhere = self._elsewhere(frame, located, clock)
        if elsewhere is not None or solution is None:
            self._turn_checker.interrupt()
            return elsewhere or located
        return located if is_repeated else self._turned(frame, located.predicted, solution, clock) or located

    def _proposed(self, frame: Frame, proposals: list[FloatArray], clock: Stopwatch) -> Located:
        """A lost part, from poses (4, 4) at which the detector saw it."""
        predicted, solution = self._pursuit.predicted, self._pursuit.best_of(frame, proposals, clock)
        self._whereabouts.tried(solution)
        return Located(predicted, solution, predicted if solution is None else solution.cam_T_obj)

    def _followed(self, frame: Frame, clock: Stopwatch) -> Located:
        predicted, solution = self._pursuit.follow(frame, clock)
        if not self._whereabouts.is_looked_for:
            solution = self._pursuit.recover(frame, predicted, solution, clock, self._whereabouts.states)
        return Located(predicted, solution, predicted)

    def _elsewhere(self, frame: Frame, followed: Located, clock: Stopwatch) -> Located | None:
        """Where second thoughts find a part that is followed; None where it stays where it is."""
        pursuit, whereabouts, solution = self._pursuit, self._whereabouts, followed.solution
        region = pursuit.region
        best = pursuit.best_of(frame, whereabouts.second_thoughts(frame, solution, clock), clock)
        if best is None or solution is None or not whereabouts.prefers(frame, best, solution, pursuit.solve, clock):
            pursuit.region = region
            return None
        return Located(followed.predicted, best, best.cam_T_obj, True, "the detector finds it elsewhere")

    def _turned(self, frame: Frame, predicted: FloatArray, solution: Solution, clock: Stopwatch) -> Located | None:
        """At another turn of a part that looks nearly the same there; None where its solution stays."""
        turned = self._turn_checker.other(frame, solution, clock)
        if turned is None:
            return None
        self._pursuit.region = turned.solution.estimate.view.region
        return Located(predicted, turned.solution, turned.solution.cam_T_obj, turned.is_leap, TURNED)
