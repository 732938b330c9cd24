"""How noisy pictures are, against what was put into them."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from acp_lab.imaging.noise import noise_levels


def picture(height: int = 240, width: int = 320) -> np.ndarray:
    """(h, w, 3) uint8: slopes, a grid of lines, some that cross it, and a patch that is cut off."""
    rows, columns = np.mgrid[:height, :width]
    image = np.repeat((60 + 0.3 * columns + 0.2 * rows)[..., None], 3, 2).astype(np.uint8)
    image[::24], image[:, ::31] = 200, 30
    for k in range(0, width, 40):
        cv2.line(image, (k, 0), (width - k, height), (180, 40, 90), 2, cv2.LINE_AA)
    image[10:60, 10:90] = 255
    return image


def noisy(image: np.ndarray, levels: float, seed: int = 0) -> np.ndarray:
    """The same noise in all channels, so that grey has as much."""
    noise = np.random.default_rng(seed).normal(0.0, levels, (*image.shape[:2], 1))
    return np.clip(image + noise, 0, 255).round().astype(np.uint8)


@pytest.mark.parametrize("levels", [2.0, 5.0, 12.0, 25.0])
def test_it_finds_the_noise_that_was_put_in_whatever_else_there_is(levels: float) -> None:
    found = noise_levels(noisy(picture(), levels))
    assert found == pytest.approx(levels, rel=0.1, abs=0.5)


def test_edges_are_no_noise() -> None:
    found = noise_levels(picture())
    assert found is not None
    assert found < 0.5


def test_of_large_pictures_some_rows_tell_it() -> None:
    large = noisy(np.full((3000, 4000, 3), 120, np.uint8), 8.0)
    assert noise_levels(large) == pytest.approx(8.0, rel=0.1)


def test_what_is_cut_off_is_not_asked() -> None:
    image = noisy(np.full((200, 300, 3), 128, np.uint8), 6.0)
    image[:, 60:] = 0  # most of it is black: nothing is seen of its noise
    assert noise_levels(image) == pytest.approx(6.0, rel=0.15)


@pytest.mark.parametrize("shape", [(1, 900), (2, 900), (900, 2), (3, 3), (20, 20)])
def test_small_pictures_tell_nothing(shape: tuple[int, int]) -> None:
    assert noise_levels(np.full((*shape, 3), 100, np.uint8)) is None


def test_black_and_white_pictures_tell_nothing() -> None:
    image = np.zeros((200, 200, 3), np.uint8)
    image[:, 100:] = 255
    assert noise_levels(image) is None
