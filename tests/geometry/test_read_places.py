"""Where pictures show what moves while they are read."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import transform
from acp_lab.geometry.pose_step import move_pose
from acp_lab.geometry.rolling_shutter import read_places
from tests.made_parts import bracket, looking_at

CAMERA = Camera(width=640, height=480, fx=800.0, fy=810.0, cx=321.0, cy=238.5)
PART = bracket()
POSE = looking_at(PART, np.array([0.8, 0.6, 1.0]), 300.0, 0.3)
POINTS_OBJ = PART.vertices
POINTS = CAMERA.project(transform(POSE, POINTS_OBJ))
# Some 20 px a frame, across and along the rows, and a spin of 4 degrees.
MOTION = np.array([0.04, -0.05, 0.03, 5.0, -6.0, 3.0])


def read(motion: FloatArray, readout: tuple[float, float], pose: FloatArray = POSE) -> FloatArray:
    return read_places(POINTS, POINTS_OBJ, pose, PART.box_centre, CAMERA, motion, np.array(readout))


@pytest.mark.parametrize("readout", [(0.0, 0.9), (0.0, -0.9), (0.7, 0.0), (0.0, 0.3)])
def test_a_point_shows_where_it_is_when_its_own_row_is_read(readout: tuple[float, float]) -> None:
    centre = CAMERA.project(transform(POSE, PART.box_centre)[None])[0]
    late = np.array(readout) / [CAMERA.width, CAMERA.height]
    expected = np.empty_like(POINTS)
    for i, point_obj in enumerate(POINTS_OBJ):
        place = POINTS[i]
        for _ in range(30):  # until the row that reads it is the one where it is
            pose = move_pose(POSE, PART.box_centre, float((place - centre) @ late) * MOTION)
            place = CAMERA.project(transform(pose, point_obj)[None])[0]
        expected[i] = place
    off = np.linalg.norm(expected - POINTS, axis=1)
    assert off.max() > 0.7
    # To second order: what is shown elsewhere is read by another row.
    assert np.linalg.norm(read(MOTION, readout) - expected, axis=1).max() < 0.06 * off.max()


def test_what_rests_and_what_is_read_at_once_shows_where_it_is() -> None:
    np.testing.assert_allclose(read(np.zeros(6), (0.0, 0.9)), POINTS, atol=1e-9)
    np.testing.assert_allclose(read(MOTION, (0.0, 0.0)), POINTS, atol=1e-9)


def test_it_is_what_the_plain_formula_says() -> None:
    cam, middle = transform(POSE, POINTS_OBJ), transform(POSE, PART.box_centre)
    time = (POINTS - CAMERA.project(middle[None])) @ (np.array([0.2, 0.6]) / [CAMERA.width, CAMERA.height])
    then = cam + time[:, None] * (MOTION[3:] + np.cross(MOTION[:3], cam - middle))
    expected = POINTS + CAMERA.project(then) - CAMERA.project(cam)
    np.testing.assert_allclose(read(MOTION, (0.2, 0.6)), expected, atol=1e-9)


def test_a_part_that_moves_down_is_longer_and_one_that_moves_up_shorter() -> None:
    height = np.ptp(POINTS[:, 1])
    down, up = (np.ptp(read(np.array([0.0, 0.0, 0.0, 0.0, way, 0.0]), (0.0, 0.9))[:, 1]) for way in (8.0, -8.0))
    assert down > 1.03 * height
    assert up < 0.97 * height


def test_points_behind_the_camera_stay() -> None:
    behind, level = POSE.copy(), POSE.copy()
    behind[2, 3] = -300.0
    level[2, 3] -= transform(POSE, PART.box_centre)[2] + 1.0  # the centre is behind it, some points are not
    for pose in (behind, level):
        np.testing.assert_array_equal(read(MOTION, (0.0, 0.9), pose), POINTS)
