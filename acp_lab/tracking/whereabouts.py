"""Is the part where it is followed? Its state, and what the detector says of it.

A lost part is looked for (`way_back`), one that is back elsewhere is doubted until a second look, and where a part has
fitted poorly for some frames the detector looks around it (`second_thoughts`).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from acp_lab.geometry.arrays import FloatArray
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.assessment import Assessment
from acp_lab.tracking.find import LateFinder
from acp_lab.tracking.learning.knowledge import Off
from acp_lab.tracking.look_alikes import LookAlikes, Seen
from acp_lab.tracking.method import Method
from acp_lab.tracking.result import TrackState
from acp_lab.tracking.second_thoughts import SecondThoughts
from acp_lab.tracking.solution import Solution
from acp_lab.tracking.sought import Sought
from acp_lab.tracking.states import StateMachine
from acp_lab.tracking.stopwatch import Stopwatch
from acp_lab.tracking.way_back import SURE_QUALITY, Reacquisition, Verdict

_BUDGET_TIMES = 2.0
"""What asking whether it is another part may cost in a frame, in that of a search: meanwhile none goes on."""

Solve = Callable[[Frame, FloatArray, Stopwatch], Solution | None]
"""What a frame is solved for from a pose (4, 4)."""


class Whereabouts:
    """Of one tracked part.

    For a track: `forget`, then `begin` with what the first frame says. For a frame: `proposals` of where a lost part
    may be, or `second_thoughts` of where else one that is followed may be; then `take_in` what was found, or `miss` it.

    Attributes:
        states: its state and how that changes.
        last_seen: (4, 4) mm, the last pose of a tracked frame.
        fits: whether the part is there by the last frame.
        may_teach: whether it is surely there by the last frame, so that how it looks may be learnt.
    """

    def __init__(self, model: PreparedPart, method: Method, assessment: Assessment, finder: LateFinder) -> None:
        self._method, self._assessment = method, assessment
        config = method.way_back
        self._way_back = None if isinstance(config, Off) else Reacquisition(model, config, finder)
        # Views that are not stored take long, which only a lost part is worth; without a probability nothing is sure.
        thinks = model.views is not None and not isinstance(method.confidence, Off)
        self._second_thoughts = None if isinstance(config, Off) or not thinks else SecondThoughts(model, config, finder)
        remembered_frames = 0 if isinstance(config, Off) or model.views is None else config.remembered_frames
        self._look_alikes = LookAlikes(model.part, remembered_frames, finder) if remembered_frames > 0 else None
        self._finder = None if isinstance(config, Off) or model.views is None else finder
        self.forget()

    def forget(self) -> None:
        """Forget the last track."""
        self.states = StateMachine(self._method.states)
        self.last_seen: FloatArray = np.eye(4)
        self.fits = self.may_teach = False
        # Whether a second look found a weak part where it is, however little of it fixes its pose.
        self._believed = False
        # Whether it is not known yet of what fits in the last frame that it is no other part.
        self._is_open = False
        if self._look_alikes is not None:
            self._look_alikes.forget()
        if self._way_back is not None:
            self._way_back.forget()
        if self._second_thoughts is not None:
            self._second_thoughts.forget()

    def next_frame(self) -> None:
        """Time goes by."""
        if self._look_alikes is not None:
            self._look_alikes.next_frame()

    def begin(self, cam_T_obj: FloatArray, quality: float) -> str:
        """Take in the first frame's pose (4, 4) and its quality; the reason where it does not begin as tracked."""
        self.last_seen = cam_T_obj
        if self._finder is not None:
            self._finder()  # before it is needed
        return self.states.begin(quality)

    @property
    def state(self) -> TrackState:
        """Of the last frame."""
        return self.states.state

    @property
    def is_lost(self) -> bool:
        """Whether it was lost in the last frame."""
        return self.states.state is TrackState.LOST

    @property
    def is_looked_for(self) -> bool:
        """Whether it is lost, and the detector looks for it."""
        return self.is_lost and self._way_back is not None

    @property
    def sought(self) -> Sought | None:
        """Where a lost part was looked for last; None where none is looked for."""
        return self._way_back.sought if self.is_lost and self._way_back is not None else None

    def proposals(self, frame: Frame, clock: Stopwatch) -> list[FloatArray]:
        """Poses (4, 4) at which the detector saw a lost part; it is not asked while the part seems to be back."""
        if self._way_back is None or not self.is_lost or self.fits:
            return []
        clock.lap()
        proposals = self._way_back.proposals(frame, self.last_seen)
        clock.search_s += clock.lap()
        return proposals

    def tried(self, solution: Solution | None) -> None:
        """Take in what proposals came to: the search goes on around there where it fits."""
        if solution is not None and self._way_back is not None and self._fits(solution):
            self._way_back.look_around(solution.cam_T_obj)

    def is_another(
        self, frame: Frame, solution: Solution | None, proposed: bool, solve: Solve, clock: Stopwatch
    ) -> bool:
        """Whether a frame of a lost part was solved for another part like it; proposed: from what the detector saw.

        solve: any frame, from a pose.
        """
        self._is_open = False
        if solution is None or self._look_alikes is None or self._way_back is None or not self._fits(solution):
            return False
        clock.lap()
        budget = _BUDGET_TIMES * self._way_back.budget
        answer = self._look_alikes.ask(frame, solution.cam_T_obj, self._seen_by(solve, clock), budget)
        clock.search_s += clock.lap()
        if answer and proposed:
            self._way_back.pass_on(frame, solution.cam_T_obj, self.last_seen)
        self._is_open = answer is None
        return answer is True

    def second_thoughts(self, frame: Frame, solution: Solution | None, clock: Stopwatch) -> list[FloatArray]:
        """Poses (4, 4) at which a part may be that is followed, but for that of a frame's solution."""
        if self._second_thoughts is None or solution is None or self.is_lost:
            return []
        if self.states.doubted:
            self._second_thoughts.pause()
            return []
        clock.lap()
        proposals = self._second_thoughts.proposals(frame, solution.cam_T_obj)
        clock.search_s += clock.lap()
        return proposals

    def prefers(self, frame: Frame, proposed: Solution, followed: Solution, solve: Solve, clock: Stopwatch) -> bool:
        """Whether what second thoughts came to replaces a frame's solution where the part was followed.

        solve: any frame, from a pose.
        """
        thoughts = self._second_thoughts
        if thoughts is None or not thoughts.prefer(proposed, self._assessment.right(proposed), followed):
            return False
        alike = self._look_alikes
        return alike is None or not alike.is_one(frame, proposed.cam_T_obj, self._seen_by(solve, clock))

    def take_in(self, frame: Frame, solution: Solution, quality: float, clock: Stopwatch) -> str:
        """A frame's solution and its quality; the reason where the state changed, else empty."""
        if self.states.may_begin_to_track(quality):
            self.states.doubted = self._doubts(frame, solution, quality)
        # Nothing is proved as long as it may be another part like it.
        note = self.states.update(min(quality, self._method.states.found_above) if self._is_open else quality)
        self.fits = self._is_found(quality)
        note = self._look_again(frame, solution, quality, clock) or note
        if self.state is TrackState.TRACKING:
            self.last_seen = solution.cam_T_obj  # a weak pose may be of something else
        self._believed &= self.state is TrackState.WEAK
        self.may_teach = not (self.is_lost or self.states.doubted)
        if self._second_thoughts is not None:
            self.may_teach &= not self._second_thoughts.on_probation
            self._second_thoughts.take_in(quality, self.is_lost)
        if self._look_alikes is not None:
            if self.may_teach:
                self._look_alikes.take_in(frame, solution.cam_T_obj, quality)
            else:
                self._look_alikes.doubt()
        return note

    def miss(self) -> str:
        """A frame in which nothing was seen; the reason where the state changed, else empty."""
        self.fits = self.may_teach = False
        if self._second_thoughts is not None:
            self._second_thoughts.pause()
        if self._look_alikes is not None:
            self._look_alikes.doubt()
        return self.states.update(0.0)

    def _is_found(self, quality: float) -> bool:
        return quality > self._method.states.found_above

    def _fits(self, solution: Solution) -> bool:
        return self._is_found(self._assessment.quality(solution))

    def _seen_by(self, solve: Solve, clock: Stopwatch) -> Seen:
        def seen(frame: Frame, cam_T_obj: FloatArray) -> FloatArray | None:
            solution = solve(frame, cam_T_obj, clock)
            return None if solution is None or not self._fits(solution) else solution.cam_T_obj

        return seen

    def _doubts(self, frame: Frame, solution: Solution, quality: float) -> bool:
        """Whether a part that was lost or weak needs a second look: it is elsewhere, or what is seen fixes no pose."""
        if self._way_back is None:
            return False
        if not self._believed and not self._assessment.is_exact(solution):
            return True  # a cable looks like a plate edge-on, but it may lie anywhere along itself
        return self._way_back.doubts(frame, solution.cam_T_obj, quality, self.last_seen)

    def _look_again(self, frame: Frame, solution: Solution, quality: float, clock: Stopwatch) -> str:
        """Whether a part that came back elsewhere is it; the reason when the state changed."""
        if self._way_back is None or self.is_lost:
            return ""
        if not self.states.doubted:
            self._way_back.forget()
            return ""
        clock.lap()
        is_sure = quality >= SURE_QUALITY and self._assessment.is_exact(solution)
        verdict = self._way_back.second_look(frame, solution.cam_T_obj, self.last_seen, is_sure)
        clock.search_s += clock.lap()
        if verdict is Verdict.WRONG:
            self.fits = False
            return self.states.lose("a second look found it elsewhere")
        if verdict is Verdict.RIGHT:
            self.states.doubted, self.last_seen, self._believed = False, solution.cam_T_obj, True
        return ""
