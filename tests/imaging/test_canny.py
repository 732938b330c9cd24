"""Canny with automatic thresholds: finds what is there at any contrast, and nothing where nothing is."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from acp_lab.errors import GeometryError
from acp_lab.imaging import (
    CannyConfig,
    Thresholds,
    blur,
    canny,
    canny_at,
    median_thresholds,
    otsu_thresholds,
    to_grey,
)

RULES = ("otsu", "median")


def square(dark: int, bright: int, noise: float = 0.0) -> np.ndarray:
    """A bright square on a dark ground, its outline between pixels 29|30 and 69|70."""
    image = np.full((100, 120), dark, np.float64)
    image[30:70, 30:70] = bright
    image += np.random.default_rng(0).normal(0.0, noise, image.shape) if noise else 0.0
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def on_outline() -> np.ndarray:
    """Pixels within 1 px of the square's outline."""
    outer, inner = np.zeros((100, 120), bool), np.zeros((100, 120), bool)
    outer[28:72, 28:72] = True
    inner[32:68, 32:68] = True
    return outer & ~inner


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize(
    ("dark", "bright", "noise"),
    [(0, 255, 0.0), (0, 40, 0.0), (200, 255, 2.0), (20, 120, 4.0), (90, 130, 3.0)],
)
def test_the_outline_and_nothing_else(rule: str, dark: int, bright: int, noise: float) -> None:
    edges = canny(square(dark, bright, noise), CannyConfig(rule=rule))  # type: ignore[arg-type]
    assert edges.dtype == bool
    assert edges.shape == (100, 120)
    assert not edges[~on_outline()].any()
    assert edges.sum() > 0.9 * 4 * 40


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("level", [0, 128, 255])
def test_flat_and_slightly_noisy_images_have_no_edges(rule: str, level: int) -> None:
    noisy = np.clip(np.random.default_rng(0).normal(level, 2.0, (80, 80)), 0, 255).astype(np.uint8)
    for image in (np.full((80, 80), level, np.uint8), noisy):
        assert not canny(image, CannyConfig(rule=rule)).any()  # type: ignore[arg-type]


def test_the_frame_of_the_image_is_no_edge() -> None:
    ramp = np.tile(np.linspace(0, 255, 200).astype(np.uint8), (50, 1))
    assert not canny(ramp).any()


def test_rgb_is_read_as_rgb() -> None:
    red = np.zeros((4, 4, 3), np.uint8)
    red[..., 0] = 255
    assert to_grey(red)[0, 0] == 76  # 0.299 of 255; read as BGR it would be 29
    grey = np.zeros((4, 4), np.uint8)
    assert to_grey(grey) is grey


def test_colour_and_grey_give_the_same_edges() -> None:
    image = square(20, 200)
    np.testing.assert_array_equal(canny(image), canny(np.repeat(image[..., None], 3, axis=2)))


def test_fixed_thresholds_are_those_of_cv2() -> None:
    image = square(20, 90, 3.0)
    ours = canny_at(image, Thresholds(60.0, 150.0), blur_sigma=0.0)
    theirs = cv2.Canny(image, 60.0, 150.0, apertureSize=3, L2gradient=True) > 0
    np.testing.assert_array_equal(ours, theirs)


def test_thresholds_follow_contrast_or_noise() -> None:
    def gradient(image: np.ndarray) -> np.ndarray:
        return cv2.magnitude(*(cv2.Sobel(image, cv2.CV_32F, *d) for d in ((1, 0), (0, 1))))

    faint, strong = (otsu_thresholds(gradient(square(100, 100 + c, 2.0))) for c in (60, 150))
    assert faint.low < faint.high < strong.high < 8 * 150
    quiet, loud = (median_thresholds(gradient(square(50, 200, noise))) for noise in (2.0, 6.0))
    assert loud.high == pytest.approx(3.0 * quiet.high, rel=0.1)


def test_one_glint_does_not_hide_the_rest() -> None:
    image = square(40, 90)
    image[10:12, 10:12] = 255
    assert canny(image)[on_outline()].sum() > 0.9 * 4 * 40


def test_blur_of_zero_is_none() -> None:
    image = square(0, 255)
    assert blur(image, 0.0) is image
    assert blur(image, 2.0)[50, 29] == pytest.approx(255 * 0.4, abs=6)  # half a px outside the outline


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((4, 4, 4), np.uint8),
        np.zeros((4, 4), np.float32),
        np.zeros((0, 4), np.uint8),
        np.zeros(4, np.uint8),
    ],
)
def test_what_is_no_image_is_refused(image: np.ndarray) -> None:
    with pytest.raises(GeometryError, match="image of"):
        canny(image)


@pytest.mark.parametrize(("low", "high"), [(2.0, 1.0), (-1.0, 1.0), (0.0, float("nan")), (0.0, float("inf"))])
def test_thresholds_in_the_wrong_order_are_refused(low: float, high: float) -> None:
    with pytest.raises(GeometryError, match="thresholds"):
        Thresholds(low, high)
