"""The inner loop of `edge_search.search_along_normals`: profiles, their peaks, and the best of these."""

from __future__ import annotations

import numpy as np

from acp_lab.compiled import kernel
from acp_lab.geometry.arrays import Float32Array, FloatArray

FLANK_PX = 3
_TINY = 1e-6
# Below this grey level the encoding is nearly straight, as that of sRGB is; and a step out of black is no noise.
_DARK = 4.0


@kernel("UniTuple(f8, 3)(f4[:, :, ::1], f8, f8)")
def read_pixel(channels: Float32Array, x: float, y: float) -> tuple[float, float, float]:
    """The three channels of (h, w, 3) at (x, y) px, interpolated between pixels; 0 outside."""
    height, width = channels.shape[:2]
    if not (-1.0 < x < width and -1.0 < y < height):
        return 0.0, 0.0, 0.0
    # Above 0 first: towards 0 is down there.
    column, row = int(x + 1.0) - 1, int(y + 1.0) - 1
    right, down = x - column, y - row
    upper_left, upper_right = (1.0 - right) * (1.0 - down), right * (1.0 - down)
    lower_left, lower_right = (1.0 - right) * down, right * down
    if column < 0:
        upper_left, lower_left, column = 0.0, 0.0, 0
        beside = 0
    else:
        beside = column + 1
        if beside == width:
            upper_right, lower_right, beside = 0.0, 0.0, column
    if row < 0:
        upper_left, upper_right, row = 0.0, 0.0, 0
        below = 0
    else:
        below = row + 1
        if below == height:
            lower_left, lower_right, below = 0.0, 0.0, row
    a, b, c, d = channels[row, column], channels[row, beside], channels[below, column], channels[below, beside]
    return (
        upper_left * a[0] + upper_right * b[0] + lower_left * c[0] + lower_right * d[0],
        upper_left * a[1] + upper_right * b[1] + lower_left * c[1] + lower_right * d[1],
        upper_left * a[2] + upper_right * b[2] + lower_left * c[2] + lower_right * d[2],
    )


@kernel("void(f4[:, :, ::1], f8[:, ::1], f8[:, ::1], i8, f8, f8, f8[:, :, ::1])")
def strongest_peaks(
    channels: Float32Array, points: FloatArray, normals: FloatArray, reach_px: int, contrast: float, gamma: float,
    found: FloatArray,
) -> None:  # fmt: skip
    """Fill found (5, n, m), zeros before: offset, score, gradient, grey before and after, of the m best peaks.

    channels: (h, w, 3) gradient x and y in linear light, and grey. points: (n, 2) px of it; normals: (n, 2) unit.
    """
    most, length = found.shape[2], 2 * (reach_px + FLANK_PX) + 1
    if most == 0:
        return
    along, across, grey = np.empty(length), np.empty(length), np.empty(length)
    for i in range(len(points)):
        x, y, nx, ny = points[i, 0], points[i, 1], normals[i, 0], normals[i, 1]
        for k in range(length):
            way = k - reach_px - FLANK_PX
            gx, gy, grey[k] = read_pixel(channels, x + way * nx, y + way * ny)
            along[k], across[k] = gx * nx + gy * ny, gx * ny - gy * nx
        kept = 0
        for k in range(FLANK_PX, length - FLANK_PX):
            square = along[k] * along[k]
            if not (square > along[k - 1] ** 2 and square >= along[k + 1] ** 2):
                continue
            # Grey levels per level of light, where the edge is.
            encoded = (max(grey[k], _DARK) / 255.0) ** (1.0 - gamma) / gamma
            # Contrast, and the squared cosine between gradient and normal.
            score = square / (square + (contrast / encoded) ** 2) * square / (square + across[k] ** 2 + _TINY)
            slot = kept
            if kept == most:
                if score <= found[1, i, most - 1]:
                    continue
                slot = most - 1
            else:
                kept += 1
            while slot > 0 and found[1, i, slot - 1] < score:
                for field in range(5):
                    found[field, i, slot] = found[field, i, slot - 1]
                slot -= 1
            before, peak, after = abs(along[k - 1]), abs(along[k]), abs(along[k + 1])
            curvature = min(before - 2.0 * peak + after, -_TINY)
            shift = min(max(0.5 * (before - after) / curvature, -0.5), 0.5)
            found[0, i, slot] = k - reach_px - FLANK_PX + shift
            found[1, i, slot] = score
            found[2, i, slot] = along[k] * encoded
            found[3, i, slot] = grey[k - FLANK_PX]
            found[4, i, slot] = grey[k + FLANK_PX]
