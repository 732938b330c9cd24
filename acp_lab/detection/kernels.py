"""The inner loops of the detector, compiled: template sums, and the score of a pose on distance maps.

Samples, poses and the camera are float32: there are thousands of each in an image.
"""

from __future__ import annotations

import numpy as np

from acp_lab.compiled import kernel
from acp_lab.detection.edge_maps import NO_EDGE
from acp_lab.geometry.arrays import ByteImage, Float32Array

CHUNK = 4096
"""Positions that are summed at once: two bytes each, what fits the nearest cache with room for the planes."""
LANES = 16
"""Directions whose distances are found at once: 16 numbers of two bytes fill a register."""
DISTANCE_UNITS = 1024
"""Of a px."""
# A step along a row or column and a slanted one, G. Borgefors, "Distance transformations in digital images", CVGIP
# 1986, with the lengths that OpenCV has for them.
_STRAIGHT, _SLANTED = np.int16(round(0.955 * DISTANCE_UNITS)), np.int16(round(1.3693 * DISTANCE_UNITS))


@kernel(
    "void(int8[:, ::1], int32[:, ::1], int32[:, ::1], int64[::1], float32[::1], int64[::1], int64, int64, int64,"
    " int64, float32[:, ::1], int32[:, ::1])",
)
def scan_templates(
    planes: np.ndarray, plane_of: np.ndarray, shifts: np.ndarray, counts: np.ndarray, gains: Float32Array,
    groups: np.ndarray, from_template: int, to_template: int, first: int, length: int, best: Float32Array,
    best_template: np.ndarray,
) -> None:  # fmt: skip
    """The best of some templates of each group at each position; see `scan.scan`.

    planes: (p, n) responses of one direction and phase each. plane_of, shifts: (t, f) which plane a feature reads,
    and how far from the position. best, best_template: (groups, length), updated.
    """
    total = np.empty(CHUNK, np.int16)
    for begin in range(0, length, CHUNK):
        size = min(CHUNK, length - begin)
        for t in range(from_template, to_template):
            total[:size] = 0
            in_fours = counts[t] - counts[t] % 4
            # The sums are read and written once for four features: that takes as long as reading one of these.
            for f in range(0, in_fours, 4):
                at0, at1 = first + begin + shifts[t, f], first + begin + shifts[t, f + 1]
                at2, at3 = first + begin + shifts[t, f + 2], first + begin + shifts[t, f + 3]
                part0 = planes[plane_of[t, f]][at0 : at0 + size]
                part1 = planes[plane_of[t, f + 1]][at1 : at1 + size]
                part2 = planes[plane_of[t, f + 2]][at2 : at2 + size]
                part3 = planes[plane_of[t, f + 3]][at3 : at3 + size]
                for i in range(size):
                    total[i] += np.int16(part0[i]) + np.int16(part1[i]) + np.int16(part2[i]) + np.int16(part3[i])
            for f in range(in_fours, counts[t]):
                at = first + begin + shifts[t, f]
                part = planes[plane_of[t, f]][at : at + size]
                for i in range(size):
                    total[i] += part[i]
            gain, group = gains[t], groups[t]
            scores = best[group, begin : begin + size]
            ids = best_template[group, begin : begin + size]
            for i in range(size):
                score = gain * np.float32(total[i])
                if score > scores[i]:
                    scores[i] = score
                    ids[i] = t


@kernel(
    "float32(uint8[:, :, ::1], float32, float32, float32, float32, float32[:, ::1], float32[:, ::1], int64,"
    " float32[:, ::1], float32[::1], float32[::1], int32[::1])",
    fastmath=frozenset({"contract", "reassoc", "arcp", "nsz"}),
)
def pose_score(
    maps: ByteImage, fx: np.float32, fy: np.float32, cx: np.float32, cy: np.float32, points: Float32Array,
    tangents: Float32Array, count: int, rotation: Float32Array, centre: Float32Array, table: Float32Array,
    places: np.ndarray,
) -> np.float32:  # fmt: skip
    """Mean of table[distance] over samples projected at a pose; see `pose_search.search_round`.

    maps: (bins, h, w). points, tangents: (3, k) mm about the box centre, object frame, the first `count` in use.
    rotation: (3, 3) object to camera; centre: (3,) mm, the box centre in the camera. table: (256,) of the maps' levels.
    places: (k,) for use in here.
    """
    bins, height, width = np.int32(maps.shape[0]), np.int32(maps.shape[1]), np.int32(maps.shape[2])
    zero, one, half = np.float32(0.0), np.float32(1.0), np.float32(0.5)
    quarter_turn, half_turn = np.float32(0.5 * bins), np.float32(bins)
    per_rad = np.float32(bins / np.pi)
    r00, r01, r02 = rotation[0, 0], rotation[0, 1], rotation[0, 2]
    r10, r11, r12 = rotation[1, 0], rotation[1, 1], rotation[1, 2]
    r20, r21, r22 = rotation[2, 0], rotation[2, 1], rotation[2, 2]
    x_at, y_at, z_at = centre[0], centre[1], centre[2]
    right, bottom = np.float32(width), np.float32(height)
    # No branches: eight samples go through this at once.
    for i in range(count):
        x, y, z = points[0, i], points[1, i], points[2, i]
        px, py, pz = (
            r00 * x + r01 * y + r02 * z + x_at,
            r10 * x + r11 * y + r12 * z + y_at,
            r20 * x + r21 * y + r22 * z + z_at,
        )
        inverse = one / max(pz, one)
        px *= inverse
        py *= inverse
        x, y, z = tangents[0, i], tangents[1, i], tangents[2, i]
        tz = r20 * x + r21 * y + r22 * z
        tx = fx * (r00 * x + r01 * y + r02 * z - px * tz)
        ty = fy * (r10 * x + r11 * y + r12 * z - py * tz)
        # arctan2 within 0.3 degrees, at a tenth of its time; in bins.
        ax, ay = abs(tx), abs(ty)
        ratio = min(ax, ay) / max(ax, ay, np.float32(1e-9))
        angle = per_rad * ratio * (np.float32(0.9724) - np.float32(0.1919) * ratio * ratio)
        angle = quarter_turn - angle if ay > ax else angle
        angle = half_turn - angle if tx * ty < 0 else angle
        bin_ = np.int32(angle + half)
        bin_ = np.int32(0) if bin_ >= bins else bin_
        u, v = fx * px + cx + half, fy * py + cy + half
        outside = (pz <= one) | (u < zero) | (v < zero) | (u >= right) | (v >= bottom)
        column, line = np.int32(min(max(u, zero), right)), np.int32(min(max(v, zero), bottom))
        row = np.int32(np.int32(bin_ * height) + line)
        places[i] = np.int32(-1) if outside else np.int32(np.int32(row * width) + column)
    levels = maps.reshape(-1)
    total = np.float32(0.0)
    for i in range(count):
        if places[i] >= 0:
            total += table[levels[places[i]]]
    return total / np.float32(count)


@kernel(
    "float32(uint8[:, :, ::1], float32, float32, float32, float32, float32[:, ::1], float32[:, ::1], int64,"
    " float32[:, ::1], float32[::1], float32[::1], float32, float32, float32, int64)",
)
def climb(
    maps: ByteImage, fx: np.float32, fy: np.float32, cx: np.float32, cy: np.float32, points: Float32Array,
    tangents: Float32Array, count: int, rotation: Float32Array, centre: Float32Array, table: Float32Array,
    turn: np.float32, shift: np.float32, away: np.float32, rounds: int,
) -> np.float32:  # fmt: skip
    """Pattern search (R. Hooke and T. Jeeves 1961) over six axes from a pose, which it changes; the score there.

    points, tangents: (k, 3). The other arguments from `maps` to `table` are those of `pose_score`.
    turn: rad about the camera's axes through the part's centre; shift: mm across, away: share of the depth; all are
    halved after each of the rounds.
    """
    trial_r, trial_c = np.empty((3, 3), np.float32), np.empty(3, np.float32)
    at, along, places = np.empty((3, count), np.float32), np.empty((3, count), np.float32), np.empty(count, np.int32)
    for i in range(count):
        for k in range(3):
            at[k, i], along[k, i] = points[i, k], tangents[i, k]
    here = pose_score(maps, fx, fy, cx, cy, at, along, count, rotation, centre, table, places)
    for _ in range(rounds):
        for _ in range(2):
            moved = False
            for axis in range(6):
                for sign in (np.float32(1.0), np.float32(-1.0)):
                    trial_r[:] = rotation
                    trial_c[:] = centre
                    if axis < 3:
                        a, b = (axis + 1) % 3, (axis + 2) % 3
                        cosine, sine = np.float32(np.cos(turn)), np.float32(np.sin(sign * turn))
                        for k in range(3):
                            trial_r[a, k] = cosine * rotation[a, k] - sine * rotation[b, k]
                            trial_r[b, k] = sine * rotation[a, k] + cosine * rotation[b, k]
                    elif axis < 5:
                        trial_c[axis - 3] += sign * shift
                    else:
                        trial_c *= np.float32(1.0) + sign * away
                    there = pose_score(maps, fx, fy, cx, cy, at, along, count, trial_r, trial_c, table, places)
                    if there > here:
                        here = there
                        rotation[:] = trial_r
                        centre[:] = trial_c
                        moved = True
                        break
            if not moved:
                break
        turn *= np.float32(0.5)
        shift *= np.float32(0.5)
        away *= np.float32(0.5)
    return here


@kernel(
    "void(uint8[:, ::1], uint8[:, ::1], uint8[:, ::1], float32, int64, int64, float32[:, ::1], float32[:, ::1])",
)
def strongest_gradients(
    red: np.ndarray, green: np.ndarray, blue: np.ndarray, gain: np.float32, first: int, last: int,
    gradient_x: Float32Array, gradient_y: Float32Array,
) -> None:  # fmt: skip
    """Scharr gradients times `gain` of the channel in which they are strongest, for rows from `first` to `last`.

    red, green, blue: (h + 2, w + 2), with a border of one px. gradient_x, gradient_y: (h, w), written.
    """
    width = gradient_x.shape[1]
    strongest = np.empty(width, np.float32)
    three, ten = np.float32(3.0) * gain, np.float32(10.0) * gain
    for y in range(first, last):
        strongest[:] = -1.0
        row_x, row_y = gradient_x[y], gradient_y[y]
        for channel in range(3):
            plane = red if channel == 0 else (green if channel == 1 else blue)
            above, here, below = plane[y], plane[y + 1], plane[y + 2]
            for x in range(width):
                a, b, c = np.float32(above[x]), np.float32(above[x + 1]), np.float32(above[x + 2])
                d, e = np.float32(here[x]), np.float32(here[x + 2])
                f, g, h = np.float32(below[x]), np.float32(below[x + 1]), np.float32(below[x + 2])
                gx = three * (c - a + h - f) + ten * (e - d)
                gy = three * (f - a + h - c) + ten * (g - b)
                square = gx * gx + gy * gy
                better = square > strongest[x]
                strongest[x] = square if better else strongest[x]
                row_x[x] = gx if better else row_x[x]
                row_y[x] = gy if better else row_y[x]


@kernel(
    "void(float32[:, ::1], float32, uint8[:, ::1])",
)
def nearness(distance: Float32Array, reach: np.float32, near: ByteImage) -> None:
    """255 where the distance (h, w) px is 0, down to 0 at `reach`, into `near`."""
    height, width = distance.shape
    slope = np.float32(-255.0) / reach
    for y in range(height):
        for x in range(width):
            value = max(np.float32(255.5) + slope * distance[y, x], np.float32(0.0))
            near[y, x] = np.uint8(np.int32(value))


@kernel(
    "int64(float32[:, ::1], float32[:, :, ::1], float32, float32, int64, int64, int64, int64[::1], int64)",
)
def keep_distinct(
    centres: Float32Array, rotations: Float32Array, near: np.float32, least_trace: np.float32, first: int, last: int,
    most: int, kept: np.ndarray, count: int,
) -> int:  # fmt: skip
    """Go on with rows `first` to `last`: those unlike all that are kept join them; returns how many are kept.

    Alike: centres (n, 3) nearer than `near` mm and the trace of the turn between rotations (n, 3, 3) above
    `least_trace`. kept: (most,) rows, the first `count` in use.
    """
    for i in range(first, last):
        if count == most:
            break
        is_new = True
        for k in range(count):
            j = kept[k]
            square = np.float32(0.0)
            for a in range(3):
                square += (centres[i, a] - centres[j, a]) ** 2
            if square >= near * near:
                continue
            trace = np.float32(0.0)
            for a in range(3):
                for b in range(3):
                    trace += rotations[i, a, b] * rotations[j, a, b]
            if trace > least_trace:
                is_new = False
                break
        if is_new:
            kept[count] = i
            count += 1
    return count


@kernel(
    "void(float32[:, ::1], float32[:, ::1], float32, int64, int64, int64, uint8[:, ::1])",
)
def thin_oriented(
    gradient_x: Float32Array, gradient_y: Float32Array, least: np.float32, bins: int, first: int, last: int,
    directions: ByteImage,
) -> None:  # fmt: skip
    """Gradient maxima across edges, as the bin of the edge's direction, for rows from `first` to `last`.

    directions: (h, w), NO_EDGE before. The edge's direction is at right angles to the gradient.
    """
    height, width = directions.shape
    for y in range(max(first, 1), min(last, height - 1)):
        for x in range(1, width - 1):
            gx, gy = gradient_x[y, x], gradient_y[y, x]
            square = gx * gx + gy * gy
            if square < least * least:
                continue
            ax, ay = abs(gx), abs(gy)
            dx = 0 if ax < np.float32(0.4142) * ay else (1 if gx > 0 else -1)
            dy = 0 if ay < np.float32(0.4142) * ax else (1 if gy > 0 else -1)
            bx, by = gradient_x[y - dy, x - dx], gradient_y[y - dy, x - dx]
            fx, fy = gradient_x[y + dy, x + dx], gradient_y[y + dy, x + dx]
            if square <= bx * bx + by * by or square < fx * fx + fy * fy:
                continue
            direction = np.arctan2(gy, gx) / np.pi + 0.5
            directions[y, x] = int(np.floor(direction * bins + 0.5)) % bins


@kernel(
    "void(uint8[:, ::1], int16[:, ::1], int64, int64)",
)
def distances_from_above(directions: ByteImage, lanes: np.ndarray, first: int, last: int) -> None:
    """The first pass of `edge_maps.distances`, for rows from `first` to `last`: from above and from the left.

    directions: (h, w). lanes: (h + 2, (w + 2) * LANES), a border of one px; LANES directions of a px side by side, so
    that they go through the recursion along a row all at once.
    """
    width = directions.shape[1]
    for y in range(first, last):
        above, here = lanes[y], lanes[y + 1]
        for x in range(width):
            if directions[y, x] != NO_EDGE:
                here[(x + 1) * LANES + directions[y, x]] = 0
        for i in range(LANES, LANES * (width + 1)):
            straight, left, right = above[i] + _STRAIGHT, above[i - LANES] + _SLANTED, above[i + LANES] + _SLANTED
            here[i] = min(here[i], np.int16(straight), np.int16(left), np.int16(right))
        for i in range(LANES, LANES * (width + 1)):
            here[i] = min(here[i], np.int16(here[i - LANES] + _STRAIGHT))


@kernel(
    "void(int16[:, :, ::1], int64, int64)",
)
def distances_from_below(lanes: np.ndarray, first: int, last: int) -> None:
    """The second pass, for rows from `first` to `last`, which go upwards; lanes: (h + 2, w + 2, LANES)."""
    width = lanes.shape[1] - 2
    for y in range(last - 1, first - 1, -1):
        here, below = lanes[y + 1], lanes[y + 2]
        for x in range(width, 0, -1):
            for k in range(LANES):
                right, straight = here[x + 1, k] + _STRAIGHT, below[x, k] + _STRAIGHT
                left, slanted = below[x - 1, k] + _SLANTED, below[x + 1, k] + _SLANTED
                here[x, k] = min(
                    here[x, k], np.int16(right), np.int16(straight), np.int16(left), np.int16(slanted)
                )


@kernel(
    "void(int16[:, :, ::1], int32, int64, int64, float32[:, :, ::1])",
)
def distances_in_px(lanes: np.ndarray, per_bin: np.int32, first: int, last: int, found: Float32Array) -> None:
    """The distances in px, for rows from `first` to `last`; of edges up to two bins away `per_bin` more for each.

    lanes: (LANES, last - first, w + 2), of these rows, with a border of one px left and right. found: (bins, h, w),
    written.
    """
    bins, _, width = found.shape
    unit = np.float32(1.0 / DISTANCE_UNITS)
    per_two = np.int32(2 * per_bin)
    for y in range(first, last):
        for k in range(bins):
            own = lanes[k, y - first]
            before, after = lanes[(k + bins - 1) % bins, y - first], lanes[(k + 1) % bins, y - first]
            before_2, after_2 = lanes[(k + bins - 2) % bins, y - first], lanes[(k + 2) % bins, y - first]
            row = found[k, y]
            for x in range(width):
                beside = np.int32(min(before[x + 1], after[x + 1]) + per_bin)
                further = np.int32(min(before_2[x + 1], after_2[x + 1]) + per_two)
                row[x] = np.float32(min(np.int32(own[x + 1]), beside, further)) * unit


@kernel(
    "void(float32[:, :, ::1], float32, float32, int64, int64, float32[:, :, ::1])",
)
def spread_by_direction(
    distance: Float32Array, reach: np.float32, share: np.float32, first: int, last: int, response: Float32Array
) -> None:
    """1 where the distance (bins, h, w) px is 0, 0 from `reach` on, or a share of that of the directions beside, added.

    For rows from `first` to `last`; response: (bins, h, w).
    """
    bins, _, width = distance.shape
    slope = np.float32(-1.0) / reach
    for y in range(first, last):
        for k in range(bins):
            own, row = distance[k, y], response[k, y]
            before, after = distance[(k + bins - 1) % bins, y], distance[(k + 1) % bins, y]
            for x in range(width):
                near = np.float32(1.0) + slope * own[x]
                beside = share * (np.float32(1.0) + slope * min(before[x], after[x]))
                row[x] += max(near, beside)
