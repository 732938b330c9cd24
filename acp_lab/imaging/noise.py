"""How noisy a picture is: by how much neighbouring pixels differ that smooth light would make alike.

The second difference of second differences is blind to anything that rises evenly, and of edges there are few: in the
middle of all pixels it is the sensor's doing (Immerkaer, Fast noise variance estimation, 1996, here by the median).
"""

from __future__ import annotations

import cv2
import numpy as np

from acp_lab.compiled import kernel
from acp_lab.geometry.arrays import ByteImage, IntArray
from acp_lab.geometry.middle import counted_percentiles

# Pixels that are asked, in whole rows; and without how many nothing is told.
_PIXELS, _LEAST_PIXELS = 40_000, 1000
# Grey levels: what is darker or brighter is cut off, and its noise with it.
_BLACK, _WHITE = 3, 252
# The median of a Gaussian's size, and the root of the sum of the filter's squares, 1 -2 1 each way.
_MEDIAN, _GAIN = 0.6745, 6.0
_HALF = np.array([50.0])
# What the filter makes of white beside black at most: its positive weights add up to 8.
_MOST_DIFFERENCE = 8 * 255


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
    counts = np.zeros(_MOST_DIFFERENCE + 1, np.int64)
    _count_differences(above, here, below, counts)
    if counts.sum() < _LEAST_PIXELS:
        return None
    return float(counted_percentiles(counts, _HALF)[0]) / (_MEDIAN * _GAIN)


def _grey(rows: ByteImage) -> ByteImage:
    """(n, w) grey of rows (n, w, 3)."""
    return np.asarray(cv2.cvtColor(np.ascontiguousarray(rows), cv2.COLOR_RGB2GRAY), np.uint8)


@kernel("void(u1[:, ::1], u1[:, ::1], u1[:, ::1], i8[::1])")
def _count_differences(above: ByteImage, here: ByteImage, below: ByteImage, counts: IntArray) -> None:
    """Add to counts (k,) how often the second difference of second differences is as large.

    above, here, below: (n, w) rows one after another, of which those in the middle are not cut off.
    """
    rows, columns = here.shape
    for i in range(rows):
        before = np.int64(above[i, 0]) - 2 * np.int64(here[i, 0]) + np.int64(below[i, 0])
        middle = np.int64(above[i, 1]) - 2 * np.int64(here[i, 1]) + np.int64(below[i, 1])
        for k in range(1, columns - 1):
            after = np.int64(above[i, k + 1]) - 2 * np.int64(here[i, k + 1]) + np.int64(below[i, k + 1])
            if _BLACK < here[i, k] < _WHITE:
                counts[abs(before - 2 * middle + after)] += 1
            before, middle = middle, after
