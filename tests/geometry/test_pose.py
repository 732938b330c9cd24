"""Rotations and poses: round trips, group laws, and agreement with slower twins."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from geometry_strategies import directions, poses, rotation_vectors, twists
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from acp_lab.errors import GeometryError
from acp_lab.geometry import (
    check_rotation,
    disturb_pose,
    interpolate,
    inverse,
    make_pose,
    rotation,
    rotation_angle_deg,
    se3_exp,
    se3_log,
    so3_exp,
    so3_log,
    transform,
    translation,
)
from acp_lab.geometry.arrays import FloatArray


def hat(xi: FloatArray) -> FloatArray:
    """The 4x4 matrix whose matrix exponential is se3_exp(xi)."""
    x, y, z, u, v, w = xi
    return np.array([[0, -z, y, u], [z, 0, -x, v], [-y, x, 0, w], [0, 0, 0, 0.0]])


# --- rotations --------------------------------------------------------------------------------------------


@given(rotation_vectors())
def test_log_undoes_exp(w: FloatArray) -> None:
    back = so3_log(so3_exp(w))
    # Near half a turn the axis may come back with the other sign: the rotations still agree.
    if np.linalg.norm(w) > math.pi - 1e-7 and w @ back < 0.0:
        back = back * (1.0 - 2.0 * math.pi / np.linalg.norm(back))
    np.testing.assert_allclose(back, w, rtol=1e-12, atol=1e-14)


@given(rotation_vectors(4.0 * math.pi))
def test_exp_undoes_log_even_past_half_a_turn(w: FloatArray) -> None:
    r = so3_exp(w)
    log = so3_log(r)
    assert np.linalg.norm(log) <= math.pi + 1e-15
    np.testing.assert_allclose(so3_exp(log), r, atol=3e-15)


@given(directions())
def test_half_a_turn_exactly(axis: FloatArray) -> None:
    r = 2.0 * np.outer(axis, axis) - np.eye(3)
    w = so3_log(r)
    assert np.linalg.norm(w) == pytest.approx(math.pi, abs=1e-12)
    np.testing.assert_allclose(so3_exp(w), r, atol=1e-14)


@given(rotation_vectors(4.0 * math.pi))
def test_exp_is_a_rotation(w: FloatArray) -> None:
    r = so3_exp(w)
    np.testing.assert_allclose(r.T @ r, np.eye(3), atol=1e-14)
    assert np.linalg.det(r) == pytest.approx(1.0, abs=1e-14)


@given(rotation_vectors())
def test_exp_agrees_with_scipy(w: FloatArray) -> None:
    np.testing.assert_allclose(so3_exp(w), Rotation.from_rotvec(w).as_matrix(), atol=3e-15)


@pytest.mark.parametrize("exponent", [-300, -160, -20, -9, -8, -7, -4, -2, -1])
def test_tiny_rotations_keep_all_digits(exponent: int) -> None:
    w = np.array([0.6, -0.48, 0.64]) * 10.0**exponent
    np.testing.assert_allclose(so3_log(so3_exp(w)), w, rtol=1e-13)


def test_directions_of_rotation() -> None:
    """A quarter turn about z takes x to y: the right-hand rule, also in OpenCV's axes."""
    np.testing.assert_allclose(so3_exp(np.array([0, 0, math.pi / 2])) @ [1, 0, 0], [0, 1, 0], atol=1e-15)


@given(rotation_vectors(), rotation_vectors())
def test_angle_between_rotations(a: FloatArray, b: FloatArray) -> None:
    ra, rb = so3_exp(a), so3_exp(b)
    angle = rotation_angle_deg(ra, rb)
    assert 0.0 <= angle <= 180.0
    assert angle == pytest.approx(rotation_angle_deg(rb, ra), abs=1e-9)
    assert angle == pytest.approx(math.degrees((Rotation.from_matrix(ra).inv() * Rotation.from_matrix(rb)).magnitude()))


@pytest.mark.parametrize("angle_deg", [0.0, 1e-9, 1e-6, 1.0, 90.0, 179.999999, 180.0])
def test_small_and_large_angles_keep_their_digits(angle_deg: float) -> None:
    r = so3_exp(np.array([0.3, -1.1, 0.4]))
    turned = so3_exp(math.radians(angle_deg) * np.array([0.0, 0.6, 0.8])) @ r
    assert rotation_angle_deg(r, turned) == pytest.approx(angle_deg, rel=1e-6, abs=1e-13)


# --- poses ------------------------------------------------------------------------------------------------


@given(twists())
def test_pose_log_undoes_exp(xi: FloatArray) -> None:
    back = se3_log(se3_exp(xi))
    if np.linalg.norm(xi[:3]) > math.pi - 1e-7 and xi[:3] @ back[:3] < 0.0:
        np.testing.assert_allclose(se3_exp(back), se3_exp(xi), atol=1e-9)
        return
    np.testing.assert_allclose(back[:3], xi[:3], rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(back[3:], xi[3:], rtol=1e-11, atol=1e-10)


@given(poses())
def test_pose_exp_undoes_log(pose: FloatArray) -> None:
    np.testing.assert_allclose(se3_exp(se3_log(pose)), pose, atol=1e-10)


@given(twists(largest=3.0))
def test_pose_exp_agrees_with_the_matrix_exponential(xi: FloatArray) -> None:
    xi = xi / (1.0, 1.0, 1.0, 1e3, 1e3, 1e3)
    np.testing.assert_allclose(se3_exp(xi), expm(hat(xi)), atol=1e-12)


@pytest.mark.parametrize("angle", [0.0999999, 0.1000001])
def test_series_and_formula_meet(angle: float) -> None:
    xi = np.array([angle * 0.6, angle * 0.8, 0.0, 100.0, -200.0, 300.0])
    np.testing.assert_allclose(se3_exp(xi), expm(hat(xi)), atol=1e-12)
    np.testing.assert_allclose(se3_log(se3_exp(xi)), xi, atol=1e-11)


@given(poses(), poses(), poses())
def test_group_laws(a: FloatArray, b: FloatArray, c: FloatArray) -> None:
    identity = np.eye(4)
    np.testing.assert_allclose(a @ inverse(a), identity, atol=1e-10)
    np.testing.assert_allclose(inverse(a) @ a, identity, atol=1e-10)
    np.testing.assert_allclose(inverse(a @ b), inverse(b) @ inverse(a), atol=1e-9)
    np.testing.assert_allclose((a @ b) @ c, a @ (b @ c), atol=1e-9)
    points = np.array([[1.0, 2.0, 3.0], [-50.0, 20.0, 7.0]])
    np.testing.assert_allclose(transform(a @ b, points), transform(a, transform(b, points)), atol=1e-9)


@given(twists(largest=1.0))
def test_exp_of_the_negative_is_the_inverse(xi: FloatArray) -> None:
    np.testing.assert_allclose(se3_exp(-xi), inverse(se3_exp(xi)), atol=1e-9)


def test_left_perturbation_moves_points_by_w_cross_p_plus_v() -> None:
    """The derivative that every pose Jacobian of the package rests on, against central differences."""
    cam_T_obj = make_pose(so3_exp(np.array([0.4, -0.3, 1.0])), np.array([10.0, -20.0, 500.0]))
    point_obj = np.array([30.0, -12.0, 8.0])
    p = transform(cam_T_obj, point_obj)
    expected = np.hstack([-np.array([[0, -p[2], p[1]], [p[2], 0, -p[0]], [-p[1], p[0], 0]]), np.eye(3)])
    numeric = np.empty((3, 6))
    for k, step in enumerate([1e-6] * 3 + [1e-3] * 3):
        xi = np.zeros(6)
        xi[k] = step
        ahead, behind = (transform(se3_exp(s * xi) @ cam_T_obj, point_obj) for s in (1.0, -1.0))
        numeric[:, k] = (ahead - behind) / (2.0 * step)
    np.testing.assert_allclose(numeric, expected, rtol=1e-6, atol=1e-6)


def test_parts_of_a_pose_are_views() -> None:
    pose = make_pose(np.eye(3), np.array([1.0, 2.0, 3.0]))
    rotation(pose)[0, 0] = 7.0
    translation(pose)[2] = 9.0
    assert (pose[0, 0], pose[2, 3]) == (7.0, 9.0)
    stack = np.stack([pose, pose])
    assert rotation(stack).shape == (2, 3, 3)
    assert translation(stack).shape == (2, 3)


def test_one_point_or_many() -> None:
    pose = make_pose(so3_exp(np.array([0.1, 0.2, 0.3])), np.array([1.0, 2.0, 3.0]))
    points = np.arange(12.0).reshape(4, 3)
    np.testing.assert_allclose(transform(pose, points)[2], transform(pose, points[2]), atol=1e-14)


@given(poses(), twists(largest=2.5), poses())
def test_interpolation_ends_and_does_not_depend_on_frames(a: FloatArray, xi: FloatArray, frame: FloatArray) -> None:
    b = a @ se3_exp(xi)
    np.testing.assert_allclose(interpolate(a, b, 0.0), a, atol=1e-9)
    np.testing.assert_allclose(interpolate(a, b, 1.0), b, atol=1e-8)
    middle = interpolate(a, b, 0.5)
    np.testing.assert_allclose(interpolate(a, middle, 2.0), b, atol=1e-8)
    np.testing.assert_allclose(interpolate(frame @ a, frame @ b, 0.5), frame @ middle, atol=1e-7)


# --- checks and noise -------------------------------------------------------------------------------------


@given(rotation_vectors(), st.floats(-2e-4, 2e-4), st.integers(0, 8))
def test_check_rotation_mends_rounding(w: FloatArray, error: float, where: int) -> None:
    r = so3_exp(w)
    rough = r.copy()
    rough.flat[where] += error
    cleaned = check_rotation(rough, "test")
    np.testing.assert_allclose(cleaned.T @ cleaned, np.eye(3), atol=1e-14)
    assert rotation_angle_deg(cleaned, r) < 0.03


@pytest.mark.parametrize(
    ("matrix", "word"),
    [
        (np.eye(4), "shape"),
        (np.zeros(9), "shape"),
        (np.eye(3) * 1.01, "not a rotation"),
        (np.zeros((3, 3)), "not a rotation"),
        (np.diag([1.0, 1.0, -1.0]), "mirrored"),
        (-np.eye(3), "mirrored"),
        (np.array([[1.0, 0.01, 0], [0, 1, 0], [0, 0, 1]]), "not a rotation"),
        (np.full((3, 3), np.nan), "not finite"),
        (np.full((3, 3), np.inf), "not finite"),
    ],
)
def test_check_rotation_refuses(matrix: FloatArray, word: str) -> None:
    with pytest.raises(GeometryError, match=rf"scene_gt.json, frame 3: .*{word}") as caught:
        check_rotation(matrix, "scene_gt.json, frame 3")
    assert "\n" not in str(caught.value)


@given(
    poses(),
    st.floats(0.0, 180.0),
    st.floats(0.0, 50.0),
    st.lists(st.floats(-200.0, 200.0), min_size=3, max_size=3),
    st.integers(0, 2**32),
)
def test_disturbance_is_exact(
    pose: FloatArray, angle_deg: float, shift_mm: float, centre: list[float], seed: int
) -> None:
    centre_obj = np.array(centre)
    noisy = disturb_pose(pose, centre_obj, angle_deg, shift_mm, np.random.default_rng(seed))
    assert rotation_angle_deg(pose[:3, :3], noisy[:3, :3]) == pytest.approx(angle_deg, abs=1e-6)
    moved = np.linalg.norm(transform(noisy, centre_obj) - transform(pose, centre_obj))
    assert moved == pytest.approx(shift_mm, abs=1e-9)
    check_rotation(noisy[:3, :3], "noisy")


def test_disturbance_repeats_with_its_seed_and_keeps_its_directions() -> None:
    pose, centre = make_pose(np.eye(3), np.array([0.0, 0.0, 500.0])), np.array([3.0, 4.0, 5.0])

    def draw(angle_deg: float, shift_mm: float) -> FloatArray:
        return disturb_pose(pose, centre, angle_deg, shift_mm, np.random.default_rng([7, 1, 2]))

    np.testing.assert_array_equal(draw(5.0, 3.0), draw(5.0, 3.0))
    np.testing.assert_allclose(2.0 * so3_log(draw(5.0, 3.0)[:3, :3]), so3_log(draw(10.0, 0.0)[:3, :3]), atol=1e-12)
    np.testing.assert_allclose(draw(0.0, 0.0), pose, atol=1e-12)


def test_disturbance_prefers_no_direction() -> None:
    rng = np.random.default_rng(0)
    pose = make_pose(np.eye(3), np.array([0.0, 0.0, 500.0]))
    moves = np.array([se3_log(disturb_pose(pose, np.zeros(3), 1.0, 1.0, rng) @ inverse(pose))[:3] for _ in range(3000)])
    axes = np.rad2deg(moves)
    assert np.abs(axes.mean(axis=0)).max() < 0.05
    np.testing.assert_allclose(np.cov(axes.T), np.eye(3) / 3.0, atol=0.03)


def test_cv2_speaks_the_same_rotation_vectors(rng: np.random.Generator) -> None:
    for w in rng.normal(size=(20, 3)):
        np.testing.assert_allclose(so3_exp(w), cv2.Rodrigues(w)[0], atol=1e-14)
