"""Correspondence lines: short lines across the outline, on which colours say where the part ends.

The log-odds of the pixels on a line are compared with a smoothed step at each of twelve places; the posterior over the
places has a mean, where the part ends, and a variance, how sure that is (Stoiber et al., "SRT3D", 2022, section 3).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from acp_lab.compiled import kernel
from acp_lab.geometry.arrays import BoolArray, ByteImage, Float32Array, FloatArray, IntArray, Uint16Array, writable
from acp_lab.tracking.learning.region_colours import RegionColours, colour_bin
from acp_lab.tracking.targets.step_posterior import PLACES, SEGMENTS, WINDOW, SmoothStep

_STEP = -SmoothStep().amplitude * np.tanh((np.arange(WINDOW) - 0.5 * (WINDOW - 1)) / (2.0 * SmoothStep().slope))
_OFFSETS = np.arange(PLACES, dtype=np.float64) - 0.5 * (PLACES - 1)
_MOST_LOG_ODDS = 4.0
# px on either side of the outline that are compared for the margin, and lines below which there is none.
_MARGIN_PX, _LEAST_LINES = 8, 4
# Segments over which a posterior that lies far from the line's middle stops to count.
_FADE = 1.5


class ColourCrop:
    """The colours of one frame around the part.

    pixels: (h, w, 3) uint8 RGB; origin: (x, y) px of their first one in the full image. colours: what is known of them.
    """

    def __init__(self, image: ByteImage, box: tuple[int, int, int, int], colours: RegionColours) -> None:
        """image: (h, w, 3) uint8 RGB, the whole frame; box: (x0, y0, x1, y1) px, cut to the image."""
        height, width = image.shape[:2]
        x0, y0, x1, y1 = box
        self.origin = x, y = min(max(x0, 0), width - 2), min(max(y0, 0), height - 2)
        self.pixels = writable(image[y : max(y1, y + 2), x : max(x1, x + 2)])
        self.colours = colours

    @cached_property
    def bins(self) -> Uint16Array:
        """(h, w) uint16 of its pixels, see `RegionColours.bins`; lines need only those that they pass."""
        return RegionColours.bins(self.pixels)


@dataclass(frozen=True, eq=False)
class CorrespondenceLines:
    """n lines across the outline at one estimate.

    Attributes:
        crop: the colours that they are read from.
        rows: (n,) of the edge points that are lines; ids: (n,) their samples.
        points: (n, 2) px of the full image; outward: (n, 2) unit, off the part.
        free: (2, n) px to where the part ends inwards, and begins again outwards.
        px_per_mm: (n,) scale across the outline.
    """

    crop: ColourCrop
    rows: IntArray
    ids: IntArray
    points: FloatArray
    outward: FloatArray
    free: FloatArray
    px_per_mm: FloatArray

    def __len__(self) -> int:
        return len(self.rows)

    @cached_property
    def _least_free(self) -> FloatArray:
        return np.minimum(self.free[0], self.free[1])

    @property
    def in_image(self) -> BoolArray:
        """(n,) whether a line of a px a segment lies in the image, and not partly beside it."""
        height, width, _ = self.crop.pixels.shape
        inside = np.empty(len(self), np.bool_)
        _in_image(self.points, *self.crop.origin, self.outward, width - 1.0, height - 1.0, inside)
        return inside

    def posterior(self, scale: int, fade_px: float) -> FloatArray:
        """(2, n): px from the line's middle to where the part ends, and weights in [0, 1].

        scale: px per segment; fade_px: segments from the middle beyond which a posterior counts less.
        """
        found = np.empty((2, len(self)))
        log_odds = self.crop.colours.log_odds
        _posterior(
            self.crop.pixels, log_odds, self.points, *self.crop.origin, self.outward, self._least_free, scale, fade_px,
            _STEP, _LEAST_VARIANCE, found,
        )  # fmt: skip
        return found

    def margin(self) -> float:
        """Mean probability just inside less that just outside, in [-1, 1]; 0 with fewer than four lines."""
        if len(self) < _LEAST_LINES or not self.crop.colours.is_known:
            return 0.0
        probability, free = self.crop.colours.probability, self._least_free
        return float(_margin(self.crop.pixels, probability, self.points, *self.crop.origin, self.outward, free))

    def bins_beside(self, reach_px: int) -> tuple[Uint16Array, Uint16Array]:
        """(i,) bins of pixels of the part and (o,) of its background, less than `reach_px` from the outline."""
        inwards, outwards = (
            _bins_along(self.crop.pixels, self.points, *self.crop.origin, self.outward, side, free, reach_px)
            for side, free in zip((-1.0, 1.0), np.ascontiguousarray(self.free), strict=True)
        )
        return inwards, outwards


@kernel("void(f8[:, ::1], f8, f8, f8[:, ::1], f8, f8, b1[::1])")
def _in_image(
    points: FloatArray, x0: float, y0: float, outward: FloatArray, right: float, bottom: float, inside: BoolArray
) -> None:
    """Fill inside (n,): whether all segments of lines lie from 0 to right and bottom of the crop, a px a segment.

    Here and below: points (n, 2) px of the full image, of which px (x0, y0) is the crop's first.
    """
    for i in range(len(points)):
        x, y = points[i, 0] - x0, points[i, 1] - y0
        across, along = 0.5 * SEGMENTS * abs(outward[i, 0]), 0.5 * SEGMENTS * abs(outward[i, 1])
        inside[i] = (x - across >= 0.0) & (y - along >= 0.0) & (x + across <= right) & (y + along <= bottom)


@kernel("void(u1[:, :, :], f8, f8, f8, f8, f8, i8[::1])")
def _bins_on(pixels: ByteImage, x: float, y: float, dx: float, dy: float, first: float, bins: IntArray) -> None:
    """Fill bins (n,), see `RegionColours.bins`: of the pixels at (x, y) + k (dx, dy), k from `first` on; -1 outside."""
    height, width, _ = pixels.shape
    last = first + len(bins) - 1
    low_x, high_x = min(x + first * dx, x + last * dx), max(x + first * dx, x + last * dx)
    low_y, high_y = min(y + first * dy, y + last * dy), max(y + first * dy, y + last * dy)
    if low_x >= 0.0 and high_x < width - 1 and low_y >= 0.0 and high_y < height - 1:
        for k in range(len(bins)):
            # Unsigned: no index can be meant from the end; by way of signed, for which processors have an instruction.
            px, py = x + (first + k) * dx + 0.5, y + (first + k) * dy + 0.5
            column, row = np.uint64(np.int64(px)), np.uint64(np.int64(py))
            bins[k] = colour_bin(pixels[row, column, 0], pixels[row, column, 1], pixels[row, column, 2])
    else:
        for k in range(len(bins)):
            at_x, at_y = np.floor(x + (first + k) * dx + 0.5), np.floor(y + (first + k) * dy + 0.5)
            bins[k] = -1
            if 0.0 <= at_x < width and 0.0 <= at_y < height:
                column, row = np.uint64(at_x), np.uint64(at_y)
                bins[k] = colour_bin(pixels[row, column, 0], pixels[row, column, 1], pixels[row, column, 2])


@kernel("f8(i8, f4[::1])")
def _odds_of(bin_: int, log_odds: Float32Array) -> float:
    """Log-odds of a bin; 0 where nobody sees: a part that leaves the image does not end there."""
    odds: float = log_odds[np.uint64(bin_)] if bin_ >= 0 else 0.0
    return odds


@kernel("void(u1[:, :, :], f4[::1], f8[:, ::1], f8, f8, f8[:, ::1], f8[::1], i8, f8, f8[::1], f8, f8[:, ::1])")
def _posterior(
    pixels: ByteImage, log_odds: Float32Array, points: FloatArray, x0: float, y0: float, outward: FloatArray,
    free: FloatArray, scale: int, fade: float, step: FloatArray, least_variance: float, found: FloatArray,
) -> None:  # fmt: skip
    """Fill found (2, n): the posterior's mean in px, and its weight: a clean step's variance as a share of its own."""
    segments, evidence, bins = np.empty(SEGMENTS), np.empty(PLACES), np.empty(SEGMENTS * scale, np.int64)
    first = -0.5 * (SEGMENTS * scale - 1)
    for i in range(len(points)):
        if free[i] < 2.0 * scale:
            found[0, i], found[1, i] = 0.0, 0.0
            continue
        _bins_on(pixels, points[i, 0] - x0, points[i, 1] - y0, outward[i, 0], outward[i, 1], first, bins)
        for segment in range(SEGMENTS):
            total = 0.0
            for k in range(segment * scale, (segment + 1) * scale):
                total += _odds_of(bins[k], log_odds)
            segments[segment] = min(max(total, -_MOST_LOG_ODDS), _MOST_LOG_ODDS)
        most = -np.inf
        for place in range(PLACES):
            total = 0.0
            for k in range(WINDOW):
                total += segments[np.uint64(place + k)] * step[np.uint64(k)]
            evidence[place] = total
            most = max(most, total)
        total, mean, square = 0.0, 0.0, 0.0
        for place in range(PLACES):
            probability, offset = np.exp(evidence[place] - most), place - 0.5 * (PLACES - 1)
            total += probability
            mean += probability * offset
            square += probability * offset * offset
        mean /= total
        weight = least_variance / max(square / total - mean * mean, least_variance)
        found[0, i] = scale * mean
        found[1, i] = weight * min(max(1.0 - max(abs(mean) - fade, 0.0) / _FADE, 0.0), 1.0)


@kernel("f8(u1[:, :, :], f8[::1], f8[:, ::1], f8, f8, f8[:, ::1], f8[::1])")
def _margin(
    pixels: ByteImage, probability: FloatArray, points: FloatArray, x0: float, y0: float, outward: FloatArray,
    free: FloatArray,
) -> float:  # fmt: skip
    """See `CorrespondenceLines.margin`; free: (n,) px that are free on both sides."""
    total, bins = 0.0, np.empty(2 * _MARGIN_PX + 1, np.int64)
    for i in range(len(points)):
        margin, count = 0.0, min(int(free[i]), _MARGIN_PX)
        _bins_on(pixels, points[i, 0] - x0, points[i, 1] - y0, outward[i, 0], outward[i, 1], -_MARGIN_PX, bins)
        for way in range(1, count + 1):
            within, beyond = bins[np.uint64(_MARGIN_PX - way)], bins[np.uint64(_MARGIN_PX + way)]
            inside = probability[np.uint64(within)] if within >= 0 else 0.5
            outside = probability[np.uint64(beyond)] if beyond >= 0 else 0.5
            margin += inside - outside
        total += margin / max(count, 1)
    return total / len(points)


@kernel("u2[::1](u1[:, :, :], f8[:, ::1], f8, f8, f8[:, ::1], f8, f8[::1], i8)")
def _bins_along(
    pixels: ByteImage, points: FloatArray, x0: float, y0: float, outward: FloatArray, side: float, free: FloatArray,
    reach_px: int,
) -> Uint16Array:  # fmt: skip
    """(m,) bins of the pixels at 1, 2, ... px to a side of the outline, less than `reach_px` and `free` (n,) away.

    side: 1 for outwards, -1 for inwards.
    """
    bins = np.empty(max(reach_px - 1, 0), np.int64)
    found, count = np.empty(len(points) * len(bins), np.uint16), 0
    for i in range(len(points)):
        along = bins[: min(len(bins), max(int(np.ceil(free[i])) - 1, 0))]
        x, y, dx, dy = points[i, 0] - x0, points[i, 1] - y0, side * outward[i, 0], side * outward[i, 1]
        _bins_on(pixels, x, y, dx, dy, 1.0, along)
        for seen in along:
            if seen < 0:
                break
            found[count] = seen
            count += 1
    return found[:count].copy()


def _variance_of_a_clean_step() -> float:
    """In squared segments, the least variance that a line is believed to have."""
    log_odds = np.where(np.arange(SEGMENTS) < 0.5 * SEGMENTS, 3.0, -3.0)
    evidence = np.convolve(log_odds, _STEP[::-1], mode="valid")
    probability = np.exp(evidence - evidence.max())
    probability /= probability.sum()
    return max(0.05, float(probability @ (_OFFSETS - probability @ _OFFSETS) ** 2))


_LEAST_VARIANCE = _variance_of_a_clean_step()
