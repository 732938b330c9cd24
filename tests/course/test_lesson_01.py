"""The graders of notebook 01."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab import course
from acp_lab.course.lesson_01 import sample_points_obj
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import make_pose, transform
from tests.course.grading import hints, passes


def project(camera, cam_T_obj, points_obj):  # type: ignore[no-untyped-def]
    return camera.project(transform(cam_T_obj, points_obj))


def test_projection() -> None:
    passes("01.1", project)
    passes("01.1", lambda *given: project(*given).tolist())


def unshifted(camera: Camera, pose: np.ndarray, points: np.ndarray) -> np.ndarray:
    x, y, z = (points @ pose[:3, :3].T).T
    return np.column_stack([camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy])


@pytest.mark.parametrize(
    ("wrong", "fragment"),
    [
        (
            lambda camera, pose, points: (
                (transform(pose, points) * [camera.fx, camera.fy, 1.0])[:, :2] + [camera.cx, camera.cy]
            ),
            "depth",
        ),
        (lambda camera, pose, points: project(camera, pose, points) - [camera.cx, camera.cy], "optical axis"),
        (lambda camera, pose, points: project(camera, pose, points)[:, ::-1], "column first"),
        (lambda camera, pose, points: camera.project(points @ pose[:3, :3] + pose[:3, 3]), "transposed"),
        (lambda camera, pose, points: camera.project(points + pose[:3, 3]), "rotation is missing"),
        (unshifted, "shift is missing"),
        (lambda camera, pose, points: project(camera, pose, points) + 1.0, "some pixels are off"),
        (lambda camera, pose, points: project(camera, pose, points).T, "one pixel (x, y) for each point"),
        (lambda camera, pose, points: np.full((len(points), 2), np.nan), "not finite"),
        (lambda camera: camera, "stopped with TypeError"),
        (lambda camera, pose, points: None, "return"),
        (np.zeros((12, 2)), "the function itself"),
    ],
)
def test_wrong_projections(wrong, fragment: str) -> None:  # type: ignore[no-untyped-def]
    hints("01.1", wrong, fragment)


def shifted(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    scene = course.sample_scene()
    return project(scene.camera(0), left @ scene.first_pose @ right, sample_points_obj())


STEP = make_pose(np.eye(3), np.array([10.0, 0.0, 0.0]))
BACK = np.linalg.inv(STEP)
NONE = np.eye(4)


def test_points_of_a_shifted_part() -> None:
    passes("01.2", shifted(STEP, NONE))
    hints("01.2", shifted(NONE, NONE), "before the part moved")
    hints("01.2", shifted(BACK, NONE), "the other way")
    hints("01.2", shifted(NONE, STEP), "its own x axis")
    hints("01.2", shifted(NONE, NONE) + np.array([10.0, 0.0]), "moved the pixels")
    hints("01.2", shifted(STEP, NONE)[::-1], "project W")
    hints("01.2", shifted(STEP, NONE)[:3], "(4, 2)")
    hints("01.2", "left", "no array of numbers")


def test_hints_do_not_give_the_answer_away() -> None:
    right = shifted(STEP, NONE)
    said = hints("01.2", right + 3.0)
    assert not any(f"{value:.0f}" in said for value in right.ravel())
