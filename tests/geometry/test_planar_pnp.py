"""Planar PnP: exact data comes back to 1e-9, both solutions are kept, what is no view is refused."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from geometry_strategies import directions, poses
from hypothesis import assume, given
from hypothesis import strategies as st

from acp_lab.errors import GeometryError
from acp_lab.geometry import (
    Camera,
    PlanarPnP,
    inverse,
    make_pose,
    rotation_angle_deg,
    se3_exp,
    so3_exp,
    solve_planar_pnp,
    transform,
)
from acp_lab.geometry.arrays import FloatArray

CAMERA = Camera(640, 512, 600.0, 620.0, 319.5, 250.25)
W = np.array([[-30.0, -20.0, 0.0], [30.0, -20.0, 0.0], [30.0, 20.0, 0.0], [-30.0, 20.0, 0.0]])


def off(pose: FloatArray, truth: FloatArray) -> float:
    """The larger of rotation error in rad and translation error as a share of the distance."""
    shift = float(np.linalg.norm(pose[:3, 3] - truth[:3, 3]) / np.linalg.norm(truth[:3, 3]))
    return max(math.radians(rotation_angle_deg(pose[:3, :3], truth[:3, :3])), shift)


def view(
    tilt_rad: float, roll_rad: float, place: list[float], flipped: bool, tilt_about_rad: float = 0.0
) -> FloatArray:
    """cam_T_plane with its normal at tilt_rad from the line of sight."""
    shift = np.array(place)
    sight = shift / np.linalg.norm(shift)
    # The shortest turn from the camera's axis to the line of sight.
    axis = np.array([-sight[1], sight[0], 0.0])
    sine = float(np.linalg.norm(axis))
    towards = so3_exp(axis / sine * math.asin(sine)) if sine > 0.0 else np.eye(3)
    about = np.array([math.cos(tilt_about_rad), math.sin(tilt_about_rad), 0.0])
    flip = so3_exp(np.array([math.pi if flipped else 0.0, 0.0, 0.0]))
    return make_pose(towards @ so3_exp(tilt_rad * about) @ so3_exp(np.array([0, 0, roll_rad])) @ flip, shift)


@st.composite
def quads_obj(draw: st.DrawFn) -> tuple[FloatArray, FloatArray]:
    """Four coplanar points (4, 3) on any plane of the object, mm, and obj_T_plane."""
    jitter = st.floats(-0.25, 0.25)
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    flat = (corners + np.array([[draw(jitter), draw(jitter)] for _ in range(4)])) * draw(st.floats(5.0, 60.0))
    obj_T_plane = draw(poses())
    obj_T_plane = make_pose(obj_T_plane[:3, :3], obj_T_plane[:3, 3] / 40.0)
    return transform(obj_T_plane, np.column_stack([flat, np.zeros(4)])), obj_T_plane


tilts = st.one_of(st.just(0.0), st.floats(0.0, 1e-3), st.floats(0.0, 1.4), st.floats(1.4, 1.5))
places = st.tuples(st.floats(-0.3, 0.3), st.floats(-0.25, 0.25), st.floats(200.0, 1500.0)).map(
    lambda p: [p[0] * p[2], p[1] * p[2], p[2]]
)
turns = st.one_of(st.sampled_from([0.0, math.pi / 2, math.pi, -math.pi]), st.floats(-math.pi, math.pi))


@given(quads_obj(), tilts, turns, turns, places, st.booleans())
def test_exact_views_come_back(
    quad: tuple[FloatArray, FloatArray],
    tilt: float,
    about: float,
    roll: float,
    place: list[float],
    flipped: bool,
) -> None:
    """Head-on to grazing (86 degrees), either side of the plane, every roll, anywhere in the image."""
    points_obj, obj_T_plane = quad
    truth = view(tilt, roll, place, flipped, about) @ inverse(obj_T_plane)
    points_cam = transform(truth, points_obj)
    assume(points_cam[:, 2].min() > 50.0)
    found = solve_planar_pnp(points_obj, CAMERA.project(points_cam), CAMERA)
    assert found.poses.shape == (2, 4, 4)
    assert found.reprojection_px[0] <= found.reprojection_px[1]
    assert found.reprojection_px[0] < 1e-9
    assert off(found.nearest(truth), truth) < 1e-9
    for pose, error in zip(found.poses, found.reprojection_px, strict=True):
        residual = CAMERA.project(transform(pose, points_obj)) - CAMERA.project(points_cam)
        assert math.sqrt((residual**2).sum() / 4.0) == pytest.approx(error, abs=1e-9)


@pytest.mark.parametrize("place", [[0.0, 0.0, 500.0], [50.5, -59.7, 1314.6], [-80.0, 60.0, 250.0]])
@pytest.mark.parametrize("roll", [0.0, 0.8, math.pi / 2, math.pi, 3.0])
@pytest.mark.parametrize("flipped", [False, True])
def test_parallel_to_the_image_on_either_side(place: list[float], roll: float, flipped: bool) -> None:
    """Turned by half a turn, cv2's IPPE alone is off by up to 7 degrees."""
    flip = so3_exp(np.array([math.pi if flipped else 0.0, 0.0, 0.0]))
    truth = make_pose(so3_exp(np.array([0.0, 0.0, roll])) @ flip, np.array(place))
    found = solve_planar_pnp(W, CAMERA.project(transform(truth, W)), CAMERA)
    assert off(found.poses[0], truth) < 1e-9


def test_the_mirrored_tilt_is_kept_and_the_prior_decides() -> None:
    """A small plane far away: towards and away differ by hundredths of a px, and noise swaps them."""
    truth = make_pose(so3_exp(np.array([0.0, 0.4, 0.0])), np.array([5.0, -3.0, 1500.0]))
    rng = np.random.default_rng(3)
    best_is_right = []
    for _ in range(40):
        seen = CAMERA.project(transform(truth, W)) + rng.normal(0.0, 0.3, (4, 2))
        found = solve_planar_pnp(W, seen, CAMERA)
        assert rotation_angle_deg(found.poses[0][:3, :3], found.poses[1][:3, :3]) > 15.0
        prior = se3_exp(np.array([0.03, -0.02, 0.02, 4.0, 3.0, -10.0])) @ truth
        assert rotation_angle_deg(found.nearest(prior)[:3, :3], truth[:3, :3]) < 20.0
        best_is_right.append(bool(rotation_angle_deg(found.poses[0][:3, :3], truth[:3, :3]) < 20.0))
    assert 5 < sum(best_is_right) < 35, "this view was meant to be ambiguous"


def test_nearest_weighs_shift_as_the_angle_it_is_seen_under() -> None:
    prior = make_pose(np.eye(3), np.array([0.0, 0.0, 1000.0]))
    turned = make_pose(so3_exp(np.array([0.1, 0.0, 0.0])), prior[:3, 3])  # 0.1 rad
    for shift_mm, winner in ((90.0, "shifted"), (110.0, "turned")):
        shifted = make_pose(np.eye(3), np.array([shift_mm, 0.0, 1000.0]))
        for pair in ((turned, shifted), (shifted, turned)):
            nearest = PlanarPnP(np.stack(pair), np.zeros(2)).nearest(prior)
            np.testing.assert_array_equal(nearest, {"turned": turned, "shifted": shifted}[winner])


def test_noise_is_averaged_as_well_as_four_points_can() -> None:
    """The kept poses are minima: no small motion lowers the reprojection error."""
    rng = np.random.default_rng(1)
    truth = view(0.6, 0.5, [20.0, -30.0, 400.0], False)
    seen = CAMERA.project(transform(truth, W)) + rng.normal(0.0, 0.5, (4, 2))
    found = solve_planar_pnp(W, seen, CAMERA)

    def rms(pose: FloatArray) -> float:
        return math.sqrt(((CAMERA.project(transform(pose, W)) - seen) ** 2).sum() / 4.0)

    for pose, error in zip(found.poses, found.reprojection_px, strict=True):
        assert rms(pose) == pytest.approx(error)
        for k in range(6):
            for sign in (-1.0, 1.0):
                xi = np.zeros(6)
                xi[k] = sign * (1e-4 if k < 3 else 1e-2)
                assert rms(se3_exp(xi) @ pose) > error - 1e-9


@given(st.permutations([0, 1, 2, 3]), directions())
def test_any_order_of_the_corners_will_do(order: list[int], axis: FloatArray) -> None:
    """W need not go around the quad: a crossing order is fine when the image has the same."""
    turned = W[order] @ so3_exp(0.7 * axis).T
    truth = view(0.7, 0.3, [10.0, 20.0, 500.0], False) @ make_pose(so3_exp(0.7 * axis).T, np.zeros(3))
    found = solve_planar_pnp(turned, CAMERA.project(transform(truth, turned)), CAMERA)
    assert off(found.poses[0], truth) < 1e-9


def test_inputs_are_left_alone() -> None:
    points, seen = W.copy(), CAMERA.project(transform(view(0.4, 0.1, [0, 0, 400.0], False), W))
    before = seen.copy()
    solve_planar_pnp(points, seen, CAMERA)
    np.testing.assert_array_equal(points, W)
    np.testing.assert_array_equal(seen, before)


@pytest.mark.parametrize("rounded", [lambda w: w.astype(np.float32), lambda w: w.round(3)])
def test_rounded_points_are_still_coplanar(rounded: Callable[[FloatArray], FloatArray]) -> None:
    tilted = rounded(W @ so3_exp(np.array([0.5, -0.8, 0.3])).T + (1000.0, 50.0, -20.0))
    truth = make_pose(so3_exp(np.array([0.2, 0.3, 0.1])), np.array([-900.0, 0.0, 900.0]))
    found = solve_planar_pnp(tilted, CAMERA.project(transform(truth, tilted)), CAMERA)
    assert off(found.nearest(truth), truth) < 1e-4


SEEN = CAMERA.project(transform(view(0.5, 0.2, [10.0, 20.0, 600.0], False), W))


@pytest.mark.parametrize(
    ("points_obj", "points_image", "word"),
    [
        (np.vstack([W[:3], W[3:] + 0.1]), SEEN, "not coplanar"),
        (W * [1.0, 0.0, 0.0], SEEN, "collinear or all in one place"),
        (np.zeros((4, 3)), SEEN, "collinear or all in one place"),
        (W[[0, 0, 1, 2]], SEEN, "three are collinear"),
        (np.vstack([W[:3], [(W[0] + W[1]) / 2]]), SEEN, "three are collinear"),
        (W, SEEN[[0, 0, 1, 2]], "three collinear"),
        (W, np.vstack([SEEN[:3], [(SEEN[0] + SEEN[1]) / 2]]), "three collinear"),
        (W, np.zeros((4, 2)), "three collinear"),
        (W, SEEN[[0, 2, 1, 3]], "folded"),
        (W, np.vstack([SEEN[:3], [SEEN[:3].mean(axis=0)]]), "folded"),
        (W, SEEN * np.nan, "not finite"),
        (np.full((4, 3), np.inf), SEEN, "not finite"),
        (W[:3], SEEN[:3], "shape"),
        (W, SEEN.ravel(), "shape"),
        (W[:, :2], SEEN, "shape"),
    ],
)
def test_what_is_no_view_of_a_plane_is_refused(points_obj: FloatArray, points_image: FloatArray, word: str) -> None:
    with pytest.raises(GeometryError, match=word) as caught:
        solve_planar_pnp(points_obj, points_image, CAMERA)
    assert "\n" not in str(caught.value)


@given(st.lists(st.floats(-2000.0, 3000.0), min_size=8, max_size=8))
def test_any_image_points_give_finite_poses_or_a_geometry_error(numbers: list[float]) -> None:
    """Free control points wander: whatever they are, nothing else may come out."""
    try:
        found = solve_planar_pnp(W, np.array(numbers).reshape(4, 2), CAMERA)
    except GeometryError:
        return
    assert np.isfinite(found.poses).all()
    assert np.isfinite(found.reprojection_px).all()
    for pose in found.poses:
        assert transform(pose, W)[:, 2].min() > 0.0
        np.testing.assert_allclose(pose[:3, :3].T @ pose[:3, :3], np.eye(3), atol=1e-9)


@pytest.mark.parametrize("tilt_deg", np.linspace(-60.0, 60.0, 49).tolist())
def test_a_quad_that_lies_symmetric_in_the_image_has_a_pose(tilt_deg: float) -> None:
    """A square turned about the vertical in the middle of the image: at -25 and 20 degrees cv2's IPPE says NaN."""
    camera = Camera(320, 240, 400.0, 400.0, 159.5, 119.5)
    square = np.array([[-20.0, -20.0, 0.0], [-20.0, 20.0, 0.0], [20.0, 20.0, 0.0], [20.0, -20.0, 0.0]])
    for axis in (0, 1):
        turn = np.zeros(3)
        turn[axis] = np.radians(tilt_deg)
        pose = make_pose(so3_exp(turn), np.array([0.0, 0.0, 300.0]))
        found = solve_planar_pnp(square, camera.project(transform(pose, square)), camera)
        np.testing.assert_allclose(found.nearest(pose), pose, atol=2e-3)
