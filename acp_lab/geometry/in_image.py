"""Which points lie in an image: of the others it shows nothing, and that says nothing of them."""

from __future__ import annotations

import numpy as np

from acp_lab.compiled import kernel
from acp_lab.geometry.arrays import BoolArray, FloatArray, plain
from acp_lab.geometry.camera import Camera


def in_image(points: FloatArray, camera: Camera) -> BoolArray:
    """(n,) whether points (n, 2) px lie between the centres of a camera's outermost pixels."""
    inside = np.empty(len(points), np.bool_)
    _in_image(plain(points), camera.width - 1.0, camera.height - 1.0, inside)
    return inside


@kernel("void(f8[:, ::1], f8, f8, b1[::1])")
def _in_image(points: FloatArray, right: float, bottom: float, inside: BoolArray) -> None:
    """Fill inside (n,): whether points (n, 2) px lie from 0 to right and bottom."""
    for n in range(len(points)):
        x, y = points[n, 0], points[n, 1]
        inside[n] = (x >= 0.0) & (x <= right) & (y >= 0.0) & (y <= bottom)
