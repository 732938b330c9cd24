"""The pose of four coplanar points that moved a little from where a known pose had them: planar PnP from nearby.

`solve_planar_pnp` knows nothing of where to begin and finds both poses of a plane. An optimiser that steps from I to
the next I knows the pose before its step. From there Gauss-Newton on the same reprojection error comes to the same
pose, in a few steps of a few microseconds.

Convention: as in `geometry.planar_pnp`.
"""

from __future__ import annotations

import math

import numpy as np

from acp_lab.compiled import kernel
from acp_lab.geometry.arrays import FloatArray, plain
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose_kernels import eliminate, move

_MOST_STEPS = 40
_LARGEST_TURN = 0.5
"""rad: a step that turns further has left the pose it began at."""
_STILL = 1e-11
"""rad, and share of the distance: a step this short is the last."""
_FLAT_PX = 1e-3
"""Three points closer to one line than this determine no pose."""


def planar_pnp_nearby(
    points_obj: FloatArray, points_image: FloatArray, camera: Camera, near: FloatArray
) -> FloatArray | None:
    """The pose (4, 4) of four coplanar points, refined from one nearby; None where that leads nowhere.

    points_obj: (4, 3) mm; points_image: (4, 2) px; near: (4, 4) cam_T_obj. Of the two poses that `solve_planar_pnp`
    finds it is the one that `near` goes over into. Whoever gets None asks `solve_planar_pnp`, which knows why: points
    that are folded or in one line, or too far from where they were.
    """
    pose = np.array(near, np.float64)
    found = _climb_down(pose, plain(points_obj), plain(points_image), camera.numbers)
    return pose if found else None


@kernel("b1(f8[:, ::1], f8[:, ::1])")
def _same_sides(seen: FloatArray, points_image: FloatArray) -> bool:
    """Whether four points turn as where a pose shows them, at all corners, none of which is flat."""
    size = 0.0
    for i in range(4):
        for k in range(i):
            x, y = points_image[i, 0] - points_image[k, 0], points_image[i, 1] - points_image[k, 1]
            size = max(size, math.sqrt(x * x + y * y))
    for i in range(4):
        before, after = (i + 3) % 4, (i + 1) % 4
        areas = np.empty(2)
        for which, quad in enumerate((seen, points_image)):
            x, y = quad[i, 0] - quad[before, 0], quad[i, 1] - quad[before, 1]
            areas[which] = x * (quad[after, 1] - quad[i, 1]) - y * (quad[after, 0] - quad[i, 0])
        if not (abs(areas[1]) > _FLAT_PX * size and areas[0] * areas[1] > 0.0):
            return False
    return True


@kernel("b1(f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[::1])")
def _climb_down(pose: FloatArray, points_obj: FloatArray, points_image: FloatArray, camera: FloatArray) -> bool:
    """Gauss-Newton on the reprojection error from a pose (4, 4), which is overwritten; whether it arrived."""
    centre, moved = np.zeros(3), np.empty((4, 4))
    for k in range(3):
        for i in range(4):
            centre[k] += 0.25 * points_obj[i, k]
    seen, matrix, step, row = np.empty((4, 2)), np.empty((6, 6)), np.empty(6), np.empty(6)
    for _ in range(_MOST_STEPS):
        matrix[:] = 0.0
        step[:] = 0.0
        depth = 0.0
        for i in range(4):
            x, y, z = points_obj[i, 0], points_obj[i, 1], points_obj[i, 2]
            px = pose[0, 0] * x + pose[0, 1] * y + pose[0, 2] * z + pose[0, 3]
            py = pose[1, 0] * x + pose[1, 1] * y + pose[1, 2] * z + pose[1, 3]
            pz = pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * z + pose[2, 3]
            if not pz > 0.0:
                return False
            depth += 0.25 * pz
            x, y, z = x - centre[0], y - centre[1], z - centre[2]
            rx = pose[0, 0] * x + pose[0, 1] * y + pose[0, 2] * z
            ry = pose[1, 0] * x + pose[1, 1] * y + pose[1, 2] * z
            rz = pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * z
            seen[i, 0], seen[i, 1] = camera[0] * px / pz + camera[2], camera[1] * py / pz + camera[3]
            for axis in range(2):
                focal = camera[axis] / pz
                a, b = (focal, 0.0) if axis == 0 else (0.0, focal)
                c = -(a * px + b * py) / pz
                row[0], row[1], row[2] = ry * c - rz * b, rz * a - rx * c, rx * b - ry * a
                row[3], row[4], row[5] = a, b, c
                off = points_image[i, axis] - seen[i, axis]
                for j in range(6):
                    step[j] += row[j] * off
                    for k in range(6):
                        matrix[j, k] += row[j] * row[k]
        if not eliminate(matrix, step):
            return False
        turn, shift = 0.0, 0.0
        for k in range(3):
            turn, shift = max(turn, abs(step[k])), max(shift, abs(step[3 + k]))
        if not (turn < _LARGEST_TURN and shift < depth):  # also what is not finite
            return False
        move(pose, centre, step, moved)
        pose[:] = moved
        if turn < _STILL and shift < _STILL * depth:
            return _same_sides(seen, points_image)
    return False
