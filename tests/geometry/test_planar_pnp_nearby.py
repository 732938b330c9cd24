"""Planar PnP from a pose nearby finds what the search from nothing finds, or says that it leads nowhere."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from acp_lab.geometry import Camera, make_pose, se3_exp, so3_exp, solve_planar_pnp, transform
from acp_lab.geometry.planar_pnp_nearby import planar_pnp_nearby

CAMERA = Camera(640, 512, 600.0, 620.0, 319.5, 250.25)
W = np.array([[-30.0, -20.0, 5.0], [30.0, -22.0, 5.0], [28.0, 20.0, 5.0], [-30.0, 24.0, 5.0]])
TILTED = make_pose(so3_exp(np.array([0.5, -0.4, 0.9])), np.array([20.0, -15.0, 300.0]))


def seen(pose: np.ndarray) -> np.ndarray:
    return CAMERA.project(transform(pose, W))


def error(pose: np.ndarray, points: np.ndarray) -> float:
    """px^2: what planar PnP makes small."""
    return float(((seen(pose) - points) ** 2).sum())


@given(
    st.floats(0.3, 1.0),
    st.floats(-3.0, 3.0),
    st.floats(-3.0, 3.0),
    st.floats(0.0, 0.05),
    st.floats(0.0, 3.0),
    st.integers(0, 10_000),
)
def test_it_is_the_pose_that_the_search_from_nothing_finds(
    tilt: float, about: float, roll: float, away: float, pull_px: float, seed: int
) -> None:
    """Points of a pose near the start, pulled a little off any view of W, as an optimiser's I is."""
    rng = np.random.default_rng(seed)
    turn = so3_exp(tilt * np.array([np.cos(about), np.sin(about), 0.0])) @ so3_exp(np.array([0.0, 0.0, roll]))
    pose = make_pose(turn, np.array([*rng.uniform(-30.0, 30.0, 2), rng.uniform(250.0, 500.0)]))
    near = pose @ se3_exp(away * rng.uniform(-1.0, 1.0, 6) * (1.0, 1.0, 1.0, 100.0, 100.0, 100.0))
    points = seen(pose) + pull_px * rng.uniform(-1.0, 1.0, (4, 2))
    start, both = near.copy(), solve_planar_pnp(W, points, CAMERA)
    # A plane that is seen nearly head-on has two poses so close that neither is "the" one nearby.
    assume(np.abs(both.poses[0] - both.poses[1])[:3, :3].max() > 0.3)
    found = planar_pnp_nearby(W, points, CAMERA, near)
    assert found is not None
    np.testing.assert_array_equal(near, start)
    same = both.nearest(near)
    # Where the plane is seen nearly head-on the error is flat, and cv2's refinement stops some 1e-5 rad before its
    # foot; the other pose lies 0.3 away.
    np.testing.assert_allclose(found, same, rtol=1e-5, atol=1e-3)
    assert error(found, points) < error(same, points) + 1e-9, "cv2's refinement stops a little earlier"


def test_at_a_view_of_w_it_is_exact() -> None:
    near = TILTED @ se3_exp(np.array([0.03, 0.02, -0.05, 3.0, -2.0, 5.0]))
    found = planar_pnp_nearby(W, seen(TILTED), CAMERA, near)
    assert found is not None
    np.testing.assert_allclose(found, TILTED, atol=1e-9)


def test_each_branch_stays_its_own() -> None:
    """From either of the two poses of a plane the refinement goes back to it, not to the other."""
    points = seen(TILTED) + np.array([[0.6, -0.4], [0.1, 0.3], [-0.5, 0.2], [0.3, -0.2]])
    for pose in solve_planar_pnp(W, points, CAMERA).poses:
        found = planar_pnp_nearby(W, points, CAMERA, pose @ se3_exp(np.array([0.01, 0.01, 0.0, 0.2, 0.1, 0.5])))
        assert found is not None
        np.testing.assert_allclose(found, pose, atol=1e-3)
        assert error(found, points) < error(pose, points) + 1e-12


@pytest.mark.parametrize(
    "points",
    [
        seen(TILTED)[[0, 2, 1, 3]],
        seen(TILTED)[::-1],
        np.column_stack([np.linspace(200.0, 400.0, 4), np.full(4, 250.0)]),
        np.full((4, 2), 300.0),
        np.full((4, 2), np.nan),
        np.array([[300.0, 200.0], [np.inf, 200.0], [400.0, 300.0], [300.0, 300.0]]),
    ],
    ids=["folded", "mirrored", "collinear", "one place", "nan", "infinite"],
)
def test_what_is_no_view_leads_nowhere(points: np.ndarray) -> None:
    assert planar_pnp_nearby(W, points, CAMERA, TILTED) is None


def test_a_pose_behind_the_camera_leads_nowhere() -> None:
    behind = make_pose(np.eye(3), np.array([0.0, 0.0, -300.0]))
    assert planar_pnp_nearby(W, seen(TILTED), CAMERA, behind) is None
