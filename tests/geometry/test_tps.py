"""Thin-plate splines against SciPy's, and kornia's image warp against the warp of points."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import RBFInterpolator

from acp_lab.errors import GeometryError
from acp_lab.geometry import warp_image_tps, warp_points_tps

SRC = np.array([[50.0, 40.0], [150.0, 50.0], [140.0, 110.0], [60.0, 100.0], [100.0, 70.0]])
DST = SRC + np.array([[4.0, -3.0], [2.0, 5.0], [-6.0, 1.0], [0.0, 3.0], [5.0, 5.0]])


def test_points_land_where_they_should() -> None:
    np.testing.assert_allclose(warp_points_tps(SRC, SRC, DST), DST, atol=1e-10)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_it_is_bookstein_s_spline_at_any_scale(rng: np.random.Generator, scale: float) -> None:
    points = rng.uniform(0, 200, (30, 2))
    twin = RBFInterpolator(SRC, DST, kernel="thin_plate_spline", degree=1)(points)
    np.testing.assert_allclose(warp_points_tps(points * scale, SRC * scale, DST * scale), twin * scale, rtol=1e-7)


def test_an_affine_motion_stays_affine(rng: np.random.Generator) -> None:
    linear, shift = np.array([[1.1, 0.2], [-0.1, 0.9]]), np.array([5.0, -7.0])
    points = rng.uniform(0, 200, (30, 2))
    np.testing.assert_allclose(warp_points_tps(points, SRC, SRC @ linear + shift), points @ linear + shift, atol=1e-9)
    three = SRC[:3]
    np.testing.assert_allclose(
        warp_points_tps(points, three, three @ linear + shift), points @ linear + shift, atol=1e-9
    )


@pytest.mark.parametrize("grey", [True, False])
def test_the_image_s_content_moves_with_its_points(grey: bool) -> None:
    """A spot at each source point is found at its destination, to a fraction of a pixel."""
    y, x = np.mgrid[:160, :210]
    image = np.zeros((160, 210), np.uint8)
    for u, v in SRC:
        image = np.maximum(image, (255 * np.exp(-((x - u) ** 2 + (y - v) ** 2) / 18.0)).astype(np.uint8))
    if not grey:
        image = np.repeat(image[..., None], 3, axis=2)
    warped = warp_image_tps(image, SRC, DST)
    assert warped.shape == image.shape
    assert warped.dtype == np.uint8
    spots = (warped if grey else warped[..., 1]).astype(float)
    for u, v in DST:
        weight = spots * (np.hypot(x - u, y - v) < 12.0)
        assert weight.max() > 200, "the spot is gone: were the points normalised?"
        centre = np.array([(x * weight).sum(), (y * weight).sum()]) / weight.sum()
        assert np.hypot(*(centre - (u, v))) < 0.3


def test_enlarging_keeps_pixel_centres() -> None:
    """Three times larger: half a pixel lost in the normalisation would show as a whole one."""
    y, x = np.mgrid[:90, :120].astype(float)
    image = np.exp(-((x - 25.0) ** 2 + (y - 27.0) ** 2) / 18.0).astype(np.float32)
    src = np.array([[20.0, 15.0], [30.0, 15.0], [20.0, 25.0], [30.0, 26.0]])
    warped = warp_image_tps(image, src, (src - (20.0, 15.0)) * 3.0 + (20.0, 15.0)).astype(float)
    centre = np.array([(x * warped).sum(), (y * warped).sum()]) / warped.sum()
    np.testing.assert_allclose(centre, [35.0, 51.0], atol=0.05)


def test_float_images_stay_float_and_no_motion_is_the_identity(rng: np.random.Generator) -> None:
    image = rng.random((40, 60), dtype=np.float32)
    still = np.array([[5.0, 5.0], [50.0, 8.0], [45.0, 35.0], [8.0, 30.0]])
    warped = warp_image_tps(image, still, still)
    assert warped.dtype == np.float32
    np.testing.assert_allclose(warped, image, atol=1e-3)


@pytest.mark.parametrize(
    ("src", "dst", "word"),
    [
        (SRC[:2], DST[:2], "3 or more"),
        (SRC, DST[:4], "3 or more"),
        (SRC.ravel(), DST.ravel(), "3 or more"),
        (np.vstack([SRC, SRC[:1]]), np.vstack([DST, DST[:1] + 1.0]), "repeat"),
        (np.outer(np.arange(4.0), [1.0, 2.0]), SRC[:4], "collinear"),
        (np.zeros((4, 2)), SRC[:4], "repeat"),
        (SRC, DST * np.nan, "not finite"),
    ],
)
def test_points_without_a_spline_are_refused(src: np.ndarray, dst: np.ndarray, word: str) -> None:
    with pytest.raises(GeometryError, match=word):
        warp_points_tps(SRC, src, dst)
