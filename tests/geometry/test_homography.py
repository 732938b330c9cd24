"""Homographies of four points against kornia and autograd, and the quads that have none."""

from __future__ import annotations

import numpy as np
import pytest
from geometry_strategies import convex_quads
from hypothesis import assume, given
from hypothesis import strategies as st

from acp_lab.errors import GeometryError
from acp_lab.geometry import (
    apply_homography,
    check_quad,
    homography_from_points,
    homography_points_jacobian,
)
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.homography import QuadWarp, corner_areas, extent, homography_system

SQUARE = np.array([[100.0, 100.0], [300.0, 100.0], [300.0, 250.0], [100.0, 250.0]])
MOVED = np.array([[103.0, 98.0], [305.0, 101.0], [298.0, 254.0], [100.5, 252.5]])


def inside(quad: FloatArray) -> FloatArray:
    """Points spread over the inside of a convex quad."""
    weights = np.random.default_rng(0).dirichlet(np.ones(4), 20)
    return weights @ quad


# --- H ----------------------------------------------------------------------------------------------------


@given(convex_quads(), convex_quads())
def test_corners_land_where_they_should(src: FloatArray, dst: FloatArray) -> None:
    h = homography_from_points(src, dst)
    assert h[2, 2] == 1.0
    np.testing.assert_allclose(apply_homography(h, src), dst, rtol=1e-9, atol=1e-7)


@given(convex_quads(0.1), convex_quads(0.1))
def test_there_and_back(src: FloatArray, dst: FloatArray) -> None:
    points = inside(src)
    there = apply_homography(homography_from_points(src, dst), points)
    back = apply_homography(homography_from_points(dst, src), there)
    np.testing.assert_allclose(back, points, rtol=1e-8, atol=1e-6)


@given(convex_quads(0.1), convex_quads(0.1), convex_quads(0.1))
def test_homographies_compose(a: FloatArray, b: FloatArray, c: FloatArray) -> None:
    points = inside(a)
    by_way = apply_homography(homography_from_points(b, c), apply_homography(homography_from_points(a, b), points))
    np.testing.assert_allclose(apply_homography(homography_from_points(a, c), points), by_way, rtol=1e-7, atol=1e-5)


def test_no_motion_is_the_identity() -> None:
    np.testing.assert_allclose(homography_from_points(SQUARE, SQUARE), np.eye(3), atol=1e-12)


def test_a_shift_is_a_shift() -> None:
    h = homography_from_points(SQUARE, SQUARE + np.array([7.0, -3.0]))
    np.testing.assert_allclose(h, [[1, 0, 7], [0, 1, -3], [0, 0, 1]], atol=1e-10)


def test_the_paper_equation_gives_the_same_numbers() -> None:
    """The 8x8 system in raw pixels, as printed, is the slow and less exact twin."""
    system, moved = homography_system(SQUARE, MOVED)
    assert system[0].tolist() == [100, 100, 1, 0, 0, 0, -103.0 * 100, -103.0 * 100]
    assert system[7].tolist() == [0, 0, 0, 100, 250, 1, -252.5 * 100, -252.5 * 250]
    assert moved.tolist() == MOVED.ravel().tolist()
    raw = np.append(np.linalg.solve(system, moved), 1.0).reshape(3, 3)
    np.testing.assert_allclose(homography_from_points(SQUARE, MOVED), raw, rtol=1e-7, atol=1e-9)


@given(convex_quads(0.1), convex_quads(0.1))
def test_kornia_agrees(src: FloatArray, dst: FloatArray) -> None:
    import torch
    from kornia.geometry.transform import get_perspective_transform

    h = homography_from_points(src, dst)
    other = get_perspective_transform(torch.from_numpy(src)[None], torch.from_numpy(dst)[None])[0].numpy()
    points = inside(src)
    np.testing.assert_allclose(apply_homography(h, points), apply_homography(other, points), rtol=1e-6, atol=1e-4)


def test_points_on_the_horizon_are_infinite_without_a_warning() -> None:
    h = np.array([[1.0, 0, 0], [0, 1, 0], [-0.01, 0, 1]])
    moved = apply_homography(h, np.array([[100.0, 50.0], [0.0, 0.0]]))
    assert np.isinf(moved[0]).all()
    assert moved[1].tolist() == [0.0, 0.0]


def test_a_homography_without_h33_is_refused() -> None:
    # x -> (1 / x, y / x) sends the origin's column to infinity.
    src = np.array([[1.0, -1.0], [2.0, -1.0], [2.0, 1.0], [1.0, 1.0]])
    dst = np.column_stack([1.0 / src[:, 0], src[:, 1] / src[:, 0]])
    with pytest.raises(GeometryError, match="H33 = 0"):
        homography_from_points(src, dst)


# --- its Jacobian -----------------------------------------------------------------------------------------


@given(convex_quads(0.1), convex_quads(0.1))
def test_jacobian_against_finite_differences(src: FloatArray, dst: FloatArray) -> None:
    points = inside(src)
    jacobian = homography_points_jacobian(src, dst, points)
    assert jacobian.shape == (20, 2, 8)
    step = 1e-5 * extent(dst)
    for k in range(8):
        ahead, behind = dst.copy(), dst.copy()
        ahead.flat[k] += step
        behind.flat[k] -= step
        numeric = (
            apply_homography(homography_from_points(src, ahead), points)
            - apply_homography(homography_from_points(src, behind), points)
        ) / (2.0 * step)
        np.testing.assert_allclose(jacobian[:, :, k], numeric, rtol=1e-4, atol=1e-4)


def test_jacobian_against_autograd() -> None:
    import torch
    from kornia.geometry.linalg import transform_points
    from kornia.geometry.transform import get_perspective_transform

    points = np.append(inside(SQUARE), [[20.0, 400.0], [600.0, 10.0]], axis=0)

    def moved(dst: torch.Tensor) -> torch.Tensor:
        h = get_perspective_transform(torch.from_numpy(SQUARE)[None], dst[None])
        return transform_points(h, torch.from_numpy(points)[None])[0]

    twin = torch.autograd.functional.jacobian(moved, torch.from_numpy(MOVED)).numpy().reshape(-1, 2, 8)
    np.testing.assert_allclose(homography_points_jacobian(SQUARE, MOVED, points), twin, rtol=1e-6, atol=1e-8)


@given(convex_quads(), convex_quads())
def test_corners_follow_themselves_alone(src: FloatArray, dst: FloatArray) -> None:
    jacobian = homography_points_jacobian(src, dst, src).reshape(8, 8)
    np.testing.assert_allclose(jacobian, np.eye(8), atol=1e-6)


@given(convex_quads(0.1), convex_quads(0.1))
def test_moving_all_corners_alike_moves_all_points_alike(src: FloatArray, dst: FloatArray) -> None:
    jacobian = homography_points_jacobian(src, dst, inside(src))
    np.testing.assert_allclose(jacobian[:, :, 0::2].sum(axis=2), np.tile([1.0, 0.0], (20, 1)), atol=1e-7)
    np.testing.assert_allclose(jacobian[:, :, 1::2].sum(axis=2), np.tile([0.0, 1.0], (20, 1)), atol=1e-7)


# --- points that hang on four ------------------------------------------------------------------------------


@given(convex_quads(0.1), convex_quads(0.1))
def test_hanging_points_go_where_the_homography_takes_them(src: FloatArray, dst: FloatArray) -> None:
    points = inside(src)
    warped = QuadWarp(src, points).to(dst)
    expected = apply_homography(homography_from_points(src, dst), points)
    np.testing.assert_allclose(warped.points, expected, rtol=1e-7, atol=1e-6)


@given(convex_quads(0.1), convex_quads(0.1))
def test_tangents_of_hanging_points_against_differences(src: FloatArray, dst: FloatArray) -> None:
    points = inside(src)
    angle = np.linspace(0.0, 2.0 * np.pi, len(points), endpoint=False)
    tangents = np.column_stack([np.cos(angle), np.sin(angle)])
    homography, reach = homography_from_points(src, dst), 1e-6 * extent(src) * tangents
    way = apply_homography(homography, points + reach) - apply_homography(homography, points - reach)
    # What is nearly flattened has a direction that differences cannot tell.
    assume(np.linalg.norm(way, axis=1).min() > 1e-9 * extent(dst))
    expected = way / np.linalg.norm(way, axis=1)[:, None]
    np.testing.assert_allclose(QuadWarp(src, points).to(dst).tangents(tangents), expected, atol=1e-3)


def test_a_middle_sent_to_infinity_is_refused() -> None:
    middle_away = np.array([[0.0, 0.0], [0.0, 1.0], [2.0, 0.0], [2.0, 1.0]])
    with pytest.raises(GeometryError, match="infinity"):
        QuadWarp(SQUARE, SQUARE).to(middle_away)
    with pytest.raises(GeometryError, match="infinity"):
        homography_from_points(SQUARE, middle_away)


def test_three_in_line_have_no_warp() -> None:
    line = np.array([[0.0, 0.0], [50.0, 50.0], [100.0, 100.0], [0.0, 100.0]])
    with pytest.raises(GeometryError, match="source"):
        QuadWarp(line, SQUARE)
    with pytest.raises(GeometryError, match="destination"):
        QuadWarp(SQUARE, SQUARE).to(line)


# --- quads ------------------------------------------------------------------------------------------------

LINE = np.array([[0.0, 0.0], [50.0, 50.0], [100.0, 100.0], [0.0, 100.0]])
BOW_TIE = SQUARE[[0, 2, 1, 3]]
ARROW = np.array([[0.0, 0.0], [100.0, 0.0], [20.0, 20.0], [0.0, 100.0]])


@given(convex_quads())
def test_convex_quads_pass_in_both_directions(quad: FloatArray) -> None:
    heights = [abs(a) / extent(quad[[i - 1, i, (i + 1) % 4]]) for i, a in enumerate(corner_areas(quad))]
    assume(min(heights) > 0.1)
    np.testing.assert_array_equal(check_quad(quad, minimum_px=0.1), quad)
    check_quad(quad[::-1], minimum_px=0.1)
    check_quad(np.roll(quad, 1, axis=0), minimum_px=0.1)


@pytest.mark.parametrize(
    ("points", "word"),
    [
        (LINE, "points 0, 1, 2 are collinear"),
        (np.roll(LINE, 1, axis=0), "points 1, 2, 3 are collinear"),
        (np.roll(LINE, 2, axis=0), "points 0, 2, 3 are collinear"),
        (np.roll(LINE, 3, axis=0), "points 0, 1, 3 are collinear"),
        (SQUARE[[0, 0, 1, 2]], "collinear"),
        (SQUARE * 1e-3, "tiny"),
        (np.zeros((4, 2)), "tiny"),
        (BOW_TIE, "folded"),
        (ARROW, "folded"),
        (np.full((4, 2), np.nan), "not finite"),
        (np.vstack([SQUARE[:3], [[np.inf, 0.0]]]), "not finite"),
        (SQUARE[:3], "shape"),
        (SQUARE.ravel(), "shape"),
    ],
)
def test_bad_quads_are_named(points: FloatArray, word: str) -> None:
    with pytest.raises(GeometryError, match=rf"control points.*{word}") as caught:
        check_quad(points, where="control points")
    assert "\n" not in str(caught.value)


def test_the_minimum_is_the_height_of_the_flattest_corner() -> None:
    flat = np.array([[0.0, 0.0], [100.0, 0.0], [100.0, 2.0], [0.0, 2.0]])
    check_quad(flat, minimum_px=1.9)
    with pytest.raises(GeometryError, match="degenerate"):
        check_quad(flat, minimum_px=2.1)


@pytest.mark.parametrize("flat", [LINE, np.zeros((4, 2)), SQUARE[[0, 0, 1, 2]], np.full((4, 2), np.nan)])
def test_no_homography_from_or_to_a_line(flat: FloatArray) -> None:
    for src, dst in ((flat, SQUARE), (SQUARE, flat)):
        with pytest.raises(GeometryError):
            homography_from_points(src, dst)
        with pytest.raises(GeometryError):
            homography_points_jacobian(src, dst, SQUARE)


@pytest.mark.parametrize("gap", [1e-1, 1e-3, 1e-5])
def test_nearly_flat_quads_still_have_a_homography(gap: float) -> None:
    """Control points of a plane seen almost edge-on: ill-conditioned, yet the corners must be met."""
    sliver = np.array([[0.0, 0.0], [100.0, gap], [200.0, 0.0], [100.0, -gap]]) + np.array([800.0, 600.0])
    np.testing.assert_allclose(apply_homography(homography_from_points(SQUARE, sliver), SQUARE), sliver, atol=1e-6)
    back = apply_homography(homography_from_points(sliver, SQUARE), sliver)
    np.testing.assert_allclose(back, SQUARE, atol=1e-5 / gap**0.5)


@pytest.mark.parametrize("quad", [BOW_TIE, ARROW])
def test_homographies_do_not_need_convex_quads(quad: FloatArray) -> None:
    dst = quad * (1.5, 0.7) + (10.0, 20.0)
    np.testing.assert_allclose(apply_homography(homography_from_points(quad, dst), quad), dst, atol=1e-9)


@given(st.integers(0, 10_000))
def test_rows_along_directions_are_the_jacobian_along_them(seed: int) -> None:
    rng = np.random.default_rng(seed)
    src = np.array([[0.0, 0.0], [90.0, 5.0], [95.0, 70.0], [-5.0, 60.0]]) + rng.uniform(-8.0, 8.0, (4, 2))
    warped = QuadWarp(src, rng.uniform(0.0, 80.0, (30, 2))).to(src * 1.2 + rng.uniform(-9.0, 9.0, (4, 2)) + 40.0)
    directions = rng.normal(size=(30, 2))
    expected = np.einsum("nj,njk->nk", directions, warped.jacobian())
    np.testing.assert_allclose(warped.rows_along(directions), expected, atol=1e-11)
