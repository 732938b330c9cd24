"""How much of an image do a part's edges explain?

Agreement asks whether the image has an edge where the part has one. A pose that turns away what the image shows, the
side of a plate, a step, a lug, has fewer edges to find and can agree better than the true one. So the question is put
the other way round as well: how many of the image's edges does the part have? Here each of them counts once, also where
several edges of the part lie near it. The paper's loss goes one way alone (eq. 6, from the generated edges to the
image); its Fig. 7b, opposite poses with one outer contour, is where that matters (`studies.distinction`).
"""

from __future__ import annotations

import cv2
import numpy as np

from acp_lab.geometry.arrays import ByteImage, FloatArray
from acp_lab.imaging.canny import Thresholds, canny_at
from acp_lab.tracking.frame_view import Box

# Also faint ones, such as a dark side before a dark ground has; noise is explained by all poses about alike.
_FAINT = Thresholds(10.0, 30.0)
# An image edge belongs to an edge point up to one px away, diagonals too.
_BESIDE = np.ones((3, 3), np.uint8)


class ImageEdges:
    """The edge pixels of an image inside a box."""

    def __init__(self, image: ByteImage, box: Box) -> None:
        """image: (h, w, 3) RGB; box: px of it, may reach beyond."""
        height, width = image.shape[:2]
        x0, y0, x1, y1 = max(box[0], 0), max(box[1], 0), min(box[2], width), min(box[3], height)
        self._corner = np.array([x0, y0], np.float64)
        self._edges = canny_at(image[y0:y1, x0:x1], _FAINT)

    def explained(self, points: FloatArray) -> int:
        """How many edge pixels lie at or beside points (n, 2) px of a part's edges."""
        height, width = self._edges.shape
        columns, rows = np.rint(points - self._corner).T
        inside = (columns >= 0) & (rows >= 0) & (columns < width) & (rows < height)
        drawn = np.zeros((height, width), np.uint8)
        drawn[rows[inside].astype(np.intp), columns[inside].astype(np.intp)] = 1
        return int(np.count_nonzero(self._edges & (cv2.dilate(drawn, _BESIDE) > 0)))
