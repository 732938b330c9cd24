"""PnP from points in any arrangement: exact data gives the pose back, bad data says what is wrong."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from acp_lab.errors import GeometryError
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.point_pnp import solve_point_pnp
from acp_lab.geometry.pose import make_pose, rotation_angle_deg, so3_exp, transform

POINTS = np.array([[0.0, 0, 0], [40, 0, 0], [0, 30, 0], [0, 0, 20], [35, 25, 15], [10, 30, 20]])


@given(st.integers(0, 10_000), st.integers(4, 6))
def test_exact_points_give_the_pose_back(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    camera = Camera(640, 512, 600.0, 620.0, 319.5, 250.25)
    turn = so3_exp(rng.uniform(-1.5, 1.5, 3))
    pose = make_pose(turn, np.array([*rng.uniform(-60.0, 60.0, 2), rng.uniform(250.0, 500.0)]))
    points = POINTS[rng.permutation(6)[:count]] if count > 4 else POINTS[:4]
    found = solve_point_pnp(points, camera.project(transform(pose, points)), camera)
    assert found.rms_px < 1e-4
    # Four points can leave a second exact pose; all that is asked of them is an exact fit.
    if count > 4:
        assert rotation_angle_deg(found.cam_T_obj[:3, :3], turn) < 1e-3
        np.testing.assert_allclose(found.cam_T_obj[:3, 3], pose[:3, 3], atol=1e-2)


def test_noise_is_spread_over_the_points(camera: Camera, rng: np.random.Generator) -> None:
    pose = make_pose(so3_exp(np.array([0.4, -0.3, 0.2])), np.array([5.0, -8.0, 300.0]))
    pixels = camera.project(transform(pose, POINTS)) + rng.normal(0.0, 1.0, (6, 2))
    found = solve_point_pnp(POINTS, pixels, camera)
    assert found.reprojection_px.shape == (6,)
    assert found.rms_px < 1.5
    assert rotation_angle_deg(found.cam_T_obj[:3, :3], pose[:3, :3]) < 3.0


@pytest.mark.parametrize(
    ("points", "pixels", "reason"),
    [
        (POINTS[:3], np.zeros((3, 2)), "needs 4 points, there are 3"),
        (POINTS[:4], np.zeros((3, 2)), r"\(4, 3\) and pixels \(3, 2\)"),
        (np.outer(np.arange(4.0), [1, 2, 3]), np.eye(4)[:, :2] * 50, "all 4 points are collinear"),
        (POINTS[:4], np.outer(np.arange(4.0), [5, 3]), "all 4 pixels are collinear"),
        (POINTS[:4], np.full((4, 2), np.nan), "not finite"),
    ],
)
def test_what_gives_no_pose(points: np.ndarray, pixels: np.ndarray, reason: str, camera: Camera) -> None:
    with pytest.raises(GeometryError, match=reason):
        solve_point_pnp(points, pixels, camera)
