"""Bands of light: lamps flicker with the mains, and a camera that reads its rows one after another shows that as bands.

Then rows are brighter and darker by turns, and elsewhere in every frame, so that no edge looks as it did a frame ago.
Most of a picture stays where it is, or moves little: what the middle of a row's pixels say of how much brighter it is
than in the frame before is the lamp's doing where it explains most of the change, also that of the part itself, which
a ground of stripes that goes by does not. A frame is then seen in the light of the one before, row by row, but for a
share, so that light that has changed for good comes through. (Not in the paper; see docs/paper-ledger.md.)
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from acp_lab.compiled import kernel
from acp_lab.geometry.arrays import BoolArray, ByteImage, FloatArray, writable
from acp_lab.geometry.middle import median
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.frame_view import Box

_ROWS, _COLUMNS = 64, 80
"""Of a frame that are compared."""
# Of rows that are compared: bands are wider.
_SMOOTH_ROWS = 2.0
# Grey levels: what is darker or brighter than these is cut off; and what noise is small beside.
_BLACK, _WHITE, _DARK = 8, 247, 4.0
# Pixels of a row that are not cut off, and share of such rows, without which nothing is told.
_LEAST_PIXELS, _LEAST_ROWS = 8, 0.5
# Share of the change around the part that rows may leave: it moves, but not so that they would make that more.
_LEFT_ON_PART = 0.9


@dataclass(frozen=True, eq=False)
class _Rows:
    """grid: (r, c, 3) some pixels of a frame; means: (r,) of each row; taken: (r,) log brightness taken off since."""

    grid: ByteImage
    means: FloatArray
    taken: FloatArray


class Bands:
    """The light in which the rows of one track's frames are seen.

    least: standard deviation over the rows of their change in log brightness, from which on it is a band;
    unexplained: share of the change of all pixels that the rows' may leave; keep: share of a row's change that is taken
    off.
    """

    def __init__(self, least: float, unexplained: float, keep: float) -> None:
        self._least, self._unexplained, self._keep = least, unexplained, keep
        self.before: _Rows | None = None

    def forget(self) -> None:
        """Before a new track."""
        self.before = None

    def steady(self, frame: Frame, around: Box | None = None) -> Frame:
        """The frame in the light of the one before where that came in bands, or as it is.

        around: (x0, y0, x1, y1) px, where the part is expected, with as little ground as may be: what a ground that
            goes by seems to say of the light is not so there.
        """
        now, before = _some_rows(frame.image), self.before
        self.before = now
        if before is None or before.grid.shape != now.grid.shape:
            return frame
        if not _spread_of_change(before.means, now.means, before.taken) >= self._least:
            return frame
        change = self._change(before, now, _cells(frame.image, around))
        if change is None:
            return frame
        taken = self._keep * change
        self.before = replace(now, taken=taken)
        height, width = frame.image.shape[:2]
        at = _first(height, _ROWS) + _step(height, _ROWS) * np.arange(len(taken))
        gains, image = np.exp(-np.interp(np.arange(height), at, taken)), np.empty((height, width, 3), np.uint8)
        _brighten(writable(frame.image), gains, image)
        return replace(frame, image=image)

    def _change(self, before: _Rows, now: _Rows, part: tuple[slice, slice] | None) -> FloatArray | None:
        """(r,) by how much the rows' log brightness changed; None where that was no band. part: its pixels."""
        told = _is_told(before.grid) & _is_told(now.grid)
        rows = told.sum(1) >= _LEAST_PIXELS
        if rows.mean() < _LEAST_ROWS:
            return None
        change = _log(now.grid) - _log(before.grid) + before.taken[:, None]
        middle = np.empty(np.count_nonzero(rows))
        _medians(change[rows], told[rows], middle)
        by_row = np.interp(np.arange(len(change)), np.flatnonzero(rows), middle)
        border = cv2.BORDER_REPLICATE
        smooth = cv2.GaussianBlur(by_row[:, None], (1, 9), 0.0, sigmaY=_SMOOTH_ROWS, borderType=border)[:, 0]
        if smooth.std() < self._least:
            return None
        # Beside a change that is the same for all, which is another matter.
        whole, left = np.abs(change - median(middle)), np.abs(change - smooth[:, None])
        explains = left[told].mean() <= self._unexplained * whole[told].mean()
        if explains and part is not None and told[part].sum() >= _LEAST_PIXELS:
            explains = left[part][told[part]].mean() <= _LEFT_ON_PART * whole[part][told[part]].mean()
        return np.asarray(smooth, np.float64) if explains else None


def _cells(image: ByteImage, around: Box | None) -> tuple[slice, slice] | None:
    """The rows and columns that are compared inside a box (x0, y0, x1, y1) px of an image."""
    if around is None:
        return None
    spans = ((around[1], around[3], image.shape[0], _ROWS), (around[0], around[2], image.shape[1], _COLUMNS))
    rows, columns = (
        slice(max(low, 0) // _step(length, count), max(high, 0) // _step(length, count))
        for low, high, length, count in spans
    )
    return rows, columns


def _first(length: int, count: int) -> int:
    return _step(length, count) // 2


def _step(length: int, count: int) -> int:
    return max(1, length // count)


def _some_rows(image: ByteImage) -> _Rows:
    height, width = image.shape[:2]
    rows = slice(_first(height, _ROWS), None, _step(height, _ROWS))
    picked = writable(image[rows, _first(width, _COLUMNS) :: _step(width, _COLUMNS)])
    grid, means = np.empty(picked.shape, np.uint8), np.empty(len(picked))
    _copy(picked, grid, means)
    return _Rows(grid, means, np.zeros(len(picked)))


def _is_told(grid: ByteImage) -> BoolArray:
    """(r, c) whether none of a pixel's channels is cut off."""
    return np.asarray(((grid > _BLACK) & (grid < _WHITE)).all(2), bool)


def _log(grid: ByteImage) -> FloatArray:
    """(r, c) log brightness."""
    return np.asarray(np.log(grid.mean(2) + _DARK))


@kernel("void(f8[:, ::1], b1[:, ::1], f8[::1])")
def _medians(change: FloatArray, told: BoolArray, middle: FloatArray) -> None:
    """Fill middle (r,) with the median of each row of change (r, c) where it is told (r, c)."""
    row, columns = np.empty(change.shape[1]), change.shape[1]
    for i in range(len(middle)):
        count = 0
        for k in range(columns):
            if told[i, k]:
                row[count] = change[i, k]
                count += 1
        middle[i] = median(row[:count])


@kernel("f8(f8[::1], f8[::1], f8[::1])")
def _spread_of_change(before: FloatArray, now: FloatArray, taken: FloatArray) -> float:
    """Standard deviation over the rows of by how much their log brightness changed, roughly; all (r,), see `_Rows`."""
    return (np.log((now + _DARK) / (before + _DARK)) + taken).std()


@kernel("void(u1[:, :, :], u1[:, :, ::1], f8[::1])")
def _copy(picked: ByteImage, grid: ByteImage, means: FloatArray) -> None:
    """Fill grid (r, c, 3) with picked pixels of the same shape, and means (r,) with the mean of each row."""
    rows, columns, _ = picked.shape
    for row in range(rows):
        total = 0
        for column in range(columns):
            for channel in range(3):
                grid[row, column, channel] = picked[row, column, channel]
                total += picked[row, column, channel]
        means[row] = total / (3 * columns)


@kernel("void(u1[:, :, :], f8[::1], u1[:, :, ::1])")
def _brighten(image: ByteImage, gains: FloatArray, brightened: ByteImage) -> None:
    """Fill brightened (h, w, 3) with an image of that shape, each row times its gain (h,), rounded and cut off."""
    height, width, _ = image.shape
    for row in range(height):
        for column in range(width):
            for channel in range(3):
                brightened[row, column, channel] = int(min(image[row, column, channel] * gains[row] + 0.5, 255.0))
