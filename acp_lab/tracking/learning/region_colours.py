"""Colours of the part and of its background, kept over time: two histograms, and what a pixel's colour says.

As in region-based trackers (Prisacariu and Reid, "PWP3D", 2012; Stoiber et al., "SRT3D", 2022): 32 bins per channel,
running means over the frames, log-odds of a pixel being the part's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acp_lab.compiled import kernel
from acp_lab.errors import TrackingError
from acp_lab.geometry.arrays import ByteImage, Float32Array, IntArray, Uint16Array

_BINS = 32


@dataclass(frozen=True)
class ColourConfig:
    """How colours are learnt.

    Attributes:
        rate: share of a new frame in the running histograms.
        reach_px: how far from the outline pixels still teach.
        least_share: added to every bin's share of pixels; a colour never seen says nothing.
        certainty: a pixel is the part's with at least this probability, and at most with one less it; in (0.5, 1).
    """

    rate: float = 0.2
    reach_px: int = 20
    least_share: float = 2e-5
    certainty: float = 0.97

    def __post_init__(self) -> None:
        checks = (
            ("rate", 0.0 < self.rate <= 1.0, "a number above 0, at most 1"),
            ("reach_px", self.reach_px >= 2, "2 or more"),
            ("least_share", self.least_share > 0.0, "a number above 0"),
            ("certainty", 0.5 < self.certainty < 1.0, "a probability between 0.5 and 1"),
        )
        for name, good, wanted in checks:
            if not good:
                raise TrackingError(f"colours.{name} = {getattr(self, name):g}: give {wanted}")


class RegionColours:
    """Histograms of the part (foreground) and of what is around it (background).

    log_odds: (32768,) natural, of a pixel being the part's, by its bin; 0 where nothing is known.
    """

    def __init__(self, config: ColourConfig) -> None:
        self.config = config
        self._foreground: Float32Array | None = None
        self._background: Float32Array | None = None
        self.log_odds: Float32Array = np.zeros(_BINS**3, np.float32)

    @property
    def is_known(self) -> bool:
        """Whether anything was learnt yet."""
        return self._foreground is not None

    @staticmethod
    def bins(image: ByteImage) -> Uint16Array:
        """(h, w) uint16 bin of every pixel of an image (h, w, 3) uint8 RGB."""
        return _bins(image)

    def learn(self, inside: IntArray | Uint16Array, outside: IntArray | Uint16Array) -> None:
        """Take in the bins (n,) of pixels of the part and (m,) of its background; nothing where either is empty."""
        if not (len(inside) and len(outside)):
            return
        # float32: a pass over all bins per frame, and no count needs more.
        seen = [
            np.bincount(bins, minlength=_BINS**3).astype(np.float32) / np.float32(len(bins))
            for bins in (inside, outside)
        ]
        if self._foreground is None or self._background is None:
            self._foreground, self._background = seen[0], seen[1]
        else:
            rate = self.config.rate
            self._foreground = self._foreground + rate * (seen[0] - self._foreground)
            self._background = self._background + rate * (seen[1] - self._background)
        least, sure = np.float32(self.config.least_share), self.config.certainty
        most = np.float32(np.log(sure / (1.0 - sure)))
        # The odds of f / (f + b) are f / b.
        self.log_odds = np.clip(np.log((self._foreground + least) / (self._background + least)), -most, most)


@kernel("u2[:, ::1](u1[:, :, :])")
def _bins(image: ByteImage) -> Uint16Array:
    """In one pass: on the per-frame path."""
    height, width, _ = image.shape
    found = np.empty((height, width), np.uint16)
    for row in range(height):
        for column in range(width):
            red, green, blue = image[row, column, 0] >> 3, image[row, column, 1] >> 3, image[row, column, 2] >> 3
            found[row, column] = (red << 10) | (green << 5) | blue
    return found


def _counts(bins: IntArray | Uint16Array) -> Float32Array:
    return np.bincount(bins, minlength=_BINS**3).astype(np.float32)
