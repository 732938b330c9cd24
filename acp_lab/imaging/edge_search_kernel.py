"""The inner loop of `edge_search.search_along_normals`: profiles, their peaks, and the best of these."""

from __future__ import annotations

import numpy as np

from acp_lab.compiled import kernel
from acp_lab.geometry.arrays import Float32Array, FloatArray, IntArray

FLANK_PX = 3
_TINY = 1e-6
# px; more than single precision rounds a place in a large image.
_ROUNDED = 0.01


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


@kernel("void(f4[:, :, ::1], f8, f8, f8, f8, f4[:, ::1])", fastmath=frozenset({"contract"}))
def read_profile(channels: Float32Array, x: float, y: float, nx: float, ny: float, profile: Float32Array) -> None:
    """Fill profile (3, n) at n places a px apart from (x, y) on: slope along (nx, ny) and across it, grey; 0 outside.

    channels: see `strongest_peaks`.
    """
    height, width = channels.shape[:2]
    count = profile.shape[1]
    end_x, end_y = x + (count - 1) * nx, y + (count - 1) * ny
    low_x, high_x, low_y, high_y = min(x, end_x), max(x, end_x), min(y, end_y), max(y, end_y)
    if low_x > _ROUNDED and high_x < width - 1 - _ROUNDED and low_y > _ROUNDED and high_y < height - 1 - _ROUNDED:
        # All in single precision, in which twice as many places are read at once.
        fx, fy, fnx, fny = np.float32(x), np.float32(y), np.float32(nx), np.float32(ny)
        for k in range(count):
            px, py = fx + np.float32(k) * fnx, fy + np.float32(k) * fny
            # Unsigned: no index can be meant from the end.
            column, row = np.uint32(px), np.uint32(py)
            right, down = px - np.float32(column), py - np.float32(row)
            left, upper = np.uint64(column), np.uint64(row)
            beside, below = left + np.uint64(1), upper + np.uint64(1)
            d = right * down
            b, c, a = right - d, down - d, np.float32(1.0) - right - down + d
            gx = a * channels[upper, left, 0] + b * channels[upper, beside, 0]
            gx += c * channels[below, left, 0] + d * channels[below, beside, 0]
            gy = a * channels[upper, left, 1] + b * channels[upper, beside, 1]
            gy += c * channels[below, left, 1] + d * channels[below, beside, 1]
            grey = a * channels[upper, left, 2] + b * channels[upper, beside, 2]
            grey += c * channels[below, left, 2] + d * channels[below, beside, 2]
            profile[0, k], profile[1, k], profile[2, k] = fnx * gx + fny * gy, fny * gx - fnx * gy, grey
    else:
        for k in range(count):
            gx, gy, grey = read_pixel(channels, x + k * nx, y + k * ny)
            profile[0, k], profile[1, k], profile[2, k] = nx * gx + ny * gy, ny * gx - nx * gy, grey


@kernel("i8(f4[::1], i8, f4[::1], i8[::1])")
def local_maxima(along: Float32Array, margin: int, squares: Float32Array, places: IntArray) -> int:
    """Fill squares (n,) of along (n,) and places with their local maxima, `margin` from the ends; returns how many.

    Without a branch: which places are maxima no processor can foresee.
    """
    for k in range(len(along)):
        squares[k] = along[k] * along[k]
    count = 0
    for k in range(margin, len(along) - margin):
        places[count] = k
        count += (squares[k] > squares[k - 1]) & (squares[k] >= squares[k + 1])
    return count


@kernel("void(f4[::1], i8, i8, f4[::1])")
def average_along(values: Float32Array, first: int, half: int, found: Float32Array) -> None:
    """Fill found (m,): the mean of 2 half + 1 neighbours about values[first], values[first + 1] and so on."""
    if half == 0:
        for k in range(len(found)):
            found[k] = values[first + k]
        return
    total, share = 0.0, 1.0 / (2 * half + 1)
    for k in range(first - half, first + half + 1):
        total += values[k]
    for k in range(len(found)):
        found[k] = share * total
        if k + 1 < len(found):
            total += values[first + k + half + 1] - values[first + k - half]


@kernel("f4(f4[::1], f4)")
def at_grey(table: Float32Array, grey: float) -> float:
    """A table (257,) of the grey levels 0 to 255, and its end once more, at a grey level between them."""
    within = np.float32(min(max(grey, 0.0), 255.0))
    level = np.uint64(np.uint32(within))
    low: float = table[level]
    return low + (within - np.float32(level)) * (table[level + np.uint64(1)] - low)


@kernel("void(f4[:, :, ::1], f8, f8, f8[:, ::1], f8[:, ::1], i8, i8[::1], f8, f4[::1], f8[:, :, ::1])")
def strongest_peaks(
    channels: Float32Array, x0: float, y0: float, points: FloatArray, normals: FloatArray, reach_px: int,
    halves: IntArray, contrast: float, encoding: Float32Array, found: FloatArray,
) -> None:  # fmt: skip
    """Fill found (5, n, m), zeros before: offset, score, gradient, grey before and after, of the m best peaks.

    channels: (h, w, 3) gradient x and y in linear light, and grey, of the full image's px (x0, y0) and on.
    points: (n, 2) px of the full image; normals: (n, 2) unit.
    halves: (n,) px to either side over which slopes are averaged. encoding: see `edge_search.slopes_of_encoding`.
    """
    most, middle = found.shape[2], reach_px + FLANK_PX
    if most == 0:
        return
    room = 0
    for i in range(len(halves)):
        room = max(room, halves[i])
    profile = np.empty((3, 2 * (middle + room) + 1), np.float32)
    along, across, greys = np.empty(2 * middle + 1, np.float32), np.empty(2 * middle + 1, np.float32), profile[2]
    squares, places, chosen = np.empty_like(along), np.empty(len(along), np.int64), np.empty(most, np.int64)
    asked, tiny, start = np.float32(contrast), np.float32(_TINY), middle + room
    for i in range(len(points)):
        x, y, nx, ny = points[i, 0] - x0, points[i, 1] - y0, normals[i, 0], normals[i, 1]
        read_profile(channels, x - start * nx, y - start * ny, nx, ny, profile)
        average_along(profile[0], room, halves[i], along)
        average_along(profile[1], room, halves[i], across)
        kept = 0
        for place in range(local_maxima(along, FLANK_PX, squares, places)):
            k = places[place]
            # The squared cosine between gradient and normal, then contrast.
            score = squares[k] / (squares[k] + across[k] * across[k] + tiny)
            if kept == most and score <= found[1, i, most - 1]:
                continue
            # Grey levels per level of light, where the edge is.
            encoded = at_grey(encoding, greys[room + k])
            limit = asked / encoded
            score *= squares[k] / (squares[k] + limit * limit)
            slot = kept
            if kept == most:
                if score <= found[1, i, most - 1]:
                    continue
                slot = most - 1
            else:
                kept += 1
            while slot > 0 and found[1, i, slot - 1] < score:
                chosen[slot] = chosen[slot - 1]
                found[1, i, slot], found[2, i, slot] = found[1, i, slot - 1], found[2, i, slot - 1]
                slot -= 1
            chosen[slot] = k
            found[1, i, slot], found[2, i, slot] = score, along[k] * encoded
        for slot in range(kept):
            k = chosen[slot]
            before, peak, after = abs(along[k - 1]), abs(along[k]), abs(along[k + 1])
            curvature = min(before - 2.0 * peak + after, -_TINY)
            found[0, i, slot] = k - middle + min(max(0.5 * (before - after) / curvature, -0.5), 0.5)
            beside = FLANK_PX + halves[i]
            found[3, i, slot], found[4, i, slot] = greys[room + k - beside], greys[room + k + beside]
