"""How noisy a picture is: by how much neighbouring pixels differ that smooth light would make alike.

The second difference of second differences is blind to anything that rises evenly, and of edges there are few: in the
middle of all pixels it is the sensor's doing (Immerkaer, Fast noise variance estimation, 1996, here by the median).
"""

from __future__ import annotations

import cv2
import numpy as np

from acp_lab.geometry.arrays import ByteImage

# Pixels that are asked, in whole rows; and without how many nothing is told.
_PIXELS, _LEAST_PIXELS = 40_000, 1000
# Grey levels: what is darker or brighter is cut off, and its noise with it.
_BLACK, _WHITE = 3, 252
# The median of a Gaussian's size, and the root of the sum of the filter's squares, 1 -2 1 each way.
_MEDIAN, _GAIN = 0.6745, 6.0


def noise_levels(image: ByteImage) -> float | None:
    """Standard deviation of the noise in an image's grey, grey levels.

    That of one pixel beside its neighbours: of noise that neighbours share, as after a blur, little is seen. None where
    nothing can be told: of an image of a few pixels, or one that is black or white all over.

    image: (h, w, 3) uint8 RGB.
    """
    height, width = image.shape[:2]
    if height < 3 or width < 3:
        return None
    step = max(height * width // _PIXELS, 1)
    count = (height - 3) // step + 1
    above, here, below = (_grey(image[first::step][:count]) for first in range(3))
    across = above - 2 * here + below
    difference = np.abs(across[:, :-2] - 2 * across[:, 1:-1] + across[:, 2:])
    middle = here[:, 1:-1]
    told = difference[(middle > _BLACK) & (middle < _WHITE)]
    if told.size < _LEAST_PIXELS:
        return None
    return float(np.median(told)) / (_MEDIAN * _GAIN)


def _grey(rows: ByteImage) -> np.ndarray:
    """(n, w) int16 grey of rows (n, w, 3)."""
    return cv2.cvtColor(np.ascontiguousarray(rows), cv2.COLOR_RGB2GRAY).astype(np.int16)
