"""A small step of a pose, and every Jacobian of what follows it against finite differences."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import rotation_angle_deg, so3_exp, transform
from acp_lab.geometry.pose_step import (
    centre_position,
    control_point_jacobian,
    image_directions,
    move_pose,
    pose_step_between,
    step_jacobian,
)
from tests.geometry.geometry_strategies import directions
from tests.made_parts import box, looking_at

CAMERA = Camera(width=640, height=512, fx=600.0, fy=620.0, cx=319.5, cy=250.25)
PART = box(shift=(500.0, -200.0, 100.0))
CENTRE = PART.box_centre
POSES = [looking_at(PART, np.array(way), 250.0, roll) for way, roll in (((1, 0.5, 0.2), 0.4), ((-0.3, 0.2, -1), 2.0))]
numbers = st.floats(-1.0, 1.0)


def random_normals(count: int, seed: int) -> FloatArray:
    angles = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, count)
    return np.stack([np.cos(angles), np.sin(angles)], 1)


def points_of_part(count: int, seed: int) -> FloatArray:
    return CENTRE + np.random.default_rng(seed).uniform(-0.5, 0.5, (count, 3)) * PART.box_size


# ---- the pose step -------------------------------------------------------------------------------------------


@given(turn=directions(), angle_rad=st.floats(0.0, 3.0), shift=st.tuples(numbers, numbers, numbers))
def test_a_step_turns_about_the_parts_centre_and_then_shifts(
    turn: FloatArray, angle_rad: float, shift: tuple[float, float, float]
) -> None:
    pose = POSES[0]
    moved = move_pose(pose, CENTRE, np.concatenate([angle_rad * turn, shift]))
    np.testing.assert_allclose(centre_position(moved, CENTRE), centre_position(pose, CENTRE) + shift, atol=1e-9)
    np.testing.assert_allclose(moved[:3, :3], so3_exp(angle_rad * turn) @ pose[:3, :3], atol=1e-12)
    assert rotation_angle_deg(moved[:3, :3], pose[:3, :3]) == pytest.approx(np.degrees(angle_rad), abs=1e-6)
    np.testing.assert_array_equal(moved[3], [0.0, 0.0, 0.0, 1.0])


def test_no_step_leaves_the_pose() -> None:
    np.testing.assert_allclose(move_pose(POSES[1], CENTRE, np.zeros(6)), POSES[1], atol=1e-12)


@given(turn=directions(), angle_rad=st.floats(0.0, 3.0), shift=st.tuples(numbers, numbers, numbers))
def test_the_step_between_two_poses_takes_one_to_the_other(
    turn: FloatArray, angle_rad: float, shift: tuple[float, float, float]
) -> None:
    step = np.concatenate([angle_rad * turn, 100.0 * np.array(shift)])
    for pose in POSES:
        moved = move_pose(pose, CENTRE, step)
        np.testing.assert_allclose(pose_step_between(pose, moved, CENTRE), step, atol=1e-6)
        np.testing.assert_allclose(move_pose(pose, CENTRE, pose_step_between(pose, moved, CENTRE)), moved, atol=1e-6)
        np.testing.assert_allclose(pose_step_between(moved, pose, CENTRE), -step, atol=1e-6)


# ---- Jacobians -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("pose", POSES, ids=["first", "second"])
@given(seed=st.integers(0, 10_000))
def test_image_directions_against_finite_differences(pose: FloatArray, seed: int) -> None:
    points, normals = transform(pose, points_of_part(20, seed)), random_normals(20, seed)
    found = image_directions(points, normals, CAMERA)
    for axis in range(3):
        step = 1e-4 * np.eye(3)[axis]
        change = (CAMERA.project(points + step) - CAMERA.project(points - step)) / 2e-4
        np.testing.assert_allclose(found[:, axis], (change * normals).sum(1), rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("pose", POSES, ids=["first", "second"])
@given(seed=st.integers(0, 10_000))
def test_step_jacobian_against_finite_differences(pose: FloatArray, seed: int) -> None:
    points, normals = points_of_part(20, seed), random_normals(20, seed)
    points_cam = transform(pose, points)
    found = step_jacobian(points_cam, image_directions(points_cam, normals, CAMERA), centre_position(pose, CENTRE))
    assert found.shape == (20, 6)
    for k in range(6):
        step = 1e-5 * np.eye(6)[k]
        ahead, behind = (CAMERA.project(transform(move_pose(pose, CENTRE, s * step), points)) for s in (1.0, -1.0))
        np.testing.assert_allclose(found[:, k], ((ahead - behind) * normals).sum(1) / 2e-5, rtol=1e-5, atol=1e-3)


@given(direction=directions(), distance=st.floats(150.0, 900.0), roll=st.floats(-3.0, 3.0), seed=st.integers(0, 1000))
def test_control_point_jacobian_against_finite_differences(
    direction: FloatArray, distance: float, roll: float, seed: int
) -> None:
    pose, points = looking_at(PART, direction, distance, roll), points_of_part(4, seed)
    found = control_point_jacobian(transform(pose, points), centre_position(pose, CENTRE), CAMERA)
    assert found.shape == (8, 6)
    for k in range(6):
        step = 1e-5 * np.eye(6)[k]
        ahead, behind = (CAMERA.project(transform(move_pose(pose, CENTRE, s * step), points)) for s in (1.0, -1.0))
        np.testing.assert_allclose(found[:, k], (ahead - behind).ravel() / 2e-5, rtol=1e-5, atol=1e-3)
