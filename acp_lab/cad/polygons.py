"""Cutting the polygons of a mesh file into triangles.

Readers of mesh files make a fan of triangles about a polygon's first corner. It fills every convex polygon; in a
concave one, such as the end of a U-channel, it leaves the face and lies over itself. Those are cut by ear clipping: a
corner whose triangle is inside the polygon and holds no other corner is an ear; it is cut off, until a triangle is
left.

Source: G. H. Meisters, "Polygons have ears", American Mathematical Monthly 82, 1975: each has two.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from acp_lab.errors import InputFileError
from acp_lab.geometry.arrays import BoolArray, FloatArray, IntArray

_ROUNDING = 1e-6
"""Of the polygon's size, and of its area: corners that are nearer to a line than that may lie on it."""


def concave(vertices: FloatArray, polygons: Sequence[Sequence[int]]) -> list[int]:
    """Which polygons the fan about their first corner does not fill: their places in the list, in order.

    vertices: (n, 3). polygons: of each, the numbers of its vertices in the order around it.
    """
    sizes = np.array([len(polygon) for polygon in polygons], dtype=np.int64)
    found: list[int] = []
    for size in np.unique(sizes[sizes > 3]):
        places: list[int] = np.flatnonzero(sizes == size).tolist()
        fits = _fan_fits(vertices[np.array([polygons[place] for place in places], dtype=np.int64)])
        found += [place for place, is_filled in zip(places, fits, strict=True) if not is_filled]
    return sorted(found)


def ears(corners: FloatArray, where: str) -> IntArray:
    """Cut a polygon, corners (k, 3) in one plane, into triangles (k - 2, 3) of places among them, wound as it is.

    Raises InputFileError, beginning with `where`, for a polygon that crosses itself.
    """
    flat = _in_its_plane(corners)
    slack = _ROUNDING * float(np.ptp(flat, axis=0).max())
    left, triangles = list(range(len(flat))), list[list[int]]()
    start = 0
    while len(left) > 2:
        # Corners on a line have no ear worth cutting off. They go last: a triangle without height leaves a gap.
        ear = _ear(flat[left], start, slack)
        ear = _ear(flat[left], start, -slack) if ear is None else ear
        if ear is None:
            raise InputFileError(f"{where}: a face of {len(corners)} corners crosses itself: export it as triangles")
        triangles.append([left[ear - 1], left[ear], left[(ear + 1) % len(left)]])
        del left[ear]
        start = ear + 1  # not its neighbour: cutting on there would make a fan of thin triangles
    return np.array(triangles, dtype=np.int64)


def _fan_fits(corners: FloatArray) -> BoolArray:
    """Whether the fan about the first of corners (m, k, 3) fills each polygon: no triangle is turned over, (m,)."""
    with np.errstate(all="ignore"):  # corners that are no points fit: who reads them next says so
        spokes = corners[:, 1:] - corners[:, :1]
        areas = np.cross(spokes[:, :-1], spokes[:, 1:])
        whole = areas.sum(axis=1, keepdims=True)
        turned = (areas * whole).sum(axis=2) < -_ROUNDING * (whole * whole).sum(axis=2)
    fits: BoolArray = ~turned.any(axis=1)
    return fits


def _in_its_plane(corners: FloatArray) -> FloatArray:
    """The corners (k, 3) seen along the axis that is nearest to their normal, (k, 2), counter-clockwise."""
    spokes = corners[1:] - corners[0]
    normal = np.cross(spokes[:-1], spokes[1:]).sum(axis=0)
    axis = int(np.abs(normal).argmax())
    first, second = (axis + 1) % 3, (axis + 2) % 3
    return corners[:, [first, second] if normal[axis] > 0.0 else [second, first]]


def _ear(around: FloatArray, start: int, slim: float) -> int | None:
    """The first corner from `start` on, of those around a polygon (k, 2), that is an ear higher than `slim`."""
    before, after = np.roll(around, 1, axis=0) - around, np.roll(around, -1, axis=0) - around
    longest = np.max([np.hypot(side[:, 0], side[:, 1]) for side in (before, after, after - before)], axis=0)
    high = np.flatnonzero(_cross(after, before) > slim * longest)
    order = np.concatenate([high[high >= start], high[high < start]]).tolist()
    return next((at for at in order if _is_clear(around, at, slim)), None)


def _is_clear(around: FloatArray, at: int, slim: float) -> bool:
    """Whether no other corner lies in the triangle of a corner, or nearer to it than `slim`."""
    triangle = around[[at - 1, at, (at + 1) % len(around)]]
    low, high = triangle.min(axis=0) - abs(slim), triangle.max(axis=0) + abs(slim)
    others = around[((around >= low) & (around <= high)).all(axis=1)]
    # A polygon around a hole runs to it and back: a corner that it has twice is no other one.
    apart = (np.abs(others[:, None] - triangle) > abs(slim)).any(axis=2).all(axis=1)
    sides = np.roll(triangle, -1, axis=0) - triangle
    inside = _cross(sides, others[apart][:, None] - triangle) > -slim * np.hypot(sides[:, 0], sides[:, 1])
    return not bool(np.any(np.all(inside, axis=1)))


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    product: FloatArray = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return product
