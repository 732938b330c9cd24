"""Look-alikes: other parts of the same kind around the tracked one, as in a tray, a bin or on a belt.

While the part is hidden nothing looks more like it than another such part, and the detector finds that. No look tells
the two apart, but their places do: what was there already while the part was tracked elsewhere is another one. So a
frame that fitted well is kept every now and then, with its pose. Where a lost part seems to be back in another place,
or one that fits poorly seems to be elsewhere, the kept frame is searched around there, a little in each frame. If it
shows something that fits, nearer than the part was, and nothing else is there now, then this is what it was, seen by a
camera that went on, and not the part. (Not in the paper, whose part is alone and always in sight.)
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from acp_lab.cad.part import Part
from acp_lab.detection.work import Errand, Steps, finish
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import transform
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.find import Finder, are_apart, scores_in_place
from acp_lab.tracking.way_back import SURE_FRAMES, SURE_QUALITY, Reach

AROUND = Reach(40.0, 1.3, 100.0)
"""A camera in a hand goes on while the part is hidden: as far from a place it is looked for what was there before."""
_HYPOTHESES, _LEAST_SCORE = 8, 0.2
SOLVE_WORK = 5_000.0
"""Of a frame that is solved from a pose, see `detection.work`."""
_PIXELS_PER_FRAME = 100_000
"""A frame is kept after so many of its pixels per frame: copies of large images take longer."""

Seen = Callable[[Frame, FloatArray], FloatArray | None]
"""The pose (4, 4) at which a frame shows such a part if it is solved from another one; None where nothing fits."""


class LookAlikes:
    """Of one tracked part; finder: gives the detector, when it is needed. remembered_frames: see `WayBack`."""

    def __init__(self, part: Part, remembered_frames: int, finder: Callable[[], Finder]) -> None:
        self._part, self._remembered_frames, self._finder = part, remembered_frames, finder
        self.forget()

    def forget(self) -> None:
        """Before a new track."""
        self._kept: tuple[Frame, FloatArray] | None = None
        self._good_frames = self._age = 0
        # Poses (4, 4) of other parts, where each was last taken for the tracked one; the one in question; and one that
        # turned out to be the tracked one.
        self._others: list[FloatArray] = []
        self._asked: tuple[Errand[bool], FloatArray] | None = None
        self._cleared: FloatArray | None = None

    def take_in(self, frame: Frame, cam_T_obj: FloatArray, quality: float) -> None:
        """A frame in which the part is surely at a pose (4, 4), of some quality."""
        self._good_frames = self._good_frames + 1 if quality >= SURE_QUALITY else 0
        self._asked = self._cleared = None
        if self._good_frames >= SURE_FRAMES and self._age >= frame.image[..., 0].size // _PIXELS_PER_FRAME:
            self._kept, self._age, self._others = (frame.to_keep(), cam_T_obj), 0, []

    def next_frame(self) -> None:
        """Time goes by."""
        self._age += 1

    def ask(self, frame: Frame, cam_T_obj: FloatArray, seen: Seen, budget: float) -> bool | None:
        """Whether what a frame shows at a pose (4, 4) is another part; None where that takes more frames to tell.

        budget: of work in this frame, see `detection.work`. The next frame may ask of the same part where it is then.
        """
        if self._cleared is not None and self._are_one(frame, self._cleared, cam_T_obj):
            self._cleared = cam_T_obj
            return False
        if self._asked is None or not self._are_one(frame, self._asked[1], cam_T_obj):
            self._asked = Errand(self._asking(frame.to_keep(), cam_T_obj, seen)), cam_T_obj
        errand, _ = self._asked
        errand.go_on(budget)
        if not errand.is_done:
            self._asked = errand, cam_T_obj
            return None
        self._asked, is_other = None, bool(errand.result)
        if is_other:
            self._others = [one for one in self._others if not self._are_one(frame, one, cam_T_obj)] + [cam_T_obj]
        else:
            self._cleared = cam_T_obj
        return is_other

    def is_one(self, frame: Frame, cam_T_obj: FloatArray, seen: Seen) -> bool:
        """As `ask`, now."""
        return finish(self._asking(frame, cam_T_obj, seen))

    def _asking(self, frame: Frame, cam_T_obj: FloatArray, seen: Seen) -> Steps[bool]:
        kept = self._kept
        if kept is None or self._age > self._remembered_frames or frame.camera != kept[0].camera:
            return False
        before, part_then = kept
        if self._are_one(frame, part_then, cam_T_obj):
            return False

        def is_gone(there: FloatArray) -> bool:
            now = seen(frame, there)
            return now is None or self._are_one(frame, now, cam_T_obj)

        for other in self._others:
            if self._are_one(frame, other, cam_T_obj):
                yield SOLVE_WORK
                if is_gone(other):
                    return True
        found = yield from self._finder().search(before, _HYPOTHESES, AROUND.of(cam_T_obj), 0)
        likely = zip(found, scores_in_place(self._part, before.camera, found), strict=True)
        poses = [cam_T_obj, *(one.cam_T_obj for one, score in likely if score >= _LEAST_SCORE)]
        for pose in poses:
            yield SOLVE_WORK
            then = seen(before, pose)
            if then is None or self._are_one(before, then, part_then):
                continue
            if self._apart_px(before, then, cam_T_obj) > self._apart_px(before, part_then, cam_T_obj):
                continue
            yield SOLVE_WORK
            if is_gone(then):
                return True
        return False

    def _are_one(self, frame: Frame, cam_T_obj: FloatArray, other: FloatArray) -> bool:
        return not are_apart(self._part, frame.camera, cam_T_obj, other)

    def _apart_px(self, frame: Frame, cam_T_obj: FloatArray, other: FloatArray) -> float:
        here, there = frame.camera.project(
            np.array([transform(pose, self._part.box_centre) for pose in (cam_T_obj, other)])
        )
        return float(np.linalg.norm(here - there))
