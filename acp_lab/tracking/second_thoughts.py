"""Second thoughts: is a part that has fitted poorly for some frames where it is followed?

A pose may drift, in each frame a little: with the rim of a hand, say, that covers half of the part and moves with it.
Nothing about that is sudden, so no other start is tried, and at the wrong pose so much fits that the part never counts
as lost, not even when the hand is gone. So while a part fits poorly the detector looks around it, a little in each
frame, and the frame is solved from what it finds, too. That replaces the pose only where it fits better and is surely
right: half a part resembles many things.

So it does around a part that was lost and is back. Until it has found the part there, or the part has fitted well for
some frames, or a few searches have not found it there, the part is on probation, and teaches nothing: a wrong pose that
teaches how its edges look soon fits as well as the right one. (Not in the paper.)
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import rotation_angle_deg
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.find import Finder
from acp_lab.tracking.magnification import appears_px
from acp_lab.tracking.recovery import WayBack
from acp_lab.tracking.solution import Solution
from acp_lab.tracking.way_back import SURE_FRAMES, Reach, Search, moved_on

AROUND = Reach(30.0, 1.3, 60.0)
"""A pose that may have drifted, the right one is looked for."""
LEAST_SCORE = 0.1
"""Of a hypothesis that is tried: of a part half covered no hypothesis is likely."""
_TRIED = 2
_BUDGET_SHARE = 0.4
"""As a rule the part is where it is followed: its frames stay short."""
_GAIN, _SURELY_RIGHT = 0.03, 0.9
"""How much higher a proposal must score, and how probably its pose must be right, to replace another."""
_SEARCHES, _FOUND = 3, 0.5
"""Of a part on probation, at most, and the score from which on one has found it where it is followed."""


class SecondThoughts:
    """Of one tracked part; finder: gives the detector, when it is needed."""

    def __init__(self, model: PreparedPart, config: WayBack, finder: Callable[[], Finder]) -> None:
        self._part, self._config, self._finder = model.part, config, finder
        self.forget()

    def forget(self) -> None:
        """There is nothing to think of."""
        self._poor_frames = self._good_frames = self._owed = 0
        self._search: Search | None = None

    def pause(self) -> None:
        """A frame in which there is nothing to think of: no row of poor ones goes on, nor a search."""
        self._poor_frames = 0
        self._search = None

    @property
    def on_probation(self) -> bool:
        """Whether a part that was lost has yet to be found by the detector, too; see the module."""
        return self._owed > 0

    def take_in(self, quality: float, is_lost: bool) -> None:
        """How well a frame fitted; a lost part is looked for by others."""
        if is_lost:
            self.forget()
            self._owed = _SEARCHES if self._config.poor_frames > 0 else 0
        elif quality < self._config.poor_below:
            self._poor_frames, self._good_frames = self._poor_frames + 1, 0
        else:
            self._poor_frames, self._good_frames = 0, self._good_frames + 1
            if self._good_frames >= SURE_FRAMES:
                self.forget()

    def proposals(self, frame: Frame, cam_T_obj: FloatArray) -> list[FloatArray]:
        """Go on looking, if it is time, around the pose (4, 4) at which a frame was solved.

        Poses (4, 4) elsewhere to solve it from; mostly none.
        """
        if self._search is None:
            if not (self.on_probation or 0 < self._config.poor_frames <= self._poor_frames):
                return []
            around = AROUND.of(cam_T_obj, appears_px(self._part, frame.camera, cam_T_obj))
            self._search = Search(self._finder(), frame, _TRIED, around, 0)
        search = self._search
        search.go_on(_BUDGET_SHARE * self._config.budget)
        if not search.is_done or search.prior is None:
            return []
        self._search, followed = None, search.prior.cam_T_obj  # then: it has moved since
        likely = [one for one in search.result or () if one.score >= LEAST_SCORE]
        there = [one for one in likely if self._finder().is_same(one.cam_T_obj, (followed,))]
        self._owed = 0 if any(one.score >= _FOUND for one in there) else max(0, self._owed - 1)
        elsewhere = [self._unturned(one.cam_T_obj, followed) for one in likely if one not in there]
        return [now for pose in elsewhere for now in moved_on(self._part, pose, search.frame, frame)]

    def prefer(self, proposed: Solution, right: float, followed: Solution) -> bool:
        """Whether a solution from a proposal, with the probability that its pose is right, replaces the other."""
        if right < _SURELY_RIGHT or proposed.score <= followed.score + _GAIN:
            return False
        return not self._finder().is_same(proposed.cam_T_obj, (followed.cam_T_obj,))

    def _unturned(self, cam_T_obj: FloatArray, near: FloatArray) -> FloatArray:
        """Of the equal poses (4, 4) of a symmetric part the one that is turned least from another."""
        equal = cam_T_obj @ self._part.symmetries.transforms()
        nearest = min(equal, key=lambda pose: rotation_angle_deg(pose[:3, :3], near[:3, :3]))
        return np.asarray(nearest)
