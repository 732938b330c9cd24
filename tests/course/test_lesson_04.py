"""The graders of notebook 04."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.geometry.homography import apply_homography, homography_from_points
from tests.course.grading import hints, passes


def psnr(painted, truth):  # type: ignore[no-untyped-def]
    return -10.0 * np.log10(((painted - truth) ** 2).mean((1, 2)))


def test_inverse_psnr() -> None:
    passes("04.1", lambda painted, truth: (1.0 / psnr(painted, truth)).mean())


@pytest.mark.parametrize(
    ("wrong", "fragment"),
    [
        (lambda p, t: psnr(p, t).mean(), "PSNR itself"),
        (lambda p, t: -psnr(p, t).mean(), "minus PSNR"),
        (lambda p, t: ((p - t) ** 2).mean(), "now the logarithm"),
        (lambda p, t: (-0.1 / np.log(((p - t) ** 2).mean((1, 2)))).mean(), "base of the logarithm"),
        (lambda p, t: -(1.0 / psnr(p, t)).mean(), "sign"),
        (lambda p, t: 0.5 * (1.0 / psnr(p, t)).mean(), "twenty times"),
        (lambda p, t: -0.1 / np.log10(((p - t) ** 2).mean()), "its own PSNR"),
        (lambda p, t: (1.0 / psnr(p, t)).sum(), "sum over the images"),
        (lambda p, t: 2.0 * (1.0 / psnr(p, t)).mean(), "no root"),
        (lambda p, t: (-0.1 / np.log10(np.abs(p - t).mean((1, 2)))).mean(), "their sizes"),
        (lambda p, t: (-0.1 / np.log10(((p - t) ** 2).sum((1, 2)))).mean(), "number of pixels"),
        (lambda p, t: 7.0, "minus one over that"),
        (psnr, "one loss for all"),
        (lambda p: 0.0, "stopped with TypeError"),
        (0.1, "the function itself"),
    ],
)
def test_wrong_losses(wrong, fragment: str) -> None:  # type: ignore[no-untyped-def]
    hints("04.1", wrong, fragment)


def test_picture_in_doubt() -> None:
    passes("04.2", lambda images: images.mean(0))
    passes("04.2", lambda images: np.clip(images.mean(0), 1e-6, 1 - 1e-6))  # guarded against log(0)


@pytest.mark.parametrize(
    ("wrong", "fragment"),
    [
        (lambda images: np.median(images, axis=0), "median"),
        (lambda images: images.max(0), "too bright"),
        (lambda images: images.min(0), "missing"),
        (lambda images: images.mean(0) > 0.5, "sure and wrong"),
        (lambda images: np.zeros_like(images[0]), "black"),
        (lambda images: images[4], "right once"),
        (lambda images: images.sum(0), "between 0 and 1"),
        (lambda images: np.sqrt(images.mean(0)), "derivative to zero"),
        (lambda images: images, "one picture"),
        (lambda images: images.mean(), "one picture"),
    ],
)
def test_wrong_pictures(wrong, fragment: str) -> None:  # type: ignore[no-untyped-def]
    hints("04.2", wrong, fragment)


def summit(left: float, middle: float, right: float) -> float:
    left, middle, right = np.log([left, middle, right])
    return 0.5 * (left - right) / (left - 2.0 * middle + right)


def assumes_full_brightness(left: float, _: float, right: float) -> float:
    far, near = np.sqrt(-2.0 * np.log(left)), np.sqrt(-2.0 * np.log(right))
    return float((far - near) / (far + near))


def test_where_the_ridge_is() -> None:
    passes("04.3", summit)


@pytest.mark.parametrize(
    ("wrong", "fragment"),
    [
        (lambda a, b, c: -summit(a, b, c), "other way"),
        (lambda a, b, c: 0.5 * (a - c) / (a - 2.0 * b + c), "exponential"),
        (lambda a, b, c: (c - a) / (a + b + c), "centre of gravity"),
        (lambda a, b, c: 0, "whole pixels"),
        (lambda a, b, c: 0.5 * 0.8**2 * np.log(c / a), "one width"),
        (lambda a, b, c: (np.sqrt(-2 * np.log(a)) - np.sqrt(-2 * np.log(c))) / 2 * 0.8, "one width"),
        (assumes_full_brightness, "1 at their brightest"),
        (lambda a, b, c: 2.0 * summit(a, b, c), "logarithms of the three"),
        (lambda a, b, c: None, "returns None"),
        ("0.31", "the function itself"),
    ],
)
def test_wrong_ridges(wrong, fragment: str) -> None:  # type: ignore[no-untyped-def]
    hints("04.3", wrong, fragment)


def test_the_rest() -> None:
    passes("04.4", lambda edges, near, points: apply_homography(homography_from_points(near, points), edges))


@pytest.mark.parametrize(
    ("wrong", "fragment"),
    [
        (lambda edges, near, points: edges, "the rest is lost"),
        (lambda edges, near, points: apply_homography(homography_from_points(points, near), edges), "way round"),
        (lambda edges, near, points: edges + (points - near).mean(0), "two numbers of eight"),
        (
            lambda edges, near, points: (
                np.c_[edges, np.ones(len(edges))] @ np.linalg.lstsq(np.c_[near, np.ones(4)], points, rcond=None)[0]
            ),
            "affine",
        ),
        (lambda edges, near, points: edges + 1.0, "one homography"),
        (lambda edges, near, points: edges[:5], "moved edge points"),
    ],
)
def test_wrong_rests(wrong, fragment: str) -> None:  # type: ignore[no-untyped-def]
    hints("04.4", wrong, fragment)
