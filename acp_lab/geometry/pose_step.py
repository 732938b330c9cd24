"""A small step of a pose, and the Jacobians of image points and control points by it.

A pose step is six numbers about the part's own centre: rotation vector w (rad) and shift v (mm), in camera axes.
About the centre, because the origin of a CAD file may lie far outside the part; about it, rotation and shift mix.
"""

from __future__ import annotations

import numpy as np

from acp_lab.geometry.arrays import FloatArray
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
    inverse_depth = 1.0 / points_cam[:, 2]
    ax = camera.fx * normals[:, 0] * inverse_depth
    ay = camera.fy * normals[:, 1] * inverse_depth
    az = -(ax * points_cam[:, 0] + ay * points_cam[:, 1]) * inverse_depth
    return np.stack([ax, ay, az], 1)


def step_jacobian(points_cam: FloatArray, directions: FloatArray, centre_cam: FloatArray) -> FloatArray:
    """(n, 6) derivative of the motion along the normal by a pose step (w, v) about `centre_cam` (3,).

    `directions` are those of `image_directions`; a . (w x r) = w . (r x a).
    """
    arms = points_cam - centre_cam
    jacobian = np.empty((len(points_cam), 6))
    jacobian[:, 0] = arms[:, 1] * directions[:, 2] - arms[:, 2] * directions[:, 1]
    jacobian[:, 1] = arms[:, 2] * directions[:, 0] - arms[:, 0] * directions[:, 2]
    jacobian[:, 2] = arms[:, 0] * directions[:, 1] - arms[:, 1] * directions[:, 0]
    jacobian[:, 3:] = directions
    return jacobian


def control_point_jacobian(points_cam: FloatArray, centre_cam: FloatArray, camera: Camera) -> FloatArray:
    """(8, 6) derivative of the image control points I (x1, y1, ..., y4) by a pose step.

    Args:
        points_cam: (4, 3) W in the camera frame, mm.
    """
    # Each point twice, once along x and once along y.
    points_twice = np.repeat(points_cam, 2, axis=0)
    along = image_directions(points_twice, np.tile(np.eye(2), (4, 1)), camera)
    return step_jacobian(points_twice, along, centre_cam)
