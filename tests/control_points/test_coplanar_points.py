"""The control points W: coplanar, in order, and never a sliver."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from acp_lab.control_points.coplanar_points import MIN_SIDE_RATIO, mid_section_points
from acp_lab.geometry.homography import check_quad

LOW, HIGH = np.array([-10.0, 5.0, 100.0]), np.array([50.0, 45.0, 130.0])


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_they_are_the_corners_of_the_middle_section(axis: int) -> None:
    points = mid_section_points(LOW, HIGH, axis)
    assert points.shape == (4, 3)
    np.testing.assert_allclose(points[:, axis], 0.5 * (LOW + HIGH)[axis])
    for other in {0, 1, 2} - {axis}:
        np.testing.assert_allclose(np.sort(points[:, other]), np.repeat([LOW[other], HIGH[other]], 2))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_they_run_around_the_rectangle(axis: int) -> None:
    points = mid_section_points(LOW, HIGH, axis)
    sides = np.roll(points, -1, 0) - points
    # Neighbouring sides are perpendicular, and all turns are about +axis.
    np.testing.assert_allclose(np.einsum("ij,ij->i", sides, np.roll(sides, -1, 0)), 0.0, atol=1e-9)
    assert (np.cross(sides, np.roll(sides, -1, 0))[:, axis] > 0.0).all()


@given(
    size=st.tuples(st.floats(0.01, 500.0), st.floats(0.01, 500.0), st.floats(0.01, 500.0)),
    axis=st.integers(0, 2),
)
def test_they_are_coplanar_and_make_a_proper_quad(size: tuple[float, float, float], axis: int) -> None:
    points = mid_section_points(np.zeros(3), np.array(size), axis)
    centred = points - points.mean(0)
    assert np.linalg.matrix_rank(centred, tol=1e-9 * max(size)) == 2
    flat = points[:, [(axis + 1) % 3, (axis + 2) % 3]]
    shown = 100.0 * flat / np.ptp(flat, axis=0).max()
    check_quad(shown, minimum_px=20.0)


def test_a_plates_section_is_widened_to_a_quarter_of_its_length() -> None:
    points = mid_section_points(np.array([-50.0, -50.0, -0.5]), np.array([50.0, 50.0, 0.5]), 0)
    assert np.ptp(points[:, 1]) == pytest.approx(100.0)
    assert np.ptp(points[:, 2]) == pytest.approx(MIN_SIDE_RATIO * 100.0)
    np.testing.assert_allclose(points.mean(0), 0.0, atol=1e-12)
