"""How soft a picture's edges are told to be, and what sharpening takes back."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import norm

from acp_lab.geometry.arrays import Float32Array
from acp_lab.imaging.sharpness import (
    LEAST_SOFTNESS,
    SHARPEN_PX,
    SHARPEN_TAPS,
    SOFTEST_PX,
    USUAL_BLUR_PX,
    _slopes,
    edge_blur_px,
    sharpened,
    softness,
)

SMOOTHING_PX = 1.0


def steps(
    blur_px: float, angle_deg: float = 0.0, size: int = 160, greys: tuple[float, float] = (60.0, 180.0)
) -> Float32Array:
    """(size, size) dark and bright bars, 40 px wide, behind two Gaussians: `blur_px` and `SMOOTHING_PX`."""
    y, x = np.mgrid[0:size, 0:size] - 0.3
    across = x * np.cos(np.radians(angle_deg)) + y * np.sin(np.radians(angle_deg))
    off = np.abs((across + 20.0) % 80.0 - 40.0) - 20.0
    bright = norm.cdf(off, scale=np.hypot(blur_px, SMOOTHING_PX))
    return np.asarray(greys[0] + (greys[1] - greys[0]) * bright, np.float32)


@pytest.mark.parametrize("angle_deg", [0.0, 33.0, 90.0])
@pytest.mark.parametrize("blur_px", [0.5, 1.0, 1.7, 2.3])
def test_the_blur_of_steps_is_told(blur_px: float, angle_deg: float) -> None:
    assert edge_blur_px(steps(blur_px, angle_deg), SMOOTHING_PX) == pytest.approx(blur_px, abs=0.3)


@given(low=st.floats(5.0, 100.0), rise=st.floats(2.0, 150.0), blur_px=st.floats(0.0, 2.5))
def test_contrast_has_no_say_in_it(low: float, rise: float, blur_px: float) -> None:
    first, second = (steps(blur_px, 20.0, 96, greys) for greys in ((60.0, 180.0), (low, low + rise)))
    assert edge_blur_px(second, SMOOTHING_PX) == pytest.approx(edge_blur_px(first, SMOOTHING_PX), abs=0.02)


def test_a_softer_picture_is_told_to_be_softer() -> None:
    told = [edge_blur_px(steps(blur_px, 70.0), SMOOTHING_PX) for blur_px in np.linspace(0.2, 2.4, 12)]
    assert np.all(np.diff(np.array(told, np.float64)) > 0.0)


def test_noise_counts_as_sharp_and_shading_as_soft() -> None:
    rng = np.random.default_rng(0)
    noise = cv2.GaussianBlur(rng.normal(90.0, 20.0, (120, 160)).astype(np.float32), (0, 0), SMOOTHING_PX)
    assert edge_blur_px(np.asarray(noise, np.float32), SMOOTHING_PX) == pytest.approx(0.0, abs=0.3)
    ramp = np.tile(np.linspace(0.0, 200.0, 160, dtype=np.float32), (120, 1))
    assert edge_blur_px(ramp, SMOOTHING_PX) == SOFTEST_PX


@pytest.mark.parametrize("shape", [(2, 2), (15, 400), (16, 16), (17, 16), (18, 19), (21, 35)])
def test_any_size_will_do(shape: tuple[int, int]) -> None:
    """The fewest pixels tell nothing; of sizes that no step divides, fine and coarse slopes are of the same pixels."""
    picture = steps(1.2)[: shape[0], 8 : 8 + shape[1]]
    told = edge_blur_px(np.ascontiguousarray(picture), SMOOTHING_PX)
    if min(shape) < 16:
        assert told is None
    else:
        assert told is None or 0.0 <= told <= SOFTEST_PX


def test_a_picture_without_edges_tells_nothing() -> None:
    assert edge_blur_px(np.full((40, 40), 90.0, np.float32), SMOOTHING_PX) is None
    shaded = np.tile(np.linspace(60.0, 75.0, 160, dtype=np.float32), (120, 1))
    assert edge_blur_px(shaded, SMOOTHING_PX) is None


def test_a_single_edge_in_a_wide_flat_picture_tells_nothing() -> None:
    """Its tails would count, and they look soft."""
    wide = np.full((160, 640), 180.0, np.float32)
    wide[:, :50] = steps(1.6)[:, 15:65]
    assert edge_blur_px(wide, SMOOTHING_PX) is None
    assert edge_blur_px(np.ascontiguousarray(wide[:, :60]), SMOOTHING_PX) == pytest.approx(1.6, abs=0.3)


def slope_at_edges(grey: Float32Array) -> float:
    return float(np.abs(np.diff(grey, axis=1)).max())


def test_sharpening_makes_edges_steeper_and_leaves_them_where_they_are() -> None:
    soft, sharp = steps(1.8), sharpened(steps(1.8), 2.0)
    assert slope_at_edges(sharp) > 1.4 * slope_at_edges(soft)
    row = soft.shape[0] // 2
    middle = 120.0
    np.testing.assert_array_equal(soft[row] > middle, sharp[row] > middle)
    np.testing.assert_array_equal(sharpened(soft, 0.0), soft)


def test_sharpening_tells_two_edges_apart_that_had_become_one() -> None:
    """A bar of 4 px behind a blur of 2 px: darker between its edges once it is sharpened."""
    x = np.arange(160.0)
    bar = norm.cdf(x - 80.0, scale=2.2) - norm.cdf(x - 84.0, scale=2.2)
    soft = np.tile((60.0 + 100.0 * bar).astype(np.float32), (40, 1))
    sharp = sharpened(soft, 3.0)
    # Sharp, it would have 160.
    assert soft[20].max() < 130.0 < 140.0 < sharp[20].max()


def test_sharpening_is_what_it_says() -> None:
    """Its twin, by a Gaussian in numbers."""
    rng = np.random.default_rng(1)
    grey = rng.uniform(0.0, 255.0, (31, 41)).astype(np.float32)
    far = SHARPEN_TAPS // 2
    reach = np.arange(-far, far + 1)
    weights = np.exp(-0.5 * (reach / SHARPEN_PX) ** 2)
    weights /= weights.sum()
    padded = np.pad(grey.astype(np.float64), far, mode="edge")
    smoother = np.apply_along_axis(
        np.convolve, 0, np.apply_along_axis(np.convolve, 1, padded, weights, "valid"), weights, "valid"
    )
    np.testing.assert_allclose(sharpened(grey, 1.5), grey + 1.5 * (grey - smoother), atol=1e-3)


def test_the_softer_a_picture_the_more_it_is_sharpened() -> None:
    assert softness(USUAL_BLUR_PX) == 1.0
    assert softness(2.0 * USUAL_BLUR_PX) == pytest.approx(4.0)
    assert softness(0.0) == LEAST_SOFTNESS < softness(0.9 * USUAL_BLUR_PX) < 1.0
    assert softness(None) == 1.0
    assert softness(20.0) == softness(SOFTEST_PX)


@pytest.mark.parametrize(("first", "step", "end"), [(1, 1, (29, 40)), (2, 2, (28, 39)), (2, 2, (27, 38))])
def test_slopes_are_those_of_a_slow_twin(first: int, step: int, end: tuple[int, int]) -> None:
    grey = np.random.default_rng(0).normal(120.0, 40.0, (31, 43, 3)).astype(np.float32)[..., 1]
    down, across = np.gradient(grey.astype(np.float64))
    expected = np.hypot(across, down)[first : end[0] : step, first : end[1] : step]
    np.testing.assert_allclose(_slopes(grey, first, step, end), expected.ravel(), rtol=1e-5, atol=1e-4)
