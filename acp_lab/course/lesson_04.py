"""Notebook 04: the edge generator."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from acp_lab.control_points.view_regions import ALL_REGIONS
from acp_lab.course.answers import Hint, as_array, as_function, as_number
from acp_lab.course.grader import exercise
from acp_lab.course.workshop import SAMPLE_REGION, sample_part
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.homography import apply_homography, homography_from_points

_CLOSE = 1e-6
_GUARDED = 1e-3
"""What a guard against log(0) may take away."""
_NEAR_PX = 1e-3
_BATCH, _SIDE = 3, 24


@exercise("04.1")
def inverse_psnr(answer: Any) -> str:
    """inverse_psnr(painted, truth) of images (b, h, w), eq. 3, the mean over the images."""
    function = as_function(answer, "a function inverse_psnr(painted, truth)")
    truth, painted = _pictures()
    found = as_number(function(painted.copy(), truth.copy()), "one loss for all the images")
    error = ((painted - truth) ** 2).mean((1, 2))
    if not _same(found, float(np.mean(-0.1 / np.log10(error)))):
        _compare_losses(found, painted - truth, error)
    return "It is positive below the pole at MSE = 1, and below e^-2 its gradient grows as the painting gets better."


@exercise("04.2")
def picture_in_doubt(answer: Any) -> str:
    """painting(images): for equally likely true images (n, h, w), the one picture (h, w) of least mean BCE."""
    function = as_function(answer, "a function painting(images)")
    truth, _ = _pictures()
    truth = np.concatenate([truth, truth[:, ::-1]])
    found = as_array(function(truth.copy()), (_SIDE, _SIDE), "one picture, as large as the images")
    if found.min() < -_CLOSE or found.max() > 1.0 + _CLOSE:
        raise Hint("A picture's pixels lie between 0 and 1, or eq. 2 takes the logarithm of a negative number.")
    mean = truth.mean(0)
    if np.abs(found - mean).max() < _GUARDED:
        return (
            "It shows none of the images: it is all of them, faint. The square error has the same best "
            "picture, so no weight of the two terms makes the lines of an uncertain network sharp."
        )
    wrong = (
        (np.median(truth, axis=0), "The median is best for the absolute error; lines that are seldom there are lost."),
        (truth.max(0), "That paints whatever may be there, fully: too bright for a line of one case in six."),
        (truth.min(0), "That paints only what is there in every case; what is nearly always there is missing."),
        ((mean > 0.5).astype(np.float64), "A pixel that is sure and wrong costs most: look at log(0) in eq. 2."),
        (np.zeros_like(mean), "Black is wrong wherever there may be an edge, and log(0) is expensive."),
        *((image, "That is right once, and wrong in every other case: take them all into account.") for image in truth),
    )
    for picture, hint in wrong:
        if np.abs(found - picture).max() < _CLOSE:
            raise Hint(hint)
    raise Hint(
        "Take one pixel that is white in a share p of the images. For which value q is -(p log q + (1 - p) log(1 - q)) "
        "least? Set the derivative to zero."
    )


@exercise("04.3")
def where_the_ridge_is(answer: Any) -> str:
    """peak(left, middle, right): px from the middle pixel to the summit of a Gaussian line, as `ridge` finds it."""
    function = as_function(answer, "a function peak(left, middle, right)")
    for at, sigma_px, brightest in (
        (0.31, 0.8, 1.0),
        (-0.45, 0.8, 1.0),
        (0.0, 0.6, 1.0),
        (0.12, 1.3, 1.0),
        (0.31, 0.8, 0.4),
    ):
        left, middle, right = brightest * np.exp(-0.5 * ((np.array([-1.0, 0.0, 1.0]) - at) / sigma_px) ** 2)
        found = as_number(function(float(left), float(middle), float(right)), "a distance in px")
        if abs(found - at) < 1e-6:
            continue
        if abs(found + at) < 1e-6:
            raise Hint("The other way: positive is towards the right pixel.")
        flat = 0.5 * (left - right) / (left - 2.0 * middle + right)
        if abs(found - flat) < 1e-6:
            raise Hint("Near, but a parabola through the brightness is not a Gaussian. Of what is it the exponential?")
        if abs(found - (right - left) / (left + middle + right)) < 1e-6:
            raise Hint("The centre of gravity of three pixels is drawn to the middle: fit the summit of a curve.")
        if sigma_px != 0.8:
            raise Hint("Right for lines of one width; that of yours nobody knows, but three values tell it, too.")
        if brightest != 1.0:
            raise Hint("Right for lines that are 1 at their brightest; these are as bright as they come.")
        if found == np.round(found):
            raise Hint("Whole pixels are what a threshold gives; the line runs between them.")
        raise Hint(
            "Put a parabola through the logarithms of the three: first and second difference tell where its slope is 0."
        )
    return "Exact to the last digit, wherever the line runs: the logarithm of a Gaussian is a parabola."


@exercise("04.4")
def the_rest(answer: Any) -> str:
    """rest(edges, neighbour, points): edge points moved by the homography from the rigid neighbour of I to I."""
    function = as_function(answer, "a function rest(edges, neighbour, points)")
    edges, neighbour, points = _pulled()
    found = as_array(function(edges.copy(), neighbour.copy(), points.copy()), edges.shape, "the moved edge points")
    expected = apply_homography(homography_from_points(neighbour, points), edges)
    if np.abs(found - expected).max() < _NEAR_PX:
        return (
            "Where I is rigid the rest is nothing; elsewhere generated edges start near where the last level's "
            "homography had left them, up to what it cannot do for edges off its plane."
        )
    along = np.column_stack([neighbour, np.ones(4)])
    affine = np.linalg.lstsq(along, points, rcond=None)[0]
    wrong = (
        (edges, "Nothing moved: these are the edges of the rigid neighbour, and the rest is lost."),
        (
            apply_homography(homography_from_points(points, neighbour), edges),
            "The wrong way round: the edges belong to the neighbour, and should go to I.",
        ),
        (
            edges + (points - neighbour).mean(0),
            "The mean shift of the four points is two numbers of eight: take all of the homography.",
        ),
        (
            np.column_stack([edges, np.ones(len(edges))]) @ affine,
            "An affine map has six numbers, and cannot take any four points to any four: a homography has eight.",
        ),
    )
    for value, hint in wrong:
        if np.abs(found - value).max() < _NEAR_PX:
            raise Hint(hint)
    raise Hint("One homography, from the four points of the neighbour to the four of I, applied to every edge point.")


def _pulled() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Edge points (n, 2), the four points that they belong to, and four others that no part can show beside these."""
    neighbour = np.array([[210.0, 150.0], [420.0, 170.0], [430.0, 320.0], [200.0, 330.0]])
    points = neighbour + np.array([[14.0, -5.0], [-6.0, 9.0], [3.0, 12.0], [-9.0, -4.0]])
    shares = np.random.default_rng(8).uniform(0.0, 1.0, (40, 2))
    return np.array([200.0, 150.0]) + shares * np.array([230.0, 180.0]), neighbour, points


@cache
def _pictures() -> tuple[FloatArray, FloatArray]:
    """True edge images (b, h, w) of the sample part, and what a poor painter made of them."""
    from acp_lab.cad.raycast import make_caster
    from acp_lab.generator.painted.edge_images import EdgeImageConfig
    from acp_lab.studies.generator_study import study_views

    part = sample_part()
    views = study_views(part, make_caster(part), ALL_REGIONS[SAMPLE_REGION], EdgeImageConfig(size=_SIDE), _BATCH, 41)
    truth = np.array([view.image() for view in views], dtype=np.float64)
    rng = np.random.default_rng(4)
    shares = np.array([0.9, 0.5, 0.2])[:, None, None]
    painted = shares * truth + (1.0 - shares) * rng.uniform(0.0, 1.0, truth.shape)
    return truth, painted


def _compare_losses(found: float, off: FloatArray, error: FloatArray) -> None:
    """Raise the hint that fits a wrong loss."""
    psnr = -10.0 * np.log10(error)
    wrong = (
        (psnr.mean(), "That is PSNR itself: large when the painting is good. Eq. 3 has it below the line."),
        (-psnr.mean(), "That is minus PSNR, which some libraries call its loss; eq. 3 has PSNR below the line."),
        (error.mean(), "That is the mean square error; now the logarithm."),
        (np.mean(-0.1 / np.log(error)), "Decibels count in powers of ten: look at the base of the logarithm."),
        (np.mean(0.1 / np.log10(error)), "A loss that falls as the painting gets worse: look at the sign in eq. 3."),
        (np.mean(-0.05 / np.log10(error)), "Twenty times the logarithm is for amplitudes; this is a square already."),
        (-0.1 / np.log10(error.mean()), "Each image has its own PSNR: take the mean over the images last."),
        (np.sum(-0.1 / np.log10(error)), "That is the sum over the images; their mean is asked for."),
        (np.mean(-0.1 / np.log10(np.sqrt(error))), "The norm in eq. 3 is squared: no root."),
        (np.mean(-0.1 / np.log10(np.abs(off).mean((1, 2)))), "Eq. 3 squares the differences; yours takes their sizes."),
        (np.mean(-0.1 / np.log10((off**2).sum((1, 2)))), "Divide the sum of squares by the number of pixels, N."),
    )
    for value, hint in wrong:
        if _same(found, float(value)):
            raise Hint(hint)
    raise Hint("Per image: the mean square error, its log10, times ten, and minus one over that. Then the mean.")


def _same(a: float, b: float) -> bool:
    return abs(a - b) <= _CLOSE * max(1.0, abs(b))
