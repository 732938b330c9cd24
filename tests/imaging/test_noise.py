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


def noise_in_numpy(image: np.ndarray) -> float:
    """The median of the second difference of second differences over all pixels that are not cut off."""
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.int64)
    down = grey[:-2] - 2 * grey[1:-1] + grey[2:]
    both = np.abs(down[:, :-2] - 2 * down[:, 1:-1] + down[:, 2:])
    middle = grey[1:-1, 1:-1]
    return float(np.median(both[(middle > 3) & (middle < 252)])) / (0.6745 * 6.0)


@pytest.mark.parametrize("levels", [0.0, 1.0, 3.0, 40.0, 200.0])
@pytest.mark.parametrize("shape", [(120, 160), (61, 83)])
def test_it_is_what_its_slow_twin_says(levels: float, shape: tuple[int, int]) -> None:
    image = noisy(picture(*shape), levels)
    assert noise_levels(image) == pytest.approx(noise_in_numpy(image), rel=1e-12)


def test_white_beside_black_is_as_different_as_can_be() -> None:
    """Also where all neighbours but the nearest are alike, which is what the filter tells best."""
    image = np.full((200, 200, 3), 100, np.uint8)
    image[::2, ::2], image[1::2, 1::2] = 251, 251
    image[::2, 1::2], image[1::2, ::2] = 4, 4
    assert noise_levels(image) == pytest.approx(16 * (251 - 4) / 2 / (0.6745 * 6.0), rel=1e-12)
