"""The first pose of a video: frame after frame is searched until one says enough, or two that follow each other do.

A hypothesis that one frame does not accept is accepted when the next one finds the part in the same place, moved by a
little, and both think it more likely right than not. What a frame finds by chance, from its noise, its blur or where
an edge of the part happens to cross one behind it, the next one seldom finds again.
"""

from __future__ import annotations

from acp_lab.geometry.arrays import FloatArray
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.tracking.find import Detection, Finder

LIKELY = 0.5
"""Score that the best hypothesis of each of two frames needs."""


class FirstPose:
    """Looks for one part in the frames of a video, in their order."""

    def __init__(self, finder: Finder) -> None:
        self._finder = finder
        self._before: Detection | None = None

    def look(self, frame: Frame | UnreadableFrame) -> FloatArray | None:
        """The accepted pose (4, 4) mm in a frame; None where nothing is accepted yet."""
        before, self._before = self._before, None
        if isinstance(frame, UnreadableFrame):
            return None
        self._before = next(iter(self._finder.find(frame, 1)), None)
        best = self._before
        if best is None:
            return None
        if best.is_accepted:
            return best.cam_T_obj
        if before is None or min(best.score, before.score) < LIKELY:
            return None
        return best.cam_T_obj if self._finder.is_same(best.cam_T_obj, (before.cam_T_obj,)) else None
