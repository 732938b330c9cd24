"""Does a frame show anything that the last one that taught did not?

Edges seen from one place are found beside the true ones by the same amount in every picture taken there: by
reflections, by how they are broken, by where they fall between pixels. While a part stands still, a hundred frames are
one measurement, and their mean is as wrong as each of them. Learnt a hundred times it is taken for sure: what is learnt
of the edges gives way to the pose, the pose to what is learnt, and the two walk off together
(`benchmarks/standing_still.py`). So a frame teaches where the part has moved in the image, or where it fits worse than
the last one that taught, as in light that changes.
(Not in the paper, which learns nothing while it tracks; see docs/paper-ledger.md.)
"""

from __future__ import annotations

import numpy as np

from acp_lab.cad.part import Part, box_corners
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import transform

_AS_WELL = 0.9
"""Share of the quality of the last frame that taught, below which something else than the pose has changed."""


class Novelty:
    """Of the frames of one tracked part. from_px: how far some corner of its box must have moved, 0 for nowhere."""

    def __init__(self, part: Part, from_px: float) -> None:
        self._corners_obj, self._from_px = box_corners(part), from_px
        self._corners_px: FloatArray | None = None
        self._quality = 0.0

    def is_new(self, camera: Camera, cam_T_obj: FloatArray, quality: float) -> bool:
        """Whether a solved frame teaches, by its pose (4, 4) and quality; if so, later ones are compared with it.

        The first frame does. Corners behind the camera have no place, and count as moved.
        """
        corners_px = camera.project(transform(cam_T_obj, self._corners_obj))
        if self._corners_px is not None and quality >= _AS_WELL * self._quality:
            moved_px = np.sqrt(((corners_px - self._corners_px) ** 2).sum(axis=1).max())
            if moved_px < self._from_px:
                return False
        self._corners_px, self._quality = corners_px, quality
        return True
