"""Thin-plate splines: the smoothest warp of the plane that takes given points to given points.

Used to show what moving control points would do to an image if nothing tied them to a rigid body.
Convention: points are (x, y) px, source row i goes to destination row i; images are (h, w) or (h, w, 3).

Source: F. Bookstein, "Principal warps" (1989): `f(x) = a0 + A x + sum_i w_i U(|x - s_i|)` with `U(r) = r^2 log r`
and its centres at the *source* points. The coefficients are solved here: `kornia.get_tps_transform` puts
the centres at the destination: that also meets all points, but is another, less smooth surface.
The image is warped by `kornia.warp_image_tps`, which needs normalised points (in pixels it returns black)
and the reverse warp, from destination to source.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np

from acp_lab.errors import GeometryError
from acp_lab.geometry.arrays import ByteImage, Float32Array, FloatArray

Image = TypeVar("Image", ByteImage, Float32Array)


def warp_points_tps(points: FloatArray, src: FloatArray, dst: FloatArray) -> FloatArray:
    """Points (n, 2) moved by the spline that takes src (m, 2) to dst (m, 2), m >= 3; (n, 2), px.

    Raises GeometryError for fewer than three points, sources that repeat or are all collinear, and shapes
    that do not match.

    Example:
        >>> square = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]])
        >>> warp_points_tps(np.array([[5.0, 5.0]]), square, square + [2.0, 0.0]).round(6)  # exact for shifts
        array([[7., 5.]])
    """
    src, dst = _point_pairs(src, dst)
    to_unit = _Unit(src)
    kernel, affine = _coefficients(to_unit(src), dst)
    x = to_unit(np.asarray(points, dtype=np.float64))
    warped: FloatArray = _radial(x, to_unit(src)) @ kernel + _with_one(x) @ affine
    return warped


def warp_image_tps(image: Image, src: FloatArray, dst: FloatArray) -> Image:
    """The image with its content at src (m, 2) moved to dst (m, 2), px; same shape and type, black outside.

    image: (h, w) or (h, w, 3), uint8 or float32. Bilinear. Raises GeometryError as `warp_points_tps` does.
    Imports torch and kornia, which takes seconds the first time.
    """
    import torch
    from kornia.geometry.transform import warp_image_tps as kornia_warp

    src, dst = _point_pairs(src, dst)
    height, width = image.shape[:2]
    # Pixel centres to the frame of grid_sample with align_corners=False: (2 x + 1) / w - 1.
    size = np.array([width, height], dtype=np.float64)
    src_unit, dst_unit = ((2.0 * p + 1.0) / size - 1.0 for p in (src, dst))
    # Output pixels ask where they come from: the spline runs from dst to src, with its centres at dst.
    kernel, affine = _coefficients(dst_unit, src_unit)

    planes = image.reshape(height, width, -1).astype(np.float32).transpose(2, 0, 1)

    def tensor(array: FloatArray | Float32Array) -> torch.Tensor:
        return torch.from_numpy(np.ascontiguousarray(array, dtype=np.float32))[None]

    warped = kornia_warp(tensor(planes), tensor(dst_unit), tensor(kernel), tensor(affine))
    result = warped[0].permute(1, 2, 0).numpy().reshape(image.shape)
    if image.dtype == np.uint8:
        result = np.clip(np.rint(result), 0.0, 255.0)
    return result.astype(image.dtype)


class _Unit:
    """Centres and scales points to about 1, where r^2 log r behaves; the spline stays the same."""

    def __init__(self, points: FloatArray) -> None:
        self.centre = points.mean(axis=0)
        self.size = max(float(np.abs(points - self.centre).max()), 1e-12)

    def __call__(self, points: FloatArray) -> FloatArray:
        return (points - self.centre) / self.size


def _point_pairs(src: FloatArray, dst: FloatArray) -> tuple[FloatArray, FloatArray]:
    src, dst = np.asarray(src, dtype=np.float64), np.asarray(dst, dtype=np.float64)
    if src.ndim != 2 or src.shape != dst.shape or src.shape[1] != 2 or len(src) < 3:
        raise GeometryError(
            f"spline points are {src.shape} and {dst.shape}: give two lists of the same 3 or more (x, y)"
        )
    if not (np.isfinite(src).all() and np.isfinite(dst).all()):
        raise GeometryError("spline points hold a number that is not finite: leave those points out")
    return src, dst


def _coefficients(src: FloatArray, dst: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Kernel weights (m, 2) and affine part (3, 2) = rows (1, x, y): [[U, P], [P^T, 0]] [w, a] = [dst, 0]."""
    count = len(src)
    system = np.zeros((count + 3, count + 3))
    system[:count, :count] = _radial(src, src)
    system[:count, count:] = _with_one(src)
    system[count:, :count] = system[:count, count:].T
    # Repeated or collinear sources make the system singular, up to rounding.
    if np.linalg.cond(system) > 1e12:
        raise GeometryError("spline source points repeat or are collinear: spread them")
    solved = np.linalg.solve(system, np.vstack([dst, np.zeros((3, 2))])).astype(np.float64, copy=False)
    return solved[:count], solved[count:]


def _radial(points: FloatArray, centres: FloatArray) -> FloatArray:
    """U(|x - s|) = r^2 log r, (n, m), with its limit 0 at r = 0."""
    squared = ((points[:, None] - centres[None]) ** 2).sum(axis=2)
    radial: FloatArray = 0.5 * squared * np.log(np.where(squared > 0.0, squared, 1.0))
    return radial


def _with_one(points: FloatArray) -> FloatArray:
    return np.insert(points, 0, 1.0, axis=1)
