"""A small step of a pose, and the Jacobians of image points and control points by it.

A pose step is six numbers about the part's own centre: rotation vector w (rad) and shift v (mm), in camera axes.
About the centre, because the origin of a CAD file may lie far outside the part; about it, rotation and shift mix.
"""

from __future__ import annotations

import numpy as np

from acp_lab.compiled import kernel
from acp_lab.geometry.arrays import FloatArray, plain
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import so3_exp, so3_log, transform


def centre_position(cam_T_obj: FloatArray, centre_obj: FloatArray) -> FloatArray:
    """(3,) mm: where the object point `centre_obj` (3,) is in the camera frame."""
    centre: FloatArray = cam_T_obj[:3, :3] @ centre_obj + cam_T_obj[:3, 3]
    return centre


def move_pose(cam_T_obj: FloatArray, centre_obj: FloatArray, step: FloatArray) -> FloatArray:
    """Rotate by step[:3] (rad, camera axes) about the object point `centre_obj` (3,), then shift by step[3:] (mm)."""
    moved = np.eye(4)
    rotation = so3_exp(step[:3]) @ cam_T_obj[:3, :3]
    moved[:3, :3] = rotation
    moved[:3, 3] = centre_position(cam_T_obj, centre_obj) + step[3:] - rotation @ centre_obj
    return moved


def pose_step_between(start_T_obj: FloatArray, end_T_obj: FloatArray, centre_obj: FloatArray) -> FloatArray:
    """(6,) the step (rad, mm) that takes one pose (4, 4) to another: the inverse of `move_pose`."""
    turn = so3_log(end_T_obj[:3, :3] @ start_T_obj[:3, :3].T)
    return np.concatenate([turn, transform(end_T_obj, centre_obj) - transform(start_T_obj, centre_obj)])


def image_directions(points_cam: FloatArray, normals: FloatArray, camera: Camera) -> FloatArray:
    """(n, 3) a with a . u = motion in px along the image normal when the point moves by u mm (camera axes).

    Args:
        points_cam: (n, 3) mm.
        normals: (n, 2) unit, image.
    """
    found = np.empty((len(points_cam), 3))
    _image_directions(plain(points_cam), plain(normals), camera.fx, camera.fy, found)
    return found


@kernel("void(f8[:, ::1], f8[:, ::1], f8, f8, f8[:, ::1])")
def _image_directions(
    points_cam: FloatArray, normals: FloatArray, fx: float, fy: float, found: FloatArray
) -> None:  # fmt: skip
    for i in range(len(points_cam)):
        inverse_depth = 1.0 / points_cam[i, 2]
        x, y = fx * normals[i, 0] * inverse_depth, fy * normals[i, 1] * inverse_depth
        found[i, 0], found[i, 1] = x, y
        found[i, 2] = -(x * points_cam[i, 0] + y * points_cam[i, 1]) * inverse_depth


def step_jacobian(points_cam: FloatArray, directions: FloatArray, centre_cam: FloatArray) -> FloatArray:
    """(n, 6) derivative of the motion along the normal by a pose step (w, v) about `centre_cam` (3,).

    `directions` are those of `image_directions`; a . (w x r) = w . (r x a).
    """
    jacobian = np.empty((len(points_cam), 6))
    _step_jacobian(plain(points_cam), plain(directions), plain(centre_cam), jacobian)
    return jacobian


@kernel("void(f8[:, ::1], f8[:, ::1], f8[::1], f8[:, ::1])")
def _step_jacobian(
    points_cam: FloatArray, directions: FloatArray, centre_cam: FloatArray, jacobian: FloatArray
) -> None:  # fmt: skip
    for i in range(len(points_cam)):
        x, y = points_cam[i, 0] - centre_cam[0], points_cam[i, 1] - centre_cam[1]
        z = points_cam[i, 2] - centre_cam[2]
        a, b, c = directions[i, 0], directions[i, 1], directions[i, 2]
        jacobian[i, 0], jacobian[i, 1], jacobian[i, 2] = y * c - z * b, z * a - x * c, x * b - y * a
        jacobian[i, 3], jacobian[i, 4], jacobian[i, 5] = a, b, c


def control_point_jacobian(points_cam: FloatArray, centre_cam: FloatArray, camera: Camera) -> FloatArray:
    """(8, 6) derivative of the image control points I (x1, y1, ..., y4) by a pose step.

    Args:
        points_cam: (4, 3) W in the camera frame, mm.
    """
    jacobian = np.empty((2 * len(points_cam), 6))
    _control_point_jacobian(plain(points_cam), plain(centre_cam), camera.fx, camera.fy, jacobian)
    return jacobian


@kernel("void(f8[:, ::1], f8[::1], f8, f8, f8[:, ::1])")
def _control_point_jacobian(
    points_cam: FloatArray, centre_cam: FloatArray, fx: float, fy: float, jacobian: FloatArray
) -> None:  # fmt: skip
    for i in range(len(points_cam)):
        x, y, z = points_cam[i, 0], points_cam[i, 1], points_cam[i, 2]
        across, down, back = x - centre_cam[0], y - centre_cam[1], z - centre_cam[2]
        for row in range(2):
            # The motion along x or y by a shift, then by a turn about the centre.
            a, b = (fx / z, 0.0) if row == 0 else (0.0, fy / z)
            c = -(a * x + b * y) / z
            jacobian[2 * i + row, 0] = down * c - back * b
            jacobian[2 * i + row, 1] = back * a - across * c
            jacobian[2 * i + row, 2] = across * b - down * a
            jacobian[2 * i + row, 3], jacobian[2 * i + row, 4], jacobian[2 * i + row, 5] = a, b, c
