"""The loops of `regions`: lines across the outline, the rays that say how far they are free, and what they weigh."""

from __future__ import annotations

import numpy as np

from acp_lab.compiled import kernel
from acp_lab.geometry.arrays import BoolArray, FloatArray, IntArray

CLEAR = 0.15
"""Weight of a posterior from which on it tells where the boundary is."""
WORST = 9.0
"""px^2: how far off a line counts that finds no boundary; none counts as farther off."""


@kernel(
    "i8(b1[::1], i8[::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[::1], f8[:, ::1], f8[:, ::1], i8[::1], i8[::1],"
    " f8[:, ::1], f8[:, ::1], f8[::1])"
)
def outline_lines(
    outline: BoolArray, sample_ids: IntArray, edge_points: FloatArray, normals: FloatArray, pose: FloatArray,
    camera: FloatArray, points_obj: FloatArray, off_obj: FloatArray, rows: IntArray, ids: IntArray, points: FloatArray,
    outward: FloatArray, px_per_mm: FloatArray,
) -> int:  # fmt: skip
    """Fill rows, ids, points, outward and px_per_mm with as many outline points as they hold; returns how many.

    The first four and pose (4, 4): of n edge points; camera: see `Camera.numbers`; points_obj, off_obj: of all samples,
    the latter pointing off the material. See `correspondence_lines.CorrespondenceLines`.
    """
    count, across = 0, np.empty(3)
    for row in range(len(outline)):
        if count == len(rows):
            break
        i = sample_ids[row]
        if not outline[row] or i < 0:
            continue
        x, y, z = pose[0, 3], pose[1, 3], pose[2, 3]
        for k in range(3):
            x += pose[0, k] * points_obj[i, k]
            y += pose[1, k] * points_obj[i, k]
            z += pose[2, k] * points_obj[i, k]
        ax, ay = camera[0] * normals[row, 0] / z, camera[1] * normals[row, 1] / z
        az = -(ax * x + ay * y) / z
        side, square = 0.0, 0.0
        for k in range(3):
            across[k] = ax * pose[0, k] + ay * pose[1, k] + az * pose[2, k]
            side += across[k] * off_obj[i, k]
            square += across[k] * across[k]
        if side == 0.0:
            continue
        side = 1.0 if side > 0.0 else -1.0
        rows[count], ids[count], px_per_mm[count] = row, i, np.sqrt(square)
        for k in range(2):
            points[count, k], outward[count, k] = edge_points[row, k], side * normals[row, k]
        count += 1
    return count


@kernel("void(i8[::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[::1], f8[::1], f8[:, :, ::1])")
def line_rays(
    asked: IntArray, points: FloatArray, outward: FloatArray, pose: FloatArray, camera: FloatArray, way_px: FloatArray,
    rays_obj: FloatArray,
) -> None:  # fmt: skip
    """Fill rays_obj (len(asked), len(way_px), 3): viewing directions through the lines `asked`, way_px along them."""
    for n in range(len(asked)):
        i = asked[n]
        for k in range(len(way_px)):
            x = (points[i, 0] + way_px[k] * outward[i, 0] - camera[2]) / camera[0]
            y = (points[i, 1] + way_px[k] * outward[i, 1] - camera[3]) / camera[1]
            for j in range(3):
                rays_obj[n, k, j] = x * pose[0, j] + y * pose[1, j] + pose[2, j]


@kernel("void(i8[::1], b1[:, :, :], f8[::1], f8[:, ::1])")
def free_lengths(ids: IntArray, hit: BoolArray, step_mm: FloatArray, free: FloatArray) -> None:
    """Write free[:, ids] (mm): as far as the part reaches without a gap inwards, and the background outwards.

    hit: (n, 2, k) whether the rays along n lines hit the part, inwards and outwards, step_mm (n,) apart.
    """
    for n in range(len(ids)):
        for side in range(2):
            steps = 0
            while steps < hit.shape[2] and hit[n, side, steps] == (side == 0):
                steps += 1
            free[side, ids[n]] = step_mm[n] * steps


@kernel("i8(f8[:, ::1], i8[::1], i8[::1], f8[:, ::1], f8[:, ::1], f8[::1], f8[:, ::1])")
def keep_free(
    free_mm: FloatArray, rows: IntArray, ids: IntArray, points: FloatArray, outward: FloatArray,
    px_per_mm: FloatArray, free: FloatArray,
) -> int:  # fmt: skip
    """Move lines that are free on both sides to the front, and fill free (2, n) px with theirs; returns how many."""
    count = 0
    for n in range(len(ids)):
        inwards, outwards = px_per_mm[n] * free_mm[0, ids[n]], px_per_mm[n] * free_mm[1, ids[n]]
        if inwards > 0.0 and outwards > 0.0:
            free[0, count], free[1, count] = inwards, outwards
            rows[count], ids[count], px_per_mm[count] = rows[n], ids[n], px_per_mm[n]
            for k in range(2):
                points[count, k], outward[count, k] = points[n, k], outward[n, k]
            count += 1
    return count


@kernel(
    "void(f8, b1, f8, f8, f8[:, ::1], i8[::1], i8[::1], f8[:, ::1], f8[::1], f8[::1], f8[::1], b1[::1], f8[:, ::1],"
    " f8[::1], f8[::1])"
)
def weigh_lines(
    gate: float, is_fine: bool, scatter_px: float, smooth_share: float, found: FloatArray, rows: IntArray,
    ids: IntArray, outward: FloatArray, px_per_mm: FloatArray, offsets_mm: FloatArray, mean_square: FloatArray,
    crease: BoolArray, normals: FloatArray, residuals: FloatArray, weights: FloatArray,
) -> None:  # fmt: skip
    """Write residuals (px, along the edge points' own normals) and weights of the edge points that are lines.

    found: (2, n) px and weights of the posteriors; rows, ids, outward, px_per_mm: of the n lines; offsets_mm,
    mean_square, crease: of all samples; at fine levels these say how far and how surely a line speaks.
    """
    for n in range(len(rows)):
        row, i = rows[n], ids[n]
        px, weight = found[0, n], gate * found[1, n]
        if is_fine:
            px -= offsets_mm[i] * px_per_mm[n]
            weight *= scatter_px**2 / (scatter_px**2 + mean_square[i])
            if not crease[i]:
                weight *= smooth_share
        residuals[row] = px * (outward[n, 0] * normals[row, 0] + outward[n, 1] * normals[row, 1])
        weights[row] = weight


@kernel("f8(f8[::1], f8[::1], f8[:, ::1], f8[:, ::1], f8[:, ::1])")
def mean_square_rest(
    residuals: FloatArray, weights: FloatArray, start: FloatArray, points: FloatArray, directions: FloatArray
) -> float:
    """Half the weighted squared residual, px^2, the mean over n edge points that moved from start; both (n, 2).

    residuals: (n,) px along directions (n, 2), at the start.
    """
    total = 0.0
    for n in range(len(residuals)):
        if weights[n] != 0.0:
            moved = (points[n, 0] - start[n, 0]) * directions[n, 0] + (points[n, 1] - start[n, 1]) * directions[n, 1]
            total += weights[n] * (residuals[n] - moved) ** 2
    return 0.5 * total / max(len(residuals), 1)


@kernel("void(i8[::1], b1[::1], f8[::1], f8[::1], f8[::1], f8[::1], b1[::1], f8, f8[::1])")
def follow_scatter(
    ids: IntArray, seen: BoolArray, found_px: FloatArray, weights: FloatArray, px_per_mm: FloatArray,
    offsets_mm: FloatArray, known: BoolArray, rate: float, mean_square: FloatArray,
) -> None:  # fmt: skip
    """Move mean_square (px^2) of the samples `ids` on by how far beside the expected place n lines found the boundary.

    seen: (n,) which lines lie in the image, the others say nothing; found_px, weights: (n,) of the posteriors;
    px_per_mm: (n,); offsets_mm, known, mean_square: of all samples; rate:
    of known ones.
    """
    for n in range(len(ids)):
        if not seen[n]:
            continue
        i, square = ids[n], WORST
        if weights[n] > CLEAR:
            rest = found_px[n] - offsets_mm[i] * px_per_mm[n]
            square = min(rest * rest, WORST)
        mean_square[i] += (rate if known[i] else 0.5) * (square - mean_square[i])


@kernel("i8(i8[::1], b1[::1], f8, f8[::1])")
def expect_of_unseen(unseen: IntArray, known: BoolArray, expected: float, mean_square: FloatArray) -> int:
    """Write what is expected into mean_square of the samples `unseen` (n,), without those that are known by now.

    Moves the others to the front, in their order, and returns how many there are.
    """
    count = 0
    for i in unseen:
        if not known[i]:
            unseen[count], mean_square[i] = i, expected
            count += 1
    return count
