"""The canonical frame: one eye with the real camera, and an exact homography back to its image."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from acp_lab.control_points.canonical_frame import CANONICAL_SIZE, FILL, canonical_frame, eye_position
from acp_lab.control_points.coplanar_points import MIN_SIDE_RATIO
from acp_lab.control_points.view_regions import ALL_REGIONS, choose_region, region_scores
from acp_lab.errors import GeometryError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.homography import apply_homography
from acp_lab.geometry.pose import inverse, make_pose, so3_exp, transform
from tests.geometry.geometry_strategies import directions
from tests.made_parts import bracket, looking_at

PART = bracket(shift=(300.0, -100.0, 50.0))
CENTRE, RADIUS = PART.box_centre, PART.radius
CAMERA = Camera(width=640, height=512, fx=600.0, fy=620.0, cx=319.5, cy=250.25)


@given(
    direction=directions(),
    distance=st.floats(1.05 * RADIUS, 20.0 * RADIUS),
    roll=st.floats(-np.pi, np.pi),
    aside=directions(),
    aside_rad=st.floats(0.0, 0.3),
    seed=st.integers(0, 1000),
)
def test_the_homography_is_exact_at_any_depth(
    direction: FloatArray, distance: float, roll: float, aside: FloatArray, aside_rad: float, seed: int
) -> None:
    cam_T_obj = looking_at(PART, direction, distance, roll)
    # The real camera need not look at the part: turned about its own eye.
    cam_T_obj = make_pose(so3_exp(aside_rad * aside), np.zeros(3)) @ cam_T_obj
    eye_obj = eye_position(cam_T_obj)
    region = choose_region(eye_obj - CENTRE, 0.5 * PART.box_size)
    frame = canonical_frame(eye_obj, CENTRE, RADIUS, ALL_REGIONS[region])
    points = CENTRE + np.random.default_rng(seed).uniform(-2.0, 2.0, (50, 3)) * RADIUS
    in_front = (transform(cam_T_obj, points)[:, 2] > 1.0) & (transform(frame.canonical_T_obj, points)[:, 2] > 1.0)
    points = points[in_front]
    assume(len(points) > 5)
    moved = apply_homography(frame.homography_to(CAMERA, cam_T_obj), frame.project(points))
    expected = CAMERA.project(transform(cam_T_obj, points))
    np.testing.assert_allclose(moved, expected, rtol=1e-7, atol=1e-6)


def test_its_matrix_and_its_projection_say_the_same() -> None:
    frame = canonical_frame(CENTRE + np.array([0.0, 10.0, 300.0]), CENTRE, RADIUS, ALL_REGIONS[4])
    camera = Camera.from_matrix(frame.matrix, frame.size, frame.size)
    points = PART.vertices
    np.testing.assert_allclose(frame.project(points), camera.project(transform(frame.canonical_T_obj, points)))


@given(direction=directions(), distance=st.floats(1.01 * RADIUS, 50.0 * RADIUS), size=st.sampled_from([64, 128]))
def test_the_bounding_sphere_fills_the_same_share_from_everywhere(
    direction: FloatArray, distance: float, size: int
) -> None:
    eye_obj = CENTRE + distance * direction
    region = ALL_REGIONS[choose_region(direction, 0.5 * PART.box_size)]
    frame = canonical_frame(eye_obj, CENTRE, RADIUS, region, size)
    # Rays from the eye touch the sphere on a circle.
    touch = CENTRE + RADIUS**2 / distance * direction
    across = RADIUS * np.sqrt(1.0 - (RADIUS / distance) ** 2)
    turn = frame.canonical_T_obj[:3, :3]
    angles = np.linspace(0.0, 2.0 * np.pi, 16)
    circle = touch + across * (np.cos(angles)[:, None] * turn[0] + np.sin(angles)[:, None] * turn[1])
    off = np.linalg.norm(frame.project(circle) - 0.5 * (size - 1), axis=1)
    np.testing.assert_allclose(off, FILL * size, rtol=1e-6)
    vertices = frame.project(PART.vertices)
    assert 0.0 < vertices.min() < vertices.max() < size - 1


@given(
    half_size=st.tuples(st.floats(1.0, 100.0), st.floats(1.0, 100.0), st.floats(1.0, 100.0)),
    aside=st.tuples(st.floats(-1.3, 1.3), st.floats(-1.3, 1.3)),  # as far as the overlap that is trained
    index=st.integers(0, 5),
)
def test_the_up_vector_is_nowhere_degenerate_in_its_region(
    half_size: tuple[float, float, float], aside: tuple[float, float], index: int
) -> None:
    half, region = np.maximum(half_size, MIN_SIDE_RATIO * max(half_size)), ALL_REGIONS[index]
    direction = half * np.roll([region.sign, *aside], region.axis)
    direction /= np.linalg.norm(direction)
    scores = region_scores(direction, half)
    assert 1.31 * scores[index] >= scores.max()
    radius = float(np.linalg.norm(half))
    frame = canonical_frame(4.0 * radius * direction, np.zeros(3), radius, region)
    turn = frame.canonical_T_obj[:3, :3]
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(turn) == pytest.approx(1.0)
    np.testing.assert_allclose(transform(frame.canonical_T_obj, np.zeros(3)), [0.0, 0.0, 4.0 * radius], atol=1e-6)
    # "Up" runs up the image, which is towards smaller y, and to no side.
    up = turn @ region.up_obj
    assert up[1] < 0.0
    assert abs(up[0]) < 1e-9


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0, np.nan])
def test_an_eye_inside_the_bounding_sphere_is_refused(share: float) -> None:
    eye_obj = CENTRE + np.array([0.0, 0.0, share * RADIUS])
    with pytest.raises(GeometryError, match="inside its bounding sphere"):
        canonical_frame(eye_obj, CENTRE, RADIUS, ALL_REGIONS[4])


@given(direction=directions(), roll=st.floats(-np.pi, np.pi))
def test_the_eye_is_the_cameras_centre(direction: FloatArray, roll: float) -> None:
    cam_T_obj = looking_at(PART, direction, 300.0, roll)
    np.testing.assert_allclose(eye_position(cam_T_obj), CENTRE + 300.0 * direction, atol=1e-9)
    np.testing.assert_allclose(eye_position(cam_T_obj), inverse(cam_T_obj)[:3, 3], atol=1e-9)


def test_the_bounding_sphere_is_92_percent_as_wide_as_the_image() -> None:
    """Networks are trained on it: smaller wastes pixels, larger leaves no room for jitter and for free coordinates."""
    eye_obj = CENTRE + np.array([0.0, 0.0, 300.0])
    frame = canonical_frame(eye_obj, CENTRE, RADIUS, ALL_REGIONS[4])
    # A ray that touches the sphere leaves the optical axis by asin(radius / distance).
    half_width_px = frame.focal_px * np.tan(np.arcsin(RADIUS / 300.0))
    assert 2.0 * half_width_px / frame.size == pytest.approx(0.92)


def test_the_default_size_is_small() -> None:
    assert (
        canonical_frame(CENTRE + np.array([0.0, 0.0, 300.0]), CENTRE, RADIUS, ALL_REGIONS[4]).size
        == CANONICAL_SIZE
        == 128
    )
