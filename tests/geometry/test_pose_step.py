"""Gauss-Newton on the pose: every Jacobian against finite differences, the step against least squares."""

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
    step_jacobian,
)
from acp_lab.tracking.gauss_newton import gauss_newton_step
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


# ---- the step ------------------------------------------------------------------------------------------------


@given(seed=st.integers(0, 10_000), damping=st.sampled_from([0.0, 1e-3, 1.0, 100.0]))
def test_the_step_is_the_damped_least_squares_solution(seed: int, damping: float) -> None:
    rng = np.random.default_rng(seed)
    jacobian, residuals = rng.standard_normal((40, 6)), rng.standard_normal(40)
    weights, control = rng.uniform(0.0, 2.0, 40), rng.standard_normal((8, 6))
    share = np.sqrt(weights / weights.sum())
    rows = np.concatenate([share[:, None] * jacobian, np.sqrt(damping) * control])
    right = np.concatenate([share * residuals, np.zeros(8)])
    expected = np.linalg.lstsq(rows, right, rcond=None)[0]
    np.testing.assert_allclose(
        gauss_newton_step(jacobian, residuals, weights, control, damping), expected, rtol=1e-6, atol=1e-9
    )


def test_weights_count_relative_to_each_other_only() -> None:
    rng = np.random.default_rng(0)
    jacobian, residuals, weights = rng.standard_normal((20, 6)), rng.standard_normal(20), rng.uniform(0.1, 1.0, 20)
    control = rng.standard_normal((8, 6))
    first, second = (gauss_newton_step(jacobian, residuals, c * weights, control, 0.1) for c in (1.0, 1e-6))
    np.testing.assert_allclose(first, second)


@pytest.mark.parametrize("count", [0, 5])
def test_without_weight_there_is_no_step(count: int) -> None:
    step = gauss_newton_step(np.ones((count, 6)), np.ones(count), np.zeros(count), np.ones((8, 6)), 0.1)
    np.testing.assert_array_equal(step, np.zeros(6))


def test_few_samples_move_the_part_no_further_than_they_say() -> None:
    """Two samples cannot fix six degrees of freedom: the damping keeps the rest still, in control-point pixels."""
    pose = POSES[0]
    centre_cam = centre_position(pose, CENTRE)
    points_cam = transform(pose, points_of_part(2, 1))
    jacobian = step_jacobian(points_cam, image_directions(points_cam, random_normals(2, 1), CAMERA), centre_cam)
    control = control_point_jacobian(transform(pose, points_of_part(4, 2)), centre_cam, CAMERA)
    step = gauss_newton_step(jacobian, np.array([1.0, -1.0]), np.ones(2), control, 2e-3)
    assert np.abs(control @ step).max() < 10.0


def test_repeated_steps_find_the_pose_again() -> None:
    truth, seed = POSES[0], 3
    points, normals = points_of_part(60, seed), random_normals(60, seed)
    seen = CAMERA.project(transform(truth, points))
    pose = move_pose(truth, CENTRE, np.array([0.05, -0.04, 0.03, 2.0, -1.0, 5.0]))
    for _ in range(6):
        points_cam, centre_cam = transform(pose, points), centre_position(pose, CENTRE)
        residuals = ((seen - CAMERA.project(points_cam)) * normals).sum(1)
        jacobian = step_jacobian(points_cam, image_directions(points_cam, normals, CAMERA), centre_cam)
        control = control_point_jacobian(transform(pose, points[:4]), centre_cam, CAMERA)
        pose = move_pose(pose, CENTRE, gauss_newton_step(jacobian, residuals, np.ones(60), control, 1e-6))
    np.testing.assert_allclose(transform(pose, points), transform(truth, points), atol=1e-4)
