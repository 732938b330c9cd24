"""Notebook 01: cameras, poses, homographies and why four points."""

from __future__ import annotations

from typing import Any

import numpy as np

from acp_lab.control_points.coplanar_points import mid_section_points
from acp_lab.control_points.view_regions import ALL_REGIONS
from acp_lab.course.answers import Hint, as_array, as_function
from acp_lab.course.grader import exercise
from acp_lab.course.workshop import SAMPLE_REGION, sample_part, sample_scene
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import make_pose, so3_exp, transform

SHIFT_MM = 10.0
CLOSE_PX = 0.05


def sample_points_obj() -> FloatArray:
    """W (4, 3) mm of the region in which the sample is seen."""
    part = sample_part()
    return mid_section_points(part.box_min, part.box_max, ALL_REGIONS[SAMPLE_REGION].axis)


@exercise("01.1")
def project_by_hand(answer: Any) -> str:
    """project(camera, cam_T_obj, points_obj) -> (n, 2) px, judged on poses and cameras of the grader's own."""
    project = as_function(answer, "a function project(camera, cam_T_obj, points_obj)")
    rng = np.random.default_rng(7)
    for _ in range(5):
        camera = Camera(640, 512, *rng.uniform(500.0, 900.0, 2), *rng.uniform(200.0, 300.0, 2))
        pose = make_pose(so3_exp(rng.normal(size=3)), np.array([20.0, -30.0, 500.0]))
        points_obj = rng.uniform(-50.0, 50.0, (12, 3))
        found = as_array(project(camera, pose, points_obj), (12, 2), "one pixel (x, y) for each point, (n, 2)")
        _compare_projections(found, camera, pose, points_obj)
    return "This is Camera.project: rotate and shift into the camera's frame, divide by depth, scale, shift."


def _compare_projections(found: FloatArray, camera: Camera, pose: FloatArray, points_obj: FloatArray) -> None:
    points_cam = transform(pose, points_obj)
    if _close(found, camera.project(points_cam)):
        return
    x, y, z = points_cam.T
    if _close(found, np.column_stack([camera.fx * x + camera.cx, camera.fy * y + camera.cy])):
        raise Hint("Something far away must look smaller: where does the depth come in?")
    if _close(found, np.column_stack([camera.fx * x / z, camera.fy * y / z])):
        raise Hint("The shape is right, the place is not: the optical axis does not hit the image at pixel (0, 0).")
    if _close(found, camera.project(points_cam)[:, ::-1]):
        raise Hint("A pixel is (x, y), column first; yours look swapped.")
    turned = points_obj @ pose[:3, :3] + pose[:3, 3]
    if _close(found, camera.project(turned)):
        raise Hint("The rotation goes the wrong way: for points in rows it is multiplied from the right, transposed.")
    if _close(found, camera.project(points_obj + pose[:3, 3])):
        raise Hint("The shift is there, the rotation is missing.")
    turned = points_obj @ pose[:3, :3].T
    with np.errstate(divide="ignore", invalid="ignore"):  # points behind the camera are no pixels to `project`
        by_hand = (
            camera.fx * turned[:, :1] / turned[:, 2:] + camera.cx,
            camera.fy * turned[:, 1:2] / turned[:, 2:] + camera.cy,
        )
    if _close(found, np.hstack(by_hand)):
        raise Hint("The rotation is there, the shift is missing.")
    raise Hint(
        "Some pixels are off. Take one point through the steps: object frame, camera frame, divide by depth, "
        "focal lengths, principal point."
    )


@exercise("01.2")
def points_of_a_shifted_part(answer: Any) -> str:
    """The control points I of frame 0, had the part moved 10 mm along the camera's x axis."""
    found = as_array(answer, (4, 2), "the four control points, (4, 2) px")
    frame, pose = sample_scene().frame(0), sample_scene().first_pose
    camera, points_obj = sample_scene().camera(frame.index), sample_points_obj()
    step = np.array([SHIFT_MM, 0.0, 0.0])

    def seen(rotation: FloatArray, shift: FloatArray) -> FloatArray:
        return camera.project(transform(make_pose(rotation, shift), points_obj))

    rotation, shift = pose[:3, :3], pose[:3, 3]
    if _close(found, seen(rotation, shift + step)):
        return "The nearer points moved further: that is perspective, and it is what tells depth."
    if _close(found, seen(rotation, shift)):
        raise Hint("These are the points before the part moved.")
    if _close(found, seen(rotation, shift - step)):
        raise Hint("That is the other way: x points to the right in the image.")
    if _close(found, seen(rotation, shift + rotation @ step)):
        raise Hint("You moved the part along its own x axis; ask for the camera's: on which side of cam_T_obj?")
    if _close(found, camera.project(transform(pose, points_obj)) + step[:2]):
        raise Hint("You moved the pixels by ten; it is the part that moves, by ten millimetres.")
    raise Hint("Shift the pose first (its translation is in mm, camera axes), then project W with frame 0's camera.")


def _close(a: FloatArray, b: FloatArray) -> bool:
    return bool(np.isfinite(b).all()) and bool(np.abs(a - b).max() < CLOSE_PX)
