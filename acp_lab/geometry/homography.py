"""Homographies between four points, and the derivative of a warped point by these four.

Convention: points are (x, y) px rows, H (3, 3) takes source to destination in homogeneous coordinates and is
scaled to H[2, 2] = 1. The order of the four rows matters: source row i goes to destination row i.
In the method the four are the image control points I: a small step of I moves the edges by H (paper, IV-C).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from acp_lab.errors import GeometryError
from acp_lab.geometry.arrays import FloatArray

_FLAT = 1e-9
"""Corner areas below this share of the squared extent are zero to rounding: no homography exists."""


def homography_system(src: FloatArray, dst: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The paper's linear system A h = b for h = (H11, H12, H13, H21, ..., H32), with H33 = 1.

    src, dst: (4, 2). Returns A (8, 8) and b (8,). Rows 2i and 2i + 1 say that source point i lands on x and y
    of destination point i: `h1 x + h2 y + h3 - x' (h7 x + h8 y) = x'`. Paper, equation for H in section IV-C;
    its print lost the right-hand side b, the eight moved coordinates.
    """
    system = np.zeros((8, 8))
    system[0::2, 0:2] = src
    system[0::2, 2] = 1.0
    system[1::2, 3:5] = src
    system[1::2, 5] = 1.0
    moved = dst.reshape(8)
    system[0::2, 6:] = -dst[:, :1] * src
    system[1::2, 6:] = -dst[:, 1:] * src
    return system, moved


def homography_from_points(src: FloatArray, dst: FloatArray) -> FloatArray:
    """H (3, 3), H33 = 1, that takes four points src (4, 2) to dst (4, 2).

    Solves `homography_system` between coordinates centred and scaled to about 1, because in raw pixels its
    columns differ by a factor of 1e6. Raises GeometryError when three points of a set are collinear, or when H
    sends the source's origin to infinity (then H33 = 0 and cannot be scaled to 1) or its middle.

    Example:
        >>> square = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]])
        >>> shift = homography_from_points(square, square + [5.0, 3.0])
        >>> apply_homography(shift, np.array([[1.0, 1.0]])).round(6)
        array([[6., 4.]])
    """
    source, destination = _unit_quad(src, "source"), _unit_quad(dst, "destination")
    h = _solved(*homography_system(source.corners, destination.corners))
    homography = destination.back @ np.append(h, 1.0).reshape(3, 3) @ source.to
    if abs(homography[2, 2]) < 1e-12 * np.abs(homography[2]).max():
        raise GeometryError("homography sends pixel (0, 0) to infinity, H33 = 0: choose other points")
    scaled: FloatArray = homography / homography[2, 2]
    return scaled


def apply_homography(homography: FloatArray, points: FloatArray) -> FloatArray:
    """Points (n, 2) moved by H (3, 3), (n, 2); points on its vanishing line become inf or NaN."""
    homogeneous = points @ homography[:, :2].T + homography[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        moved: FloatArray = homogeneous[:, :2] / homogeneous[:, 2:]
    return moved


class QuadWarp:
    """Points (n, 2) px that a homography moves with four others, src (4, 2).

    What depends on the start alone is computed once: optimisers call this at every step. Raises
    GeometryError when three of the four are collinear.
    """

    def __init__(self, src: FloatArray, points: FloatArray) -> None:
        source = _unit_quad(src, "source")
        self._corners = source.corners
        self._homogeneous = np.ones((len(points), 3))
        self._homogeneous[:, :2] = _move(source.to, np.asarray(points, dtype=np.float64))

    def to(self, dst: FloatArray) -> WarpedPoints:
        """The points when the four are at dst (4, 2).

        Raises GeometryError when three of those are collinear, or when H sends the middle of src to infinity.
        """
        destination = _unit_quad(dst, "destination")
        system, moved = homography_system(self._corners, destination.corners)
        h = _solved(system, moved)
        with np.errstate(divide="ignore", invalid="ignore"):
            over_w = self._homogeneous / (self._homogeneous @ np.append(h[6:], 1.0))[:, None]
        return WarpedPoints(self._corners, system, h, destination.back, over_w)


@dataclass(frozen=True)
class WarpedPoints:
    """n points moved by the homography H between four; points on its vanishing line are inf or NaN.

    In coordinates centred and scaled to about 1: corners (4, 2), the start of the four; system (8, 8) and h (8,) of
    `homography_system`; over_w (n, 3), the points' x, y and 1 over their denominator w. from_dst: (3, 3) to px.
    """

    corners: FloatArray
    system: FloatArray
    h: FloatArray
    from_dst: FloatArray
    over_w: FloatArray

    @cached_property
    def _moved(self) -> FloatArray:
        moved: FloatArray = self.over_w @ self.h[:6].reshape(2, 3).T
        return moved

    @property
    def points(self) -> FloatArray:
        """H x, (n, 2) px."""
        return self._moved * self.from_dst[0, 0] + self.from_dst[:2, 2]

    def tangents(self, tangents: FloatArray) -> FloatArray:
        """Directions (n, 2) at the points before, as they are after: by the derivative of H, of length 1."""
        # The two scalings and 1/w change lengths alone, 1/w also the sign.
        turned = tangents @ self.h[[0, 1, 3, 4]].reshape(2, 2).T - self._moved * (tangents @ self.h[6:])[:, None]
        turned *= np.sign(self.over_w[:, 2:])
        unit: FloatArray = turned / np.maximum(np.hypot(turned[:, 0], turned[:, 1]), 1e-12)[:, None]
        return unit

    def jacobian(self) -> FloatArray:
        """d(H x) / d dst, (n, 2, 8), px per px, columns in the order x1, y1, x2, ..., y4.

        From A h = b: moving destination coordinate k changes one equation, so dh = w_k A^-1 e_k with w_k the
        denominator h7 x + h8 y + 1 at its source point; and a moved point p = H x changes by
        (x, y, 1, -p x, -p y) / w along h.
        """
        steps = self._steps
        jacobian: FloatArray = (self.over_w @ np.hstack([steps[:3], steps[3:6]])).reshape(-1, 2, 8)
        jacobian -= np.einsum("ni,nk->nik", self._moved, self.over_w[:, :2] @ steps[6:])
        return jacobian

    def rows_along(self, directions: FloatArray) -> FloatArray:
        """(n, 8) the same along directions (n, 2), one per point, which needs no larger array on the way."""
        along = np.empty((len(directions), 8))
        np.multiply(self.over_w, directions[:, :1], out=along[:, :3])
        np.multiply(self.over_w, directions[:, 1:], out=along[:, 3:6])
        np.multiply(self.over_w[:, :2], -(self._moved * directions).sum(1)[:, None], out=along[:, 6:])
        rows: FloatArray = along @ self._steps
        return rows

    @cached_property
    def _steps(self) -> FloatArray:
        """(8, 8) dh / d dst; the centring is held fixed: H does not depend on it, and its scale cancels."""
        by_moved = np.linalg.inv(self.system)
        return np.asarray(by_moved * np.repeat(self.corners @ self.h[6:] + 1.0, 2), np.float64)


def homography_points_jacobian(src: FloatArray, dst: FloatArray, points: FloatArray) -> FloatArray:
    """d(H x) / d dst for points x (n, 2): (n, 2, 8), see `WarpedPoints.jacobian`; H is that from src to dst, (4, 2)."""
    return QuadWarp(src, points).to(dst).jacobian()


def check_quad(points: FloatArray, minimum_px: float = 1.0, where: str = "quad") -> FloatArray:
    """The four points (4, 2) as float64 when they form a convex quadrilateral in this order, clockwise or not.

    minimum_px: how far, at least, each corner must be from the line through two others. where: what the
    message is to name. Raises GeometryError that says whether the quad is not finite, tiny, has three corners
    (which) collinear, or is folded (crossing sides or a corner that points inwards).
    """
    quad = _four_points(points, where)
    size = extent(quad)
    if size < minimum_px:
        raise GeometryError(f"{where} is tiny: {size:.3g} px across, not {minimum_px:g}: spread its points")
    areas = corner_areas(quad)
    for i, area in enumerate(areas):
        trio = (i - 1) % 4, i, (i + 1) % 4
        height = abs(area) / extent(quad[list(trio)])
        if height < minimum_px:
            names = ", ".join(str(j) for j in sorted(trio))
            raise GeometryError(
                f"{where} is degenerate: points {names} are collinear within {height:.3g} px, "
                f"needs {minimum_px:g}: move one of them"
            )
    if not all(area * areas[0] > 0.0 for area in areas):
        raise GeometryError(f"{where} is folded: in this order its points are no convex quadrilateral: move one")
    return quad


def corner_areas(quad: FloatArray) -> tuple[float, float, float, float]:
    """Twice the signed area of the triangle at each corner of four points (4, 2): previous, corner, next.

    These are all four triangles of the quad, so a convex one has equal signs and a folded one has not;
    a view of a plane keeps all signs or flips all of them.
    """
    (x0, y0), (x1, y1), (x2, y2), (x3, y3) = quad.tolist()
    return (
        (x0 - x3) * (y1 - y0) - (y0 - y3) * (x1 - x0),
        (x1 - x0) * (y2 - y1) - (y1 - y0) * (x2 - x1),
        (x2 - x1) * (y3 - y2) - (y2 - y1) * (x3 - x2),
        (x3 - x2) * (y0 - y3) - (y3 - y2) * (x0 - x3),
    )


def extent(points: FloatArray) -> float:
    """The largest distance between two of a few points (n, 2)."""
    corners = points.tolist()
    return max(math.dist(p, q) for i, p in enumerate(corners) for q in corners[:i])


def _solved(system: FloatArray, moved: FloatArray) -> FloatArray:
    try:
        return np.asarray(np.linalg.solve(system, moved), dtype=np.float64)
    except np.linalg.LinAlgError:
        raise GeometryError("homography sends the middle of its source to infinity: choose other points") from None


def _four_points(points: FloatArray, name: str) -> FloatArray:
    quad = np.asarray(points, dtype=np.float64)
    if quad.shape != (4, 2):
        raise GeometryError(f"{name}: points have shape {quad.shape}: give four rows of (x, y)")
    if not np.isfinite(quad).all():
        raise GeometryError(f"{name}: a point is not finite: {quad.tolist()}")
    return quad


def _refuse_flat(quad: FloatArray, name: str) -> None:
    size = extent(quad)
    if not min(abs(area) for area in corner_areas(quad)) > _FLAT * size * size:
        raise GeometryError(f"{name} points {quad.tolist()}: three are collinear, there is no homography: move one")


@dataclass(frozen=True)
class _UnitQuad:
    """corners: (4, 2) four points, centred and scaled to about 1; to, back: (3, 3) similarities that do and undo it."""

    corners: FloatArray
    to: FloatArray
    back: FloatArray


def _unit_quad(points: FloatArray, name: str) -> _UnitQuad:
    """Four points (4, 2) px in coordinates of their own; GeometryError, with `name`, when three are collinear."""
    quad = _four_points(points, name)
    _refuse_flat(quad, name)
    # Plain Python numbers: for so few, NumPy's calls take four times as long.
    xs, ys = quad.T.tolist()
    x, y = 0.25 * sum(xs), 0.25 * sum(ys)
    size = max(max(xs) - x, x - min(xs), max(ys) - y, y - min(ys))
    to = np.array([[1.0 / size, 0.0, -x / size], [0.0, 1.0 / size, -y / size], [0.0, 0.0, 1.0]])
    back = np.array([[size, 0.0, x], [0.0, size, y], [0.0, 0.0, 1.0]])
    return _UnitQuad(_move(to, quad), to, back)


def _move(similarity: FloatArray, points: FloatArray) -> FloatArray:
    return points * similarity[0, 0] + similarity[:2, 2]
