"""The same picture again: what a video repeats tells nothing of the motion.

Videos repeat pictures: where a camera is slower than the file that it is written to, as in dim light, where a film is
brought to another rate, where a driver fills a gap. In such a video a part stands still and leaps by turns, the
prediction is off by a whole step each time, and the prior pulls towards it. So where a frame shows around the part what
the last one did, the part is expected where it was, and the motion goes from picture to picture (`PoseKalman.repeat`).
The frame is solved like any other: compression changes a repeated picture a little, and so does a part that hardly
moves before a background that did.
(Not in the paper, which predicts no motion; see docs/paper-ledger.md.)
"""

from __future__ import annotations

from collections import deque
from statistics import median

import cv2

from acp_lab.cad.part import Part, box_corners
from acp_lab.geometry.arrays import ByteImage, FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.frame_view import crop_box

_AGAIN = 0.1
"""Share of the usual change from picture to picture below which a picture is taken for the last one."""
_PICTURES = 5
"""Over so many the usual change is the median."""
# Some rows tell as well as all, and large pictures cost no more.
_LEAST_STEP, _MOST_PIXELS = 4, 65_536


class ShownPicture:
    """The picture around one part in the last frame; margin_px: how far around."""

    def __init__(self, part: Part, margin_px: float) -> None:
        self._corners_obj, self._margin_px = box_corners(part), margin_px
        self.forget()

    def forget(self) -> None:
        """Before a new track."""
        self._kept: tuple[ByteImage, tuple[slice, slice], Camera] | None = None
        self._changes: deque[float] = deque(maxlen=_PICTURES)

    def keep(self, frame: Frame, cam_T_obj: FloatArray) -> None:
        """Of a frame in which the part is at a pose (4, 4); a copy, as whoever gave the image may write into it."""
        self._kept = None
        box = crop_box(self._corners_obj, cam_T_obj, frame.camera, self._margin_px)
        if box is not None:
            x0, y0, x1, y1 = (max(edge, 0) for edge in box)
            x1, y1 = min(x1, frame.camera.width), min(y1, frame.camera.height)
            step = max(_LEAST_STEP, (y1 - y0) * (x1 - x0) // _MOST_PIXELS)
            around = slice(y0, y1, step), slice(x0, x1)
            self._kept = frame.image[around].copy(), around, frame.camera

    def is_again_in(self, frame: Frame) -> bool:
        """Whether a frame, with the same camera, shows the picture that was kept last; asked once."""
        kept, self._kept = self._kept, None
        if kept is None or kept[-1] != frame.camera:
            return False
        picture, around, _ = kept
        contrast = max(float(cv2.meanStdDev(picture)[1].mean()), 1.0)
        # As a share of the contrast: when the lights go out a moving part changes little.
        change = cv2.norm(frame.image[around], picture, cv2.NORM_L1) / (picture.size * contrast)
        if change <= (_AGAIN * median(self._changes) if self._changes else 0.0):
            return True
        self._changes.append(change)
        return False
