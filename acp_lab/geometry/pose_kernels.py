"""Small sums of pose geometry for compiled loops: a pose step and its inverse, six equations. See `pose_step`."""

from __future__ import annotations

import math

import numpy as np

from acp_lab.compiled import kernel
from acp_lab.geometry.arrays import FloatArray


@kernel("b1(f8[:, ::1], f8[::1])")
def eliminate(matrix: FloatArray, vector: FloatArray) -> bool:
    """Solve matrix (n, n) x = vector (n,) into the vector, for the small n of poses; whether it was possible.

    The matrix is used up.
    """
    count = len(vector)
    for column in range(count):
        pivot = column
        for row in range(column + 1, count):
            if abs(matrix[row, column]) > abs(matrix[pivot, column]):
                pivot = row
        if not abs(matrix[pivot, column]) > 0.0:
            return False
        if pivot != column:
            for k in range(column, count):
                matrix[column, k], matrix[pivot, k] = matrix[pivot, k], matrix[column, k]
            vector[column], vector[pivot] = vector[pivot], vector[column]
        for row in range(column + 1, count):
            factor = matrix[row, column] / matrix[column, column]
            for k in range(column + 1, count):
                matrix[row, k] -= factor * matrix[column, k]
            vector[row] -= factor * vector[column]
    for column in range(count - 1, -1, -1):
        for k in range(column + 1, count):
            vector[column] -= matrix[column, k] * vector[k]
        vector[column] /= matrix[column, column]
    return True


@kernel("void(f8[:, ::1], f8[:, ::1])")
def invert(matrix: FloatArray, inverse: FloatArray) -> None:
    """Fill inverse (n, n), for the small n of poses; NaN where there is none."""
    count = len(matrix)
    rest = matrix.copy()
    for i in range(count):
        for k in range(count):
            inverse[i, k] = 1.0 if i == k else 0.0
    for column in range(count):
        pivot = column
        for row in range(column + 1, count):
            if abs(rest[row, column]) > abs(rest[pivot, column]):
                pivot = row
        if not abs(rest[pivot, column]) > 0.0:
            inverse[:] = np.nan
            return
        if pivot != column:
            for k in range(count):
                rest[column, k], rest[pivot, k] = rest[pivot, k], rest[column, k]
                inverse[column, k], inverse[pivot, k] = inverse[pivot, k], inverse[column, k]
        scale = 1.0 / rest[column, column]
        for k in range(count):
            rest[column, k] *= scale
            inverse[column, k] *= scale
        for row in range(count):
            factor = rest[row, column]
            if row != column and factor != 0.0:
                for k in range(count):
                    rest[row, k] -= factor * rest[column, k]
                    inverse[row, k] -= factor * inverse[column, k]


@kernel("void(f8[:, ::1], f8[::1], f8[::1], f8[:, ::1])")
def move(pose: FloatArray, centre_obj: FloatArray, step: FloatArray, moved: FloatArray) -> None:
    """Fill moved (4, 4), see `pose_step.move_pose`."""
    x, y, z = step[0], step[1], step[2]
    angle = math.sqrt(x * x + y * y + z * z)
    a, b = 1.0, 0.5
    if angle >= 1e-100:
        half = math.sin(0.5 * angle) / (0.5 * angle)
        a, b = math.sin(angle) / angle, 0.5 * half * half
    turn = (
        (1.0 - b * (y * y + z * z), b * x * y - a * z, b * x * z + a * y),
        (b * x * y + a * z, 1.0 - b * (x * x + z * z), b * y * z - a * x),
        (b * x * z - a * y, b * y * z + a * x, 1.0 - b * (x * x + y * y)),
    )
    for i in range(3):
        # How far the turn alone takes the centre; nothing at all where there is no turn.
        turned = 0.0
        for k in range(3):
            moved[i, k] = turn[i][0] * pose[0, k] + turn[i][1] * pose[1, k] + turn[i][2] * pose[2, k]
            turned += (pose[i, k] - moved[i, k]) * centre_obj[k]
        moved[i, 3] = pose[i, 3] + turned + step[3 + i]
        moved[3, i] = 0.0
    moved[3, 3] = 1.0


@kernel("void(f8[:, ::1], f8[:, ::1], f8[::1], f8[::1])")
def step_between(start: FloatArray, end: FloatArray, centre_obj: FloatArray, step: FloatArray) -> None:
    """Fill step (6,), see `pose_step.pose_step_between`; the turn by its quaternion's largest part (Shepperd)."""
    r = np.empty((3, 3))
    for i in range(3):
        for k in range(3):
            r[i, k] = end[i, 0] * start[k, 0] + end[i, 1] * start[k, 1] + end[i, 2] * start[k, 2]
        step[3 + i] = end[i, 3] - start[i, 3]
        for k in range(3):
            step[3 + i] += (end[i, k] - start[i, k]) * centre_obj[k]
    a, b, c = r[0, 0], r[1, 1], r[2, 2]
    trace = a + b + c
    if trace >= max(a, b, c):
        w, x, y, z = 1.0 + trace, r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]
    elif a >= b and a >= c:
        w, x, y, z = r[2, 1] - r[1, 2], 1.0 + a - b - c, r[1, 0] + r[0, 1], r[0, 2] + r[2, 0]
    elif b >= c:
        w, x, y, z = r[0, 2] - r[2, 0], r[1, 0] + r[0, 1], 1.0 - a + b - c, r[2, 1] + r[1, 2]
    else:
        w, x, y, z = r[1, 0] - r[0, 1], r[0, 2] + r[2, 0], r[2, 1] + r[1, 2], 1.0 - a - b + c
    if w < 0.0:
        w, x, y, z = -w, -x, -y, -z
    length = math.sqrt(w * w + x * x + y * y + z * z)
    sine = math.sqrt(x * x + y * y + z * z) / length
    scale = (2.0 * math.atan2(sine, w / length) / sine if sine > 1e-150 else 2.0) / length
    step[0], step[1], step[2] = scale * x, scale * y, scale * z
