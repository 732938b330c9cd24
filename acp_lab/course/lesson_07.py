"""Notebook 07: optimising control points."""

from __future__ import annotations

from typing import Any

import numpy as np

from acp_lab.control_points.coplanar_points import mid_section_points
from acp_lab.control_points.view_regions import ALL_REGIONS
from acp_lab.course.answers import Hint, as_array, as_choices, as_function, as_number, near
from acp_lab.course.grader import exercise
from acp_lab.course.workshop import SAMPLE_REGION, sample_part, sample_scene
from acp_lab.geometry.arrays import FloatArray
from acp_lab.studies.redundancy import redundant_directions, rigid_share

WAYS = ("condition", "gradient descent", "Gauss-Newton")
_CLOSE = 0.01


@exercise("07.1")
def marquardt_step(answer: Any) -> str:
    """step(jacobian, residuals, weights, damping) -> (k,)."""
    step = as_function(answer, "a function step(jacobian, residuals, weights, damping)")
    rng = np.random.default_rng(71)
    for damping in (0.0, 0.1):
        jacobian, residuals = rng.normal(size=(40, 6)) * [30.0, 30.0, 30.0, 1.0, 1.0, 1.0], rng.normal(size=40)
        weights = rng.uniform(0.1, 1.0, 40)
        found = as_array(step(jacobian, residuals, weights, damping), (6,), "one step, (k,)")
        if not _same(found, _marquardt(jacobian, residuals, weights, damping)):
            _compare_steps(found, jacobian, residuals, weights, damping)
    return "It is blind to units: Marquardt's diagonal is scaled together with the matrix."


@exercise("07.2")
def units(answer: Any) -> str:
    """What changes when turns are written in degrees."""
    chosen = as_choices(answer, WAYS)
    if chosen == {"condition", "gradient descent"}:
        return (
            "The gradient becomes smaller by 57 where its variable became larger by 57, so descent goes another "
            "way; Gauss-Newton divides by the square of what it multiplied with, and ends at the same pose."
        )
    if "Gauss-Newton" in chosen:
        raise Hint("Scale a column of J by c: what happens to that entry of Gauss-Newton's step, and to the edges?")
    if "condition" not in chosen:
        raise Hint("Scaling one column of a matrix changes its singular values; which of these is made of them?")
    raise Hint("Scale a column of J by c. The gradient's entry is scaled by c, the variable itself by 1/c.")


@exercise("07.3")
def rigid_pull(answer: Any) -> str:
    """The rigid share of a pull at point 1 to the right, frame 0."""
    share = as_number(answer, "a share between 0 and 1")
    if not 0.0 <= share <= 1.0:
        raise Hint("A share lies between 0 and 1.")
    redundant = _redundant()
    right = rigid_share(np.eye(8)[0], redundant)
    if near(share, right, absolute=_CLOSE):
        return "On average over all pulls it is six eighths: the rest bends the part."
    if near(share, 1.0 - right, absolute=_CLOSE):
        raise Hint("That is the share that no motion of the part makes.")
    if near(share, np.sqrt(right), absolute=_CLOSE):
        raise Hint("That is the share of the length; the question is about its square.")
    if near(share, rigid_share(np.eye(8)[1], redundant), absolute=0.003):
        raise Hint("That point was pulled down, not to the right.")
    if near(share, 0.75, absolute=0.015):
        raise Hint("That is the mean over all pulls; this one is a particular one.")
    raise Hint("Write the pull as eight numbers, x first, point 1 first; rigid_share does the rest.")


def _redundant() -> FloatArray:
    part, scene = sample_part(), sample_scene()
    points_obj = mid_section_points(part.box_min, part.box_max, ALL_REGIONS[SAMPLE_REGION].axis)
    return redundant_directions(points_obj, scene.first_pose, part.box_centre, scene.camera(0))


def _marquardt(jacobian: FloatArray, residuals: FloatArray, weights: FloatArray, damping: float) -> FloatArray:
    weighted = jacobian * weights[:, None]
    normal = weighted.T @ jacobian
    damped = normal + damping * np.diag(np.diagonal(normal))
    return np.asarray(np.linalg.solve(damped, weighted.T @ residuals), dtype=np.float64)


def _compare_steps(
    found: FloatArray, jacobian: FloatArray, residuals: FloatArray, weights: FloatArray, damping: float
) -> None:
    """Raise the hint that fits a wrong step."""
    even = np.ones_like(weights)
    normal = (jacobian * weights[:, None]).T @ jacobian
    gradient = (jacobian * weights[:, None]).T @ residuals
    wrong = (
        (-_marquardt(jacobian, residuals, weights, damping), "The other way: r is what a point still has to go."),
        (_marquardt(jacobian, residuals, even, damping), "The weights have no part in it yet."),
        (_marquardt(jacobian, residuals, weights**2, damping), "The weights come in squared: once is enough."),
        (gradient, "That is the gradient; Gauss-Newton also divides by the matrix of the normal equations."),
        (
            np.linalg.solve(normal + damping * np.eye(6), gradient),
            "In other units this would be another step: multiply the diagonal, do not add to it.",
        ),
        (np.linalg.solve(normal, gradient), "Right without damping: now multiply the diagonal by 1 + damping."),
        (
            np.linalg.solve((1.0 + damping) * normal, gradient),
            "This is the undamped step divided by 1 + damping: of the matrix, only the diagonal is to be multiplied.",
        ),
        (
            _marquardt(jacobian, residuals, weights, damping) / (1.0 + damping),
            "Right but for a division by 1 + damping: that factor belongs on the diagonal alone.",
        ),
    )
    for step, hint in wrong:
        if _same(found, np.asarray(step, np.float64)):
            raise Hint(hint)
    raise Hint("Write down the normal equations: J^T W J on the left, J^T W r on the right; damp, then solve.")


def _same(a: FloatArray, b: FloatArray) -> bool:
    return bool(np.allclose(a, b, rtol=1e-6, atol=1e-12))
