"""A frame as the tracker sees it: without sudden changes of light, bands of it, or much noise.

See `tones` and `denoising`. (Not in the paper.)
"""

from __future__ import annotations

from acp_lab.cad.part import Part, box_corners
from acp_lab.geometry.arrays import FloatArray
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.denoising import NoiseFilter
from acp_lab.tracking.frame_view import Box, crop_box
from acp_lab.tracking.learning.knowledge import Off
from acp_lab.tracking.method import Method
from acp_lab.tracking.tones import Tones


class SteadyPictures:
    """Of the frames of one tracked part, by its method's `tones` and `denoising`."""

    def __init__(self, part: Part, method: Method) -> None:
        self._corners_obj = box_corners(part)
        self._tones = None if isinstance(method.tones, Off) else Tones(method.tones)
        self._noise = None if isinstance(method.denoising, Off) else NoiseFilter(method.denoising)

    def forget(self) -> None:
        """Before a new track."""
        if self._tones is not None:
            self._tones.forget()
        if self._noise is not None:
            self._noise.forget()

    def steady(self, frame: Frame, expected: FloatArray) -> Frame:
        """The next frame as it is to be seen; expected: (4, 4) the pose of the part there."""
        if self._tones is not None:
            frame = self._tones.steady(frame, self._middle_at(frame, expected))
        if self._noise is not None:
            frame = self._noise.smoothed(frame)
        return frame

    def preview(self, frame: Frame, expected: FloatArray) -> Frame:
        """What `steady` would give for a frame after the last, but for its own noise; changes nothing."""
        if self._tones is not None:
            frame = self._tones.preview(frame, self._middle_at(frame, expected))
        if self._noise is not None:
            frame = self._noise.preview(frame)
        return frame

    def _middle_at(self, frame: Frame, pose: FloatArray) -> Box | None:
        """The middle of the part's box at a pose (4, 4), half as wide and high: there it is mostly part."""
        box = crop_box(self._corners_obj, pose, frame.camera, 0.0)
        if box is None:
            return None
        x0, y0, x1, y1 = box
        return (3 * x0 + x1) // 4, (3 * y0 + y1) // 4, (x0 + 3 * x1) // 4, (y0 + 3 * y1) // 4
