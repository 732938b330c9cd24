"""The loops of `pose_descent`."""

from __future__ import annotations

import math

import numpy as np

from acp_lab.compiled import kernel
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.normal_equations import add_up_rows
from acp_lab.geometry.pose_kernels import eliminate, move, step_between

_TINY = 1e-9
_LEAST_MASS = 1e-12
# The arrays of a `pose_descent.PoseLevel`, from centre_obj to strengths.
_LEVEL = (
    "f8[::1], f8[::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[::1], f8[::1],"
    " f8[::1], f8[::1]"
)


@kernel(f"f8(f8[:, ::1], f8[:, ::1], f8[::1], {_LEVEL})", fastmath=frozenset({"contract"}))
def add_up_pose(
    pose: FloatArray, matrix: FloatArray, vector: FloatArray, centre_obj: FloatArray, camera: FloatArray,
    points_obj: FloatArray, points: FloatArray, directions: FloatArray, rows: FloatArray, targets: FloatArray,
    scores: FloatArray, trust: FloatArray, mixture: FloatArray, pulls: FloatArray, strengths: FloatArray,
) -> float:  # fmt: skip
    """Fill matrix (k, k) and vector (k,) of a `solvers.Information` at a pose (4, 4); returns its total.

    The others: see `pose_descent.PoseLevel`; rows: (n, k), of unknowns that may be more than the pose's six.
    Points behind the camera say nothing.
    """
    sigma, outlier, precision = mixture[0], mixture[1], mixture[2]
    narrow = -0.5 / (sigma * sigma)
    sum_of_weights, used = 0.0, 0
    # A row per unknown of the points that say something, as `add_up_rows` takes them.
    most = len(points_obj)
    unknowns, weights, weighted = np.empty((rows.shape[1], most)), np.empty(most), np.empty(most)
    for i in range(most):
        x, y, z = points_obj[i, 0], points_obj[i, 1], points_obj[i, 2]
        depth = pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * z + pose[2, 3]
        if not depth > 0.0:
            continue
        u = camera[0] * (pose[0, 0] * x + pose[0, 1] * y + pose[0, 2] * z + pose[0, 3]) / depth + camera[2]
        v = camera[1] * (pose[1, 0] * x + pose[1, 1] * y + pose[1, 2] * z + pose[1, 3]) / depth + camera[3]
        moved = (u - points[i, 0]) * directions[i, 0] + (v - points[i, 1]) * directions[i, 1]
        mass, moment = 0.0, 0.0
        for k in range(targets.shape[1]):
            if scores[i, k] != 0.0:
                distance = targets[i, k] - moved
                share = scores[i, k] * math.exp(narrow * distance * distance)
                mass += share
                moment += share * distance
        weight = precision * trust[i] * mass / (mass + outlier)
        pull = weight * moment / max(mass, _LEAST_MASS) + strengths[i] * (pulls[i] - moved)
        weight += strengths[i]
        if weight == 0.0 or not math.isfinite(pull):
            continue
        sum_of_weights += weight
        weights[used], weighted[used] = weight, pull
        for j in range(rows.shape[1]):
            unknowns[j, used] = rows[i, j]
        used += 1
    add_up_rows(unknowns, weights[:used], weighted[:used], matrix, vector)
    return sum_of_weights


@kernel(f"i8(f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[::1], f8, f8, f8[:, :, ::1], {_LEVEL})")
def descend(
    start: FloatArray, relative: FloatArray, absolute: FloatArray, towards: FloatArray, expected: FloatArray,
    scale: FloatArray, damping: float, last_px: float, found: FloatArray, centre_obj: FloatArray, camera: FloatArray,
    points_obj: FloatArray, points: FloatArray, directions: FloatArray, rows: FloatArray, targets: FloatArray,
    scores: FloatArray, trust: FloatArray, mixture: FloatArray, pulls: FloatArray, strengths: FloatArray,
) -> int:  # fmt: skip
    """Fill found (k, 4, 4) with the pose after each step, at most k; returns how many there are.

    damping, last_px: see `solvers.GaussNewton`; the others: see `pose_descent.PoseLevel`.
    """
    matrix, vector, off, moved = np.empty((6, 6)), np.empty(6), np.empty(6), np.empty((4, 4))
    at = start.copy()
    for number in range(len(found)):
        total = add_up_pose(
            at, matrix, vector, centre_obj, camera, points_obj, points, directions, rows, targets, scores, trust,
            mixture, pulls, strengths,
        )  # fmt: skip
        total = max(total, _TINY)
        step_between(at, expected, centre_obj, off)
        largest = 1.0
        for j in range(6):
            for k in range(6):
                vector[j] += towards[j, k] * off[k]
                matrix[j, k] = (matrix[j, k] + absolute[j, k]) / total + relative[j, k]
            vector[j] /= total
            largest = max(largest, matrix[j, j])
        if damping > 0.0:
            for j in range(6):
                matrix[j, j] += damping * matrix[j, j] + _TINY * largest
        if not eliminate(matrix, vector):
            vector[:] = 0.0
        move(at, centre_obj, vector, moved)
        depth, everything = moved[2, 3], 0.0
        for j in range(3):
            depth += moved[2, j] * centre_obj[j]
            for k in range(4):
                everything += moved[j, k]
        if not (depth > 0.0 and math.isfinite(everything)):
            return number
        at[:] = moved
        found[number] = moved
        farthest = 0.0
        for j in range(6):
            farthest = max(farthest, abs(vector[j] / scale[j]))
        if farthest < last_px:
            return number + 1
    return len(found)
