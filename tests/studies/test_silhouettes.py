"""Outer contours, their profiles, and the similarity that lays one on another."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from acp_lab.cad.raycast import make_caster
from acp_lab.errors import GeometryError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import rotation_angle_deg, transform
from acp_lab.studies.silhouettes import (
    CONTOUR_POINTS,
    PROFILE_BINS,
    ImageAlignment,
    align_contours,
    contour_distance,
    mask_contour,
    outer_contour,
    profile_distances,
    radial_profile,
)
from tests.made_parts import box, bracket, looking_at

CAMERA = Camera(128, 128, 400.0, 400.0, 63.5, 63.5)
BIN_RAD = 2.0 * np.pi / PROFILE_BINS


def kite() -> FloatArray:
    """A contour without symmetry, all of it seen from its middle."""
    angle = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    reach = 30.0 + 8.0 * np.cos(angle) + 5.0 * np.sin(2.0 * angle) + 4.0 * np.cos(3.0 * angle)
    return 60.0 + reach[:, None] * np.stack([np.cos(angle), np.sin(angle)], 1)


def test_the_contour_of_a_box_seen_head_on_is_its_face() -> None:
    part = box((40.0, 30.0, 20.0))
    pose = looking_at(part, np.array([0.0, 0.0, 1.0]), 200.0)
    contour = outer_contour(part, make_caster(part), CAMERA, pose)
    assert contour.shape == (CONTOUR_POINTS, 2)
    corners = CAMERA.project(transform(pose, part.vertices[part.vertices[:, 2] > 0]))
    np.testing.assert_allclose(contour.min(0), corners.min(0), atol=1.0)
    np.testing.assert_allclose(contour.max(0), corners.max(0), atol=1.0)
    steps = np.linalg.norm(np.diff(contour, axis=0), axis=1)
    assert steps.max() < 1.2 * np.median(steps)


def test_holes_and_smaller_regions_are_left_out() -> None:
    mask = np.zeros((60, 60), bool)
    mask[10:50, 10:40] = True
    mask[20:30, 20:30] = False
    mask[5:8, 50:55] = True
    contour = mask_contour(mask, count=500)
    np.testing.assert_allclose([contour.min(0), contour.max(0)], [[10.0, 10.0], [39.0, 49.0]])
    on_border = np.isclose(contour, [10.0, 10.0]) | np.isclose(contour, [39.0, 49.0])
    assert on_border.any(1).all()
    with pytest.raises(GeometryError, match="not in the image"):
        mask_contour(np.zeros((5, 5), bool))


@given(bins=st.integers(0, PROFILE_BINS - 1), scale=st.floats(0.5, 2.0))
def test_profiles_find_the_turn_whatever_the_scale(bins: int, scale: float) -> None:
    contour = kite()
    back = ImageAlignment(-bins * BIN_RAD, scale, (0.0, 0.0), (7.0, -3.0)).apply(contour)
    distances = profile_distances(radial_profile(contour), radial_profile(back)[None])[0]
    assert distances.argmin() == bins
    assert distances.min() < 2e-3 < np.median(distances)


def test_profile_distances_are_the_mean_squares_of_rolled_profiles() -> None:
    rng = np.random.default_rng(0)
    one, others = radial_profile(kite()), rng.uniform(0.5, 1.5, (3, PROFILE_BINS))
    others /= np.sqrt((others**2).mean(1, keepdims=True))
    expected = [[((one - np.roll(other, j)) ** 2).mean() for j in range(PROFILE_BINS)] for other in others]
    np.testing.assert_allclose(profile_distances(one, others), expected, atol=1e-12)


@given(angle=st.floats(-np.pi, np.pi), scale=st.floats(0.7, 1.4), x=st.floats(-20.0, 20.0))
def test_alignment_undoes_a_similarity(angle: float, scale: float, x: float) -> None:
    contour = kite()[::3]
    moved = ImageAlignment(angle, scale, (60.0, 60.0), (60.0 + x, 50.0)).apply(contour)
    found = align_contours(moved, contour, round(-angle / BIN_RAD))
    assert contour_distance(found.apply(moved), contour) < 0.6
    assert found.scale == pytest.approx(1.0 / scale)


@given(angle=st.floats(-3.0, 3.0), scale=st.floats(0.8, 1.25), x=st.floats(-4.0, 4.0))
def test_the_aligned_pose_shows_the_aligned_image(angle: float, scale: float, x: float) -> None:
    part = bracket(shift=(5.0, 9.0, -3.0))
    pose = looking_at(part, np.array([0.5, -0.3, 1.0]), 3000.0)
    camera = Camera(128, 128, 6000.0, 6000.0, 63.5, 63.5)
    alignment = ImageAlignment(angle, scale, (70.0, 60.0), (70.0 + x, 61.0))
    moved = alignment.of_pose(pose, part.box_centre, camera)
    expected = alignment.apply(camera.project(transform(pose, part.vertices)))
    np.testing.assert_allclose(camera.project(transform(moved, part.vertices)), expected, atol=0.5)
    assert rotation_angle_deg(pose[:3, :3], moved[:3, :3]) == pytest.approx(np.degrees(abs(angle)), abs=1e-4)


def test_contour_distance_is_a_mean_both_ways() -> None:
    assert contour_distance(np.array([[0.0, 0.0]]), np.array([[3.0, 4.0], [0.0, 1.0]])) == pytest.approx(
        0.5 * (1.0 + (5.0 + 1.0) / 2.0)
    )
