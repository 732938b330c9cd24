"""Polygons become triangles that fill them, once."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from acp_lab.cad.polygons import concave, ears
from acp_lab.errors import InputFileError

U_PROFILE = ((0, 0), (60, 0), (60, 40), (50, 40), (50, 10), (10, 10), (10, 40), (0, 40))


def _areas(corners: np.ndarray) -> np.ndarray:
    """Signed, of triangles (..., 3, 2)."""
    a, b = corners[..., 1, :] - corners[..., 0, :], corners[..., 2, :] - corners[..., 0, :]
    return 0.5 * (a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _area(profile: np.ndarray) -> float:
    x, y = profile.T
    return float(0.5 * (x * np.roll(y, -1) - y * np.roll(x, -1)).sum())


def _in_space(profile: np.ndarray, seed: int = 0) -> np.ndarray:
    """The profile (k, 2) somewhere in space, in a plane that is turned at random."""
    rng = np.random.default_rng(seed)
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return profile @ axes[:2] + 100.0 * rng.normal(size=3)


def _check_filled(profile: np.ndarray, triangles: np.ndarray) -> None:
    """As many triangles as it takes, none turned over, together as large as the polygon."""
    assert triangles.shape == (len(profile) - 2, 3)
    areas = _areas(profile[triangles])
    assert (areas > -1e-9).all()
    assert areas.sum() == pytest.approx(_area(profile))
    # Each side of the polygon is the side of one triangle, wound as the polygon is.
    sides = [side for a, b, c in triangles.tolist() for side in ((a, b), (b, c), (c, a))]
    for start in range(len(profile)):
        assert sides.count((start, (start + 1) % len(profile))) == 1


@pytest.mark.parametrize("start", range(len(U_PROFILE)))
@pytest.mark.parametrize("seed", range(4))
def test_a_channel_is_filled_from_every_corner(start: int, seed: int) -> None:
    profile = np.roll(np.array(U_PROFILE, dtype=float), start, axis=0)
    corners = _in_space(profile, seed)
    assert concave(corners, [list(range(8))]) == [0]
    _check_filled(profile, ears(corners, "part.obj"))


@given(st.integers(0, 2**32 - 1), st.integers(5, 40))
def test_stars_are_filled(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    angles = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    profile = rng.uniform(5.0, 30.0, (count, 1)) * np.column_stack([np.cos(angles), np.sin(angles)])
    _check_filled(profile, ears(_in_space(profile, seed), "part.obj"))


@given(st.integers(0, 2**32 - 1))
def test_corners_on_a_line_get_triangles_with_height(seed: int) -> None:
    """A side that has corners along it is the side of several walls, each of which needs its neighbour."""
    corners = np.array(U_PROFILE, dtype=float)
    shares = np.array([0.0, 0.3, 0.6])[:, None, None]
    profile = (corners + shares * (np.roll(corners, -1, axis=0) - corners)).transpose(1, 0, 2).reshape(-1, 2)
    rounded = _in_space(profile, seed).astype(np.float32).astype(float)
    triangles = ears(rounded, "part.obj")
    _check_filled(profile, triangles)
    assert (_areas(profile[triangles]) > 0.1).all()


def test_a_polygon_around_a_hole_that_runs_to_it_and_back() -> None:
    outer = [(0, 0), (40, 0), (40, 40), (0, 40)]
    inner = [(10, 10), (10, 30), (30, 30), (30, 10)]  # clockwise
    profile = np.array([*outer, outer[0], inner[0], *inner[1:], inner[0]], dtype=float)
    triangles = ears(_in_space(profile), "part.obj")
    areas = _areas(profile[triangles])
    assert (areas > -1e-9).all()
    assert areas.sum() == pytest.approx(40.0**2 - 20.0**2)


def test_what_a_fan_fills_is_no_concern() -> None:
    square = np.array([[0, 0, 0], [9, 0, 0], [9, 9, 0], [0, 9, 0]], dtype=float)
    dart = np.array([[0, 0, 5], [9, 9, 5], [0, 3, 5], [-9, 9, 5]], dtype=float)
    lost = np.full((4, 3), np.nan)
    points = np.concatenate([square, dart, lost])
    polygons = [[0, 1, 2], [0, 1, 2, 3], [5, 6, 7, 4], [6, 7, 4, 5], [8, 9, 10, 11], [0, 1, 1, 2]]
    assert concave(points, polygons) == [2]
    assert concave(points, []) == []


def test_a_polygon_that_crosses_itself() -> None:
    crossed = np.array([[0, 0, 0], [40, 20, 0], [40, 0, 0], [0, 21, 0], [-5, 10, 0]], dtype=float)
    with pytest.raises(InputFileError, match=r"part\.obj: a face of 5 corners crosses itself: export it as triangles"):
        ears(crossed, "part.obj")
