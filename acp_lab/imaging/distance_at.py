"""Exact distances to the nearest edge pixel, looked up at a few places without a map of all of them.

A distance transform first measures along each column, which is cheap, and then searches along each row for the column
through which the way is shortest, which is not. Whoever asks at some hundred points, of several edge maps at once,
needs that search at their pixels only (in a map of a part's surroundings: a tenth of the time).

Convention: as in `imaging.distance`; several edge maps lie as layers (k, h, w) in one array.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from acp_lab.compiled import kernel
from acp_lab.errors import GeometryError
from acp_lab.geometry.arrays import BoolArray, FloatArray, IntArray, plain

ColumnDistances: TypeAlias = NDArray[np.uint16]
"""(k, h, w) px from each pixel to the nearest edge pixel above or below it; `NO_EDGE` where its column has none."""
NO_EDGE = 65534
_MOST_ROWS = 65000


def column_distances(layers: BoolArray) -> ColumnDistances:
    """The distances along the columns of edge maps (k, h, w).

    Raises GeometryError for another shape.
    """
    if layers.ndim != 3 or layers.size == 0 or not 2 <= layers.shape[1] <= _MOST_ROWS or layers.shape[2] < 2:
        raise GeometryError(
            f"edge maps of shape {layers.shape}: give (k, h, w), True on edges, h from 2 to {_MOST_ROWS}, w from 2"
        )
    columns = np.where(layers, np.uint16(0), np.uint16(NO_EDGE))
    _spread(columns)
    return columns


def distances_at(columns: ColumnDistances, layers: IntArray, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Distances and their gradients at points (n, 2) px, each in a layer (n,): (n,) px and (n, 2) px per px.

    Between pixel centres the distance is bilinear, as if it were read from `distance_map`, and its gradient that of
    what is read. A layer without any edge is everywhere as far as the maps' diagonal. Outside the maps the border's
    value is read, grown by the way to the border; a point that is nowhere (NaN) is infinitely far.

    Example:
        >>> edges = np.zeros((1, 20, 30), bool)
        >>> edges[0, 5, 8] = True
        >>> distances_at(column_distances(edges), np.zeros(2, int), np.array([[11.0, 9.0], [8.0, 2.5]]))[0]
        array([5. , 2.5])
    """
    values, gradients = np.empty(len(points)), np.empty((len(points), 2))
    _look_up(columns, np.ascontiguousarray(layers, np.int64), plain(points), values, gradients)
    return values, gradients


@kernel("void(u2[:, :, ::1])")
def _spread(columns: ColumnDistances) -> None:
    """From 0 on edges and `NO_EDGE` elsewhere to the distances along the columns."""
    count, height, width = columns.shape
    one = np.uint16(1)
    for k in range(count):
        for y in range(1, height):
            for x in range(width):
                columns[k, y, x] = min(columns[k, y, x], np.uint16(columns[k, y - 1, x] + one))
        for y in range(height - 2, -1, -1):
            for x in range(width):
                columns[k, y, x] = min(columns[k, y, x], np.uint16(columns[k, y + 1, x] + one))


@kernel("f4(u2[::1], i8, f8)")
def _distance(row: ColumnDistances, x: int, without: float) -> np.float32:
    """The distance of pixel x of a row, given its columns' distances; `without` where there is no edge at all."""
    width, best, away = len(row), np.int64(row[x]) * np.int64(row[x]), np.int64(1)
    while away * away < best:
        left, right = x - away, x + away
        if left < 0 and right >= width:
            break
        if left >= 0:
            best = min(best, np.int64(row[left]) * np.int64(row[left]) + away * away)
        if right < width:
            best = min(best, np.int64(row[right]) * np.int64(row[right]) + away * away)
        away += 1
    return np.float32(math.sqrt(best)) if best < NO_EDGE * NO_EDGE else np.float32(without)


@kernel("void(u2[:, :, ::1], i8[::1], f8[:, ::1], f8[::1], f8[:, ::1])")
def _look_up(
    columns: ColumnDistances, layers: IntArray, points: FloatArray, values: FloatArray, gradients: FloatArray
) -> None:
    _, height, width = columns.shape
    without = math.hypot(height, width)
    for i in range(len(points)):
        x, y = points[i, 0], points[i, 1]
        # A point on the vanishing line has no place; it, too, is far from everything.
        if math.isnan(x):
            x = math.inf
        if math.isnan(y):
            y = math.inf
        inside_x, inside_y = min(max(x, 0.0), width - 1.001), min(max(y, 0.0), height - 1.001)
        column, row = int(inside_x), int(inside_y)
        u, v = inside_x - column, inside_y - row
        upper, lower = columns[layers[i], row], columns[layers[i], row + 1]
        a, b = _distance(upper, column, without), _distance(upper, column + 1, without)
        c, d = _distance(lower, column, without), _distance(lower, column + 1, without)
        top, bottom = a + u * (b - a), c + u * (d - c)
        gradients[i, 0], gradients[i, 1] = (1.0 - v) * (b - a) + v * (d - c), bottom - top
        values[i] = top + v * (bottom - top)
        out_x, out_y = x - inside_x, y - inside_y
        way = math.hypot(out_x, out_y)
        if way > 0.0:
            # Infinitely far there is no direction; solvers leave NaN out.
            gradients[i, 0], gradients[i, 1] = out_x / way, out_y / way
            values[i] += way
