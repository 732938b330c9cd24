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


@kernel("void(f4[:, :, ::1], f8, f8, f8, f8, f8[::1])", fastmath=frozenset({"contract"}))
def read_slopes(channels: Float32Array, x: float, y: float, nx: float, ny: float, along: FloatArray) -> None:
    """Fill along (n,) with the gradient along (nx, ny), at n places a px apart from (x, y) on; 0 outside."""
    height, width = channels.shape[:2]
    last, count = len(along) - 1, len(along)
    end_x, end_y = x + last * nx, y + last * ny
    if min(x, end_x) >= 0.0 and max(x, end_x) < width - 1 and min(y, end_y) >= 0.0 and max(y, end_y) < height - 1:
        for k in range(count):
            px, py = x + k * nx, y + k * ny
            # Unsigned: no index can be meant from the end.
            column, row = np.uint64(px), np.uint64(py)
            beside, below = column + np.uint64(1), row + np.uint64(1)
            right, down = px - column, py - row
            upper = (1.0 - right) * (nx * channels[row, column, 0] + ny * channels[row, column, 1])
            upper += right * (nx * channels[row, beside, 0] + ny * channels[row, beside, 1])
            lower = (1.0 - right) * (nx * channels[below, column, 0] + ny * channels[below, column, 1])
            lower += right * (nx * channels[below, beside, 0] + ny * channels[below, beside, 1])
            along[k] = (1.0 - down) * upper + down * lower
    else:
        for k in range(count):
            gx, gy, _ = read_pixel(channels, x + k * nx, y + k * ny)
            along[k] = nx * gx + ny * gy


@kernel("void(f4[:, :, ::1], f8[:, ::1], f8[:, ::1], i8, f8, f8, f8[:, :, ::1])")
def strongest_peaks(
    channels: Float32Array, points: FloatArray, normals: FloatArray, reach_px: int, contrast: float, gamma: float,
    found: FloatArray,
) -> None:  # fmt: skip
    """Fill found (5, n, m), zeros before: offset, score, gradient, grey before and after, of the m best peaks.

    channels: (h, w, 3) gradient x and y in linear light, and grey. points: (n, 2) px of it; normals: (n, 2) unit.
    """
    most, length = found.shape[2], 2 * (reach_px + 1) + 1
    if most == 0:
        return
    along, bend = np.empty(length), np.float32(1.0 - gamma)
    for i in range(len(points)):
        x, y, nx, ny = points[i, 0], points[i, 1], normals[i, 0], normals[i, 1]
        read_slopes(channels, x - (reach_px + 1) * nx, y - (reach_px + 1) * ny, nx, ny, along)
        kept = 0
        for k in range(1, length - 1):
            square = along[k] * along[k]
            if not (square > along[k - 1] ** 2 and square >= along[k + 1] ** 2):
                continue
            way = k - reach_px - 1
            gx, gy, grey = read_pixel(channels, x + way * nx, y + way * ny)
            across = gx * ny - gy * nx
            # The squared cosine between gradient and normal, then contrast.
            score = square / (square + across * across + _TINY)
            if kept == most and score <= found[1, i, most - 1]:
                continue
            # Grey levels per level of light, where the edge is.
            encoded = np.float32(max(grey, _DARK) / 255.0) ** bend / gamma
            score *= square / (square + (contrast / encoded) ** 2)
            slot = kept
            if kept == most:
                if score <= found[1, i, most - 1]:
                    continue
                slot = most - 1
            else:
                kept += 1
            while slot > 0 and found[1, i, slot - 1] < score:
                for field in range(4):
                    found[field, i, slot] = found[field, i, slot - 1]
                slot -= 1
            before, peak, after = abs(along[k - 1]), abs(along[k]), abs(along[k + 1])
            curvature = min(before - 2.0 * peak + after, -_TINY)
            shift = min(max(0.5 * (before - after) / curvature, -0.5), 0.5)
            found[0, i, slot] = way + shift
            found[1, i, slot] = score
            found[2, i, slot] = along[k] * encoded
            # Grey beside it is read of those only that are kept in the end.
            found[3, i, slot] = way
        for slot in range(kept):
            way = found[3, i, slot]
            for side in range(2):
                flank = way + (2 * side - 1) * FLANK_PX
                _, _, found[3 + side, i, slot] = read_pixel(channels, x + flank * nx, y + flank * ny)
