"""Sudden changes of light: a frame is seen in the tones of the frame before it, and its own come back slowly.

What a tracker remembers of a part's edges and colours follows slow changes. When a lamp is switched or the camera
changes its exposure, everything changes at once, the scene around the part too, and that tells the two apart from
a part that moved: one curve per colour channel, from the new grey values to those before, explains most of the
change. Curves by histogram matching: Gonzalez and Woods, Digital Image Processing, section 3.3.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import cv2
import numpy as np

from acp_lab.compiled import kernel
from acp_lab.errors import TrackingError
from acp_lab.geometry.arrays import ByteImage, FloatArray, IntArray, writable
from acp_lab.geometry.middle import counted_percentiles
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.bands import Bands
from acp_lab.tracking.frame_view import Box

_PIXELS = 5000
"""Of a frame that are compared."""
_RANKS = np.linspace(0.0, 100.0, 65)
_GREYS = np.arange(256.0)


@dataclass(frozen=True)
class ToneMatching:
    """Configuration: when a change of light is sudden, and how fast its correction fades.

    Attributes:
        least: grey levels by which pixels must have changed in the mean.
        unexplained: share of that change which curves may leave.
        of_constant: share of what one grey value per channel would leave, which curves may leave.
        keep: share of the correction that is kept from frame to frame.
        band_least: standard deviation, over rows, of the change in log brightness from which on light comes in bands,
            see `bands`.
        band_unexplained: share of the change of all pixels that these may leave.
    """

    kind: ClassVar[str] = "matched"
    least: float = 6.0
    unexplained: float = 0.5
    of_constant: float = 0.9
    keep: float = 0.85
    band_least: float = 0.02
    band_unexplained: float = 0.6

    def __post_init__(self) -> None:
        if not self.least > 0.0:
            raise TrackingError(f"tones.least = {self.least:g}: give grey levels above 0")
        if not self.band_least > 0.0:
            raise TrackingError(f"tones.band_least = {self.band_least:g}: give a number above 0, such as 100 for never")
        for name in ("unexplained", "of_constant", "keep", "band_unexplained"):
            if not 0.0 <= getattr(self, name) < 1.0:
                raise TrackingError(f"tones.{name} = {getattr(self, name):g}: give 0 to below 1")


class Tones:
    """The tones in which the frames of one track are seen."""

    def __init__(self, config: ToneMatching) -> None:
        self.config = config
        self._bands = Bands(config.band_least, config.band_unexplained, config.keep)
        self.forget()

    def forget(self) -> None:
        """Before a new track."""
        self._bands.forget()
        self._before: _Sample | None = None
        self._curves: FloatArray | None = None

    def preview(self, frame: Frame, around: Box | None = None) -> Frame:
        """What `steady` would give next; changes nothing."""
        kept = self._before, self._curves, self._bands.before
        seen = self.steady(frame, around)
        self._before, self._curves, self._bands.before = kept
        return seen

    def steady(self, frame: Frame, around: Box | None = None) -> Frame:
        """The frame in the tones before a sudden change of light, and without bands of it, or as it is.

        around: (x0, y0, x1, y1) px, where the part is expected; see `Bands.steady`.
        """
        frame = self._bands.steady(frame, around)
        now = _some_pixels(frame.image)
        before, self._before = self._before, now
        if self._curves is not None:
            self._curves = _GREYS + self.config.keep * (self._curves - _GREYS)
        if before is not None and before.pixels.shape == now.pixels.shape:
            change = self._sudden_change(before, now)
            if change is not None:
                self._curves = change if self._curves is None else _composed(self._curves, change)
        if self._curves is None or np.abs(self._curves - _GREYS).max() < 1.0:
            self._curves = None
            return frame
        table = np.rint(self._curves).clip(0, 255).astype(np.uint8).T[None]
        return replace(frame, image=np.asarray(cv2.LUT(frame.image, table), np.uint8))

    def _sudden_change(self, before: _Sample, now: _Sample) -> FloatArray | None:
        """(3, 256) from grey values now to those before; None where the light did not change suddenly."""
        change = float(_mean_difference(before.pixels, now.pixels))
        if change < self.config.least:
            return None
        # What is left is at least the change less what separates the histograms, which is quickly known.
        apart = float(_mean_distance(before.counts, now.counts))
        if change - apart >= self.config.unexplained * change:
            return None
        curves = np.stack([_matched(b, n) for b, n in zip(before.counts, now.counts, strict=True)])
        pairs = zip(curves, before.pixels.T, now.pixels.T, strict=True)
        left = float(np.mean([np.abs(curve[n] - b).mean() for curve, b, n in pairs]))
        # A constant explains a frame that is all the same, or wholly another: that says nothing of the light.
        by_constant = float(np.mean([_spread(b) for b in before.counts]))
        return curves if left < min(self.config.unexplained * change, self.config.of_constant * by_constant) else None


@dataclass(frozen=True, eq=False)
class _Sample:
    """pixels: (n, 3) of a frame, on a grid."""

    pixels: ByteImage

    @cached_property
    def counts(self) -> IntArray:
        """(3, 256) of them, by channel and grey value; only a large change asks for it."""
        counts = np.zeros((3, 256), np.int64)
        _count(self.pixels, counts)
        return counts


def _some_pixels(image: ByteImage) -> _Sample:
    step = max(1, round(math.sqrt(image.shape[0] * image.shape[1] / _PIXELS)))
    grid = writable(image[step // 2 :: step, step // 2 :: step])
    pixels = np.empty((grid.shape[0] * grid.shape[1], 3), np.uint8)
    _copy(grid, pixels)
    return _Sample(pixels)


@kernel("void(u1[:, :, :], u1[:, ::1])")
def _copy(grid: ByteImage, pixels: ByteImage) -> None:
    """Fill pixels (n, 3), row by row, with those of an image (h, w, 3)."""
    height, width, _ = grid.shape
    for row in range(height):
        for column in range(width):
            for channel in range(3):
                pixels[row * width + column, channel] = grid[row, column, channel]


@kernel("void(u1[:, ::1], i8[:, ::1])")
def _count(pixels: ByteImage, counts: IntArray) -> None:
    """Fill counts (3, 256), zeros before, with the grey values of pixels (n, 3)."""
    for k in range(len(pixels)):
        for channel in range(3):
            counts[channel, pixels[k, channel]] += 1


@kernel("f8(u1[:, ::1], u1[:, ::1])")
def _mean_difference(before: ByteImage, now: ByteImage) -> float:
    """Mean absolute difference of grey levels; both (n, 3)."""
    total = np.int64(0)
    one, other = before.reshape(-1), now.reshape(-1)
    for k in range(len(one)):
        total += abs(np.int64(other[k]) - np.int64(one[k]))
    return float(total) / now.size


@kernel("f8(i8[:, ::1], i8[:, ::1])")
def _mean_distance(before: IntArray, now: IntArray) -> float:
    """By how many grey levels, in the mean, pixels of one histogram have to move to make it another; both (3, 256)."""
    apart = 0.0
    for channel in range(3):
        ahead, moved, count = 0, 0, 0
        for grey in range(256):
            ahead += before[channel, grey] - now[channel, grey]
            moved += abs(ahead)
            count += now[channel, grey]
        apart += moved / count
    return apart / 3.0


def _spread(counts: IntArray) -> float:
    """Mean distance of counted pixels from their median."""
    return float(counts @ np.abs(_GREYS - counted_percentiles(counts, np.array([50.0])))) / float(counts.sum())


def _matched(before: IntArray, now: IntArray) -> FloatArray:
    """(256,) the curve that gives the pixels now the histogram of those before; both counted by grey value."""
    wanted, given = counted_percentiles(before, _RANKS), counted_percentiles(now, _RANKS)
    greys, rank = np.unique(given, return_inverse=True)
    mean = np.bincount(rank, wanted) / np.bincount(rank)
    return np.asarray(np.interp(_GREYS, greys, mean))


def _composed(curves: FloatArray, change: FloatArray) -> FloatArray:
    """(3, 256) the change, then the curves; both (3, 256)."""
    return np.stack([np.interp(greys, _GREYS, curve) for greys, curve in zip(change, curves, strict=True)])
