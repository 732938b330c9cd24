"""Where a smoothed step lies on each correspondence line: the whole posterior, not only its mean.

Segments of `scale` pixels have a probability p of being the part's, from the log-odds of their pixels. With the step at
a place d, segment k behind it is the part's with probability h(k - d) = 1/2 - a tanh((k - d) / 2 s), so that::

    p(d)  ~  product over the segments around d of  h p + (1 - h) (1 - p)

(Stoiber et al., "SRT3D", IJCV 2022, eq. 7 to 13: a is the amplitude, global uncertainty such as a wrong colour model; s
the slope, local uncertainty of where the outline is.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acp_lab.compiled import kernel
from acp_lab.errors import TrackingError
from acp_lab.geometry.arrays import Float32Array, FloatArray, Uint16Array

PLACES, WINDOW = 12, 8
"""Places at which the step is tried, in segments about the line's middle, and segments that each looks at."""
SEGMENTS = PLACES + WINDOW - 1


@dataclass(frozen=True)
class SmoothStep:
    """amplitude: in (0, 0.5), of the step; slope: in segments, 0 for a sharp one."""

    amplitude: float = 0.43
    slope: float = 0.5

    def __post_init__(self) -> None:
        if not 0.0 < self.amplitude < 0.5:
            raise TrackingError(f"targets.step.amplitude = {self.amplitude:g}: give a number between 0 and 0.5")
        if not 0.0 <= self.slope <= 10.0:
            raise TrackingError(f"targets.step.slope = {self.slope:g}: give 0 to 10 segments")

    @property
    def values(self) -> FloatArray:
        """(8,) probability of the part along a window, from inside to outside."""
        way = np.arange(WINDOW) - 0.5 * (WINDOW - 1)
        return 0.5 - self.amplitude * np.tanh(way / (2.0 * max(self.slope, 1e-3)))

    @property
    def least_variance(self) -> float:
        """In squared segments: what a line between pure colours has, by the amplitude or by the slope."""
        return max(0.5 / np.arctanh(2.0 * self.amplitude) ** 2, self.slope)


@kernel("void(u2[:, ::1], f4[::1], f8[:, ::1], f8[:, ::1], i8, f8[::1], f8[:, ::1])")
def fill_posteriors(
    bins: Uint16Array, log_odds: Float32Array, points: FloatArray, outward: FloatArray, scale: int, step: FloatArray,
    found: FloatArray,
) -> None:  # fmt: skip
    """Fill found (n, 14): twelve log-probabilities, then mean and variance in segments, of n lines.

    bins: (h, w) colours of the crop; log_odds: by colour; points, outward: (n, 2) px of the crop, unit normals; step:
    (8,), see `SmoothStep.values`. Pixels outside the crop say nothing.
    """
    height, width = bins.shape
    inside, products = np.empty(SEGMENTS), np.empty(PLACES)
    first = -0.5 * (SEGMENTS * scale - 1)
    for i in range(len(points)):
        for segment in range(SEGMENTS):
            total = 0.0
            for k in range(segment * scale, (segment + 1) * scale):
                way = first + k
                column = int(np.floor(points[i, 0] + way * outward[i, 0] + 0.5))
                row = int(np.floor(points[i, 1] + way * outward[i, 1] + 0.5))
                if 0 <= column < width and 0 <= row < height:
                    total += log_odds[bins[row, column]]
            inside[segment] = 1.0 / (1.0 + np.exp(-total)) if total != 0.0 else 0.5
        products[:] = 1.0
        for k in range(WINDOW):  # in this order places are neighbours, and several are done at once
            behind, before = step[k], 1.0 - step[k]
            for place in range(PLACES):
                p = inside[place + k]
                products[place] *= behind * p + before * (1.0 - p)
        most = -np.inf
        for place in range(PLACES):
            found[i, place] = np.log(max(products[place], 1e-300))
            most = max(most, found[i, place])
        total, mean, square = 0.0, 0.0, 0.0
        for place in range(PLACES):
            found[i, place] -= most
            probability, offset = np.exp(found[i, place]), place - 0.5 * (PLACES - 1)
            total += probability
            mean += probability * offset
            square += probability * offset * offset
        mean /= total
        found[i, PLACES] = mean
        found[i, PLACES + 1] = square / total - mean * mean
