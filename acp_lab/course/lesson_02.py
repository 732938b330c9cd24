"""Notebook 02: manipulative transformation."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from acp_lab.course.answers import Hint, as_choices, as_function, as_number, near
from acp_lab.course.grader import exercise
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.homography import apply_homography
from acp_lab.geometry.tps import warp_points_tps

WAYS = ("homography", "thin-plate spline", "view templates", "visibility network")
_EXACT_PX = 1e-6


def _affine(matrix: list[list[float]], shift: tuple[float, float] = (0.0, 0.0)) -> Callable[[FloatArray], FloatArray]:
    return lambda points: points @ np.array(matrix).T + shift


def _perspective(points: FloatArray) -> FloatArray:
    return apply_homography(np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1e-3, 5e-4, 1.0]]), points)


MAPS: dict[str, Callable[[FloatArray], FloatArray]] = {
    "shift": _affine([[1.0, 0.0], [0.0, 1.0]], (12.0, -7.0)),
    "rotation": _affine([[0.8, -0.6], [0.6, 0.8]]),
    "scaling": _affine([[1.4, 0.0], [0.0, 1.4]]),
    "shear": _affine([[1.0, 0.3], [0.0, 1.0]]),
    "perspective": _perspective,
}


@exercise("02.1")
def exact_maps(answer: Any) -> str:
    """Which maps a thin-plate spline of four points reproduces."""
    chosen = as_choices(answer, tuple(MAPS))
    right = frozenset(name for name, move in MAPS.items() if _is_exact(move))
    if chosen == right:
        return "All affine maps, for which no bending is needed. A homography reproduces the fifth as well."
    if chosen - right:
        raise Hint("One of yours needs bending: which of them does not keep parallel lines parallel?")
    if not chosen:
        raise Hint("Some of them are reproduced. Look at the formula with all of the weights w at zero.")
    raise Hint("There are more. What can the part of the formula without U do alone?")


@exercise("02.2")
def one_way(answer: Any) -> str:
    """there(points_a, points_b) -> the mean distance from a to the nearest of b."""
    there = as_function(answer, "a function there(points_a, points_b)")
    rng = np.random.default_rng(22)
    for count_a, count_b in ((40, 25), (7, 60)):
        a, b = rng.uniform(0.0, 100.0, (count_a, 2)), rng.uniform(0.0, 100.0, (count_b, 2))
        apart = np.linalg.norm(a[:, None] - b[None], axis=2)
        found = as_number(there(a, b), "one number, a distance in px")
        right, back = float(apart.min(1).mean()), float(apart.min(0).mean())
        if near(found, right, 1e-6):
            continue
        if any(near(found, round(right, digits), 1e-12) for digits in range(7)):
            raise Hint("Right, but rounded: return the number as it is.")
        wrong = (
            (back, "That is the way back: every point of a looks for one of b."),
            (0.5 * (back + right), "That is the mean of both directions; one is asked for."),
            (back + right, "Both directions are added up; one is asked for."),
            (float(apart.mean()), "That is the mean over all pairs; only the nearest counts."),
            (float(apart.min(1).max()), "That is the largest of the nearest distances (Hausdorff's); take their mean."),
            (float(apart.min(1).sum()), "The sum grows with the number of points; take the mean."),
            (float((apart.min(1) ** 2).mean()), "Those are squared distances."),
            (float(np.sqrt((apart.min(1) ** 2).mean())), "That is the root of the mean square; take the plain mean."),
        )
        for value, hint in wrong:
            if near(found, value, 1e-6):
                raise Hint(hint)
        raise Hint("For one point of a: its distances to all of b, and the least of these. Then the mean over a.")
    return "For thousands of points a k-d tree does the same in a fraction of the time."


@exercise("02.3")
def obedient(answer: Any) -> str:
    """Which ways meet four points that no pose shows."""
    chosen = as_choices(answer, WAYS)
    rigid = chosen & set(WAYS[2:])
    if chosen == set(WAYS[:2]):
        return "The others read a pose off the points first, and a pose has two numbers less."
    if rigid:
        raise Hint("One of yours takes the pose from PnP first. Can a rigid part be where these points are?")
    if not chosen:
        raise Hint("Two of them do: those whose map takes any four points to any other four. Which maps can?")
    raise Hint("One more does: count how many numbers its map has, and how many the four points give.")


def _is_exact(move: Callable[[FloatArray], FloatArray]) -> bool:
    source = np.array([[10.0, 20.0], [120.0, 0.0], [150.0, 110.0], [0.0, 90.0]])
    points = np.random.default_rng(2).uniform(-50.0, 200.0, (50, 2))
    return bool(np.abs(warp_points_tps(points, source, move(source)) - move(points)).max() < _EXACT_PX)
