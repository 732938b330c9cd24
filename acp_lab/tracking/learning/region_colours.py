"""Colours of the part and of its background, kept over time: two histograms, and what a pixel's colour says.

As in region-based trackers (Prisacariu and Reid, "PWP3D", 2012; Stoiber et al., "SRT3D", 2022): 32 bins per channel,
running means over the frames, log-odds of a pixel being the part's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from acp_lab.compiled import kernel
from acp_lab.errors import TrackingError
from acp_lab.geometry.arrays import BoolArray, ByteImage, Float32Array, FloatArray, IntArray, Uint16Array, writable

_BINS = 32
# Shares that say nothing any more; left to fade they would become numbers that processors are slow with.
_FORGOTTEN = np.float32(1e-12)


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
            ("reach_px", 2 <= self.reach_px <= 1000, "px from 2 to 1000"),
            ("least_share", 0.0 < self.least_share <= 1.0, "a number above 0, at most 1"),
            ("certainty", 0.5 < self.certainty < 1.0, "a probability between 0.5 and 1"),
        )
        for name, good, wanted in checks:
            if not good:
                raise TrackingError(f"colours.{name} = {getattr(self, name):g}: give {wanted}")


class RegionColours:
    """Histograms of the part (foreground) and of what is around it (background).

    log_odds: (32768,) natural, of a pixel being the part's, by its bin; 0 where nothing is known. probability: the same
    as a probability.
    """

    def __init__(self, config: ColourConfig) -> None:
        self.config = config
        self._foreground: Float32Array | None = None
        self._background: Float32Array | None = None
        # Bins of all colours seen so far, the first `_count`; the others need not be gone through.
        self._is_seen, self._seen, self._count = np.zeros(_BINS**3, np.bool_), np.empty(_BINS**3, np.int64), 0
        self.log_odds: Float32Array = np.zeros(_BINS**3, np.float32)
        self.probability: FloatArray = np.full(_BINS**3, 0.5)

    @property
    def is_known(self) -> bool:
        """Whether anything was learnt yet."""
        return self._foreground is not None

    @staticmethod
    def bins(image: ByteImage) -> Uint16Array:
        """(h, w) uint16 bin of every pixel of an image (h, w, 3) uint8 RGB."""
        return _bins(writable(image))

    def learn(self, inside: IntArray | Uint16Array, outside: IntArray | Uint16Array) -> None:
        """Take in the bins (n,) of pixels of the part and (m,) of its background; nothing where either is empty."""
        if not (len(inside) and len(outside)):
            return
        rate = self.config.rate
        if self._foreground is None or self._background is None:
            self._foreground, self._background = np.zeros((2, _BINS**3), np.float32)
            rate = 1.0
        sides = [np.ascontiguousarray(bins, np.uint16) for bins in (inside, outside)]
        for bins in sides:
            self._count = _note(bins, self._is_seen, self._seen, self._count)
        seen = self._seen[: self._count]
        for histogram, bins in zip((self._foreground, self._background), sides, strict=True):
            _take_in(histogram, seen, bins, rate)
        sure = math.log(self.config.certainty / (1.0 - self.config.certainty))
        _odds(self._foreground, self._background, seen, self.config.least_share, sure, self.log_odds, self.probability)


@kernel("i8(u1, u1, u1)")
def colour_bin(red: int, green: int, blue: int) -> int:
    """The bin of a colour of three grey levels from 0 to 255: five bits of each."""
    return ((red >> 3) << 10) | ((green >> 3) << 5) | (blue >> 3)


@kernel("u2[:, ::1](u1[:, :, :])")
def _bins(image: ByteImage) -> Uint16Array:
    """In one pass: on the per-frame path."""
    height, width, _ = image.shape
    found = np.empty((height, width), np.uint16)
    for row in range(height):
        for column in range(width):
            found[row, column] = colour_bin(image[row, column, 0], image[row, column, 1], image[row, column, 2])
    return found


@kernel("i8(u2[::1], b1[::1], i8[::1], i8)")
def _note(bins: Uint16Array, is_seen: BoolArray, seen: IntArray, count: int) -> int:
    """Add those of the bins (n,) to the first `count` of `seen` that are not among them; returns how many it are."""
    for pixel in bins:
        if not is_seen[pixel]:
            is_seen[pixel], seen[count] = True, pixel
            count += 1
    return count


@kernel("void(f4[::1], i8[::1], u2[::1], f8)")
def _take_in(histogram: Float32Array, seen: IntArray, bins: Uint16Array, rate: float) -> None:
    """Move a histogram's shares, all of them in the bins `seen`, towards those of the pixels `bins` (n,)."""
    keep, added = np.float32(1.0 - rate), np.float32(rate / len(bins))
    for k in seen:
        histogram[k] *= keep
        if histogram[k] < _FORGOTTEN:
            histogram[k] = 0.0
    for pixel in bins:
        histogram[pixel] += added


@kernel("void(f4[::1], f4[::1], i8[::1], f8, f8, f4[::1], f8[::1])")
def _odds(
    foreground: Float32Array, background: Float32Array, seen: IntArray, least: float, most: float,
    log_odds: Float32Array, probability: FloatArray,
) -> None:  # fmt: skip
    """Fill both, in the bins `seen`, with the log-odds of f / (f + b), which are those of f / b, and with that."""
    highest, surest = np.float32(np.exp(most)), np.float32(most)
    sure, unsure = 1.0 / (1.0 + np.exp(-np.float64(surest))), 1.0 / (1.0 + np.exp(np.float64(surest)))
    for k in seen:
        log_odds[k], probability[k] = 0.0, 0.5
        if foreground[k] != background[k]:
            inside, outside = foreground[k] + np.float32(least), background[k] + np.float32(least)
            # Most colours are one side's alone, and need no logarithm.
            if inside >= highest * outside:
                log_odds[k], probability[k] = surest, sure
            elif outside >= highest * inside:
                log_odds[k], probability[k] = -surest, unsure
            else:
                log_odds[k] = np.log(inside / outside)
                probability[k] = 1.0 / (1.0 + np.exp(-np.float64(log_odds[k])))
