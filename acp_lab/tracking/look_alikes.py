"""Look-alikes: other parts of the same kind around the tracked one, as in a tray, a bin or on a belt.

While the part is hidden nothing looks more like it than another such part, and the detector finds that. No look tells
the two apart, but their places do: what was there already while the part was tracked elsewhere is another one. So a
frame that fitted well is kept every now and then, with its pose. Where a lost part seems to be back in another place,
or one that is followed seems to be elsewhere, the kept frame is solved from there and searched around it. If it shows
something that fits, nearer than the part was, and nothing else is there now, then this is what it was, seen by a camera
that went on, and not the part. (Not in the paper.)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from acp_lab.cad.part import Part
from acp_lab.detection.work import Errand, Steps, finish
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import transform
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.find import Finder, are_apart, scores_in_place
from acp_lab.tracking.magnification import appears_px
from acp_lab.tracking.way_back import SURE_FRAMES, SURE_QUALITY, Reach

AROUND = Reach(40.0, 1.3, 100.0)
"""A camera in a hand goes on while the part is hidden: as far from a place it is looked for what was there before."""
SOLVE_WORK = 8_000.0
"""Of a frame that is solved from a pose, see `detection.work`."""
_HYPOTHESES, _LEAST_SCORE = 8, 0.2
_MOST_FRAMES = 10
"""That a question may take; then it is the part, for all that is known."""
_KNOWN_FRAMES = 30
"""For so many frames nobody asks again of another part: what it was told by may have been covered then."""
_PIXELS_PER_FRAME = 100_000
"""A frame is kept after so many of its pixels per frame: copies of large images take longer."""

Seen = Callable[[Frame, FloatArray], FloatArray | None]
"""The pose (4, 4) at which a frame shows such a part if it is solved from another one; None where nothing fits."""

_Kept = tuple[Frame, FloatArray]
"""A frame, and the part's pose (4, 4) in it."""


@dataclass(frozen=True, eq=False)
class _Other:
    """Another part: where it was last taken for the tracked one, (4, 4), and when that was asked."""

    cam_T_obj: FloatArray
    asked_at: int


class LookAlikes:
    """Of one tracked part; finder: gives the detector, when it is needed. remembered_frames: see `WayBack`."""

    def __init__(self, part: Part, remembered_frames: int, finder: Callable[[], Finder]) -> None:
        self._part, self._remembered_frames, self._finder = part, remembered_frames, finder
        self.forget()

    def forget(self) -> None:
        """Before a new track."""
        self._kept: _Kept | None = None
        # Counted in frames: now, and when the part was last surely there, a frame was kept, and somebody asked.
        self._time = self._there_at = self._kept_at = 0
        self._asked_at = self._began_at = -1
        self._good_frames = 0
        self._others: tuple[_Other, ...] = ()
        self._question: Errand[bool] | None = None
        self._is_cleared = False

    def next_frame(self) -> None:
        """Time goes by."""
        self._time += 1

    def take_in(self, frame: Frame, cam_T_obj: FloatArray, quality: float) -> None:
        """A frame in which the part is surely at a pose (4, 4), of some quality."""
        self._good_frames = self._good_frames + 1 if quality >= SURE_QUALITY else 0
        self._there_at = self._time
        since = self._time - self._kept_at
        if self._good_frames >= SURE_FRAMES and since >= frame.image[..., 0].size // _PIXELS_PER_FRAME:
            self._kept, self._kept_at = (self._copy_of(frame), cam_T_obj), self._time

    def doubt(self) -> None:
        """A frame in which the part is not surely where it is followed, or not seen."""
        self._good_frames = 0

    def ask(self, frame: Frame, cam_T_obj: FloatArray, seen: Seen, budget: float) -> bool | None:
        """Whether what a frame shows at a pose (4, 4) is another part; None where that takes more frames to tell.

        budget: of work in this frame, see `detection.work`. Whoever asks in the next frame, too, asks of the same part.
        """
        if self._asked_at != self._time - 1:
            self._question, self._is_cleared = None, False
        self._asked_at = self._time
        kept = self._kept_of(frame, cam_T_obj)
        if self._is_cleared or kept is None:
            return False
        if self._is_known(frame, cam_T_obj):
            return True
        question = self._question
        if question is None:
            question, self._began_at = Errand(self._asking(kept, frame.to_keep(), cam_T_obj, seen)), self._time
        self._question = None
        question.go_on(budget)
        if not question.is_done and self._time - self._began_at < _MOST_FRAMES:
            self._question = question
            return None
        if question.result:
            self._others = (*self._others, _Other(cam_T_obj, self._time))
        self._is_cleared = not question.result
        return bool(question.result)

    def is_one(self, frame: Frame, cam_T_obj: FloatArray, seen: Seen) -> bool:
        """As `ask`, whatever it costs: for a frame in which it decides about a pose once in a while."""
        kept = self._kept_of(frame, cam_T_obj)
        if kept is None:
            return False
        if self._is_known(frame, cam_T_obj):
            return True
        is_one = finish(self._asking(kept, frame, cam_T_obj, seen))
        if is_one:
            self._others = (*self._others, _Other(cam_T_obj, self._time))
        return is_one

    def _kept_of(self, frame: Frame, cam_T_obj: FloatArray) -> _Kept | None:
        """The kept frame, and the part's pose (4, 4) in it; None where they tell nothing of another pose (4, 4)."""
        if self._kept is None or self._time - self._there_at > self._remembered_frames:
            return None
        before, part_then = self._kept
        is_comparable = frame.camera == before.camera and not self._are_one(frame, part_then, cam_T_obj)
        return self._kept if is_comparable else None

    def _is_known(self, frame: Frame, cam_T_obj: FloatArray) -> bool:
        """Whether another part was there a moment ago; it is followed."""
        self._others = tuple(one for one in self._others if self._time - one.asked_at <= _KNOWN_FRAMES)
        known = [one for one in self._others if self._are_one(frame, one.cam_T_obj, cam_T_obj)]
        if known:
            rest = (one for one in self._others if one not in known)
            self._others = (*rest, replace(known[0], cam_T_obj=cam_T_obj))
        return bool(known)

    def _asking(self, kept: _Kept, frame: Frame, cam_T_obj: FloatArray, seen: Seen) -> Steps[bool]:
        if (yield from self._trying(kept, frame, cam_T_obj, cam_T_obj, seen)):
            return True
        before, _ = kept
        around = AROUND.of(cam_T_obj, appears_px(self._part, frame.camera, cam_T_obj))
        found = yield from self._finder().search(before, _HYPOTHESES, around, 0)
        for one, score in zip(found, scores_in_place(self._part, before.camera, found), strict=True):
            if score >= _LEAST_SCORE and (yield from self._trying(kept, frame, cam_T_obj, one.cam_T_obj, seen)):
                return True
        return False

    def _trying(self, kept: _Kept, frame: Frame, cam_T_obj: FloatArray, there: FloatArray, seen: Seen) -> Steps[bool]:
        """Whether what the kept frame shows at a pose `there` (4, 4) is what this one shows at another pose (4, 4)."""
        before, part_then = kept
        yield SOLVE_WORK
        then = seen(before, there)
        if then is None or self._are_one(before, then, part_then):
            return False
        if self._apart_px(before, then, cam_T_obj) > self._apart_px(before, part_then, cam_T_obj):
            return False  # the part is the nearer one to have come here
        yield SOLVE_WORK
        now = seen(frame, then)
        return now is None or self._are_one(frame, now, cam_T_obj)

    def _copy_of(self, frame: Frame) -> Frame:
        """A frame with an image of its own: that of the one that was kept before, as new memory takes far longer."""
        if self._kept is None or self._kept[0].image.shape != frame.image.shape:
            return frame.to_keep()
        image = self._kept[0].image
        np.copyto(image, frame.image)
        return replace(frame, image=image)

    def _are_one(self, frame: Frame, cam_T_obj: FloatArray, other: FloatArray) -> bool:
        return not are_apart(self._part, frame.camera, cam_T_obj, other)

    def _apart_px(self, frame: Frame, cam_T_obj: FloatArray, other: FloatArray) -> float:
        here, there = frame.camera.project(
            np.array([transform(pose, self._part.box_centre) for pose in (cam_T_obj, other)])
        )
        return float(np.linalg.norm(here - there))
