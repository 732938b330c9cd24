"""The graders of notebook 07."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab import course
from acp_lab.control_points.coplanar_points import mid_section_points
from acp_lab.control_points.view_regions import ALL_REGIONS
from acp_lab.studies.redundancy import redundant_directions, rigid_share
from tests.course.grading import hints, passes


def solve(jacobian, residuals, weights, damping, floor=0.0):  # type: ignore[no-untyped-def]
    weighted = jacobian * weights[:, None]
    normal = weighted.T @ jacobian
    damped = normal + damping * np.diag(np.diag(normal)) + floor * np.eye(len(normal))
    return np.linalg.solve(damped, weighted.T @ residuals)


def test_step() -> None:
    passes("07.1", solve)
    passes("07.1", lambda j, r, w, d: solve(j, r, 3.0 * w, d))


@pytest.mark.parametrize(
    ("wrong", "fragment"),
    [
        (lambda j, r, w, d: -solve(j, r, w, d), "other way"),
        (lambda j, r, w, d: solve(j, r, np.ones_like(w), d), "weights have no part"),
        (lambda j, r, w, d: solve(j, r, w**2, d), "squared"),
        (lambda j, r, w, d: (j * w[:, None]).T @ r, "the gradient"),
        (lambda j, r, w, d: solve(j, r, w, 0.0, d), "multiply the diagonal"),
        (lambda j, r, w, d: solve(j, r, w, 0.0), "without damping"),
        (lambda j, r, w, d: solve(j, r, w, 0.0) / (1.0 + d), "undamped step divided"),
        (lambda j, r, w, d: solve(j, r, w, d) / (1.0 + d), "a division"),
        (lambda j, r, w, d: 2.0 * solve(j, r, w, d), "normal equations"),
        (lambda j, r, w, d: solve(j, r, w, d)[:3], "one step"),
        (lambda j, r, w: solve(j, r, w, 0.0), "stopped with TypeError"),
        (np.zeros(6), "the function itself"),
    ],
)
def test_wrong_steps(wrong, fragment: str) -> None:  # type: ignore[no-untyped-def]
    hints("07.1", wrong, fragment)


def test_units() -> None:
    passes("07.2", ["gradient descent", "condition"])
    hints("07.2", ["condition", "gradient descent", "gauss-newton"], "Scale a column")
    hints("07.2", "gradient descent", "singular values")
    hints("07.2", "condition", "1/c")
    hints("07.2", [], "singular values")
    hints("07.2", 3, "list of some of these words")


def redundant() -> np.ndarray:
    part, scene = course.sample_part(), course.sample_scene()
    points_obj = mid_section_points(part.box_min, part.box_max, ALL_REGIONS[course.SAMPLE_REGION].axis)
    return redundant_directions(points_obj, scene.first_pose, part.box_centre, scene.camera(0))


def test_rigid_pull() -> None:
    right = rigid_share(5.0 * np.eye(8)[0], redundant())
    passes("07.3", right)
    hints("07.3", 1.0 - right, "no motion")
    hints("07.3", np.sqrt(right), "share of the length")
    hints("07.3", rigid_share(np.eye(8)[1], redundant()), "down")
    hints("07.3", 0.1, "eight numbers")
    hints("07.3", 5.0, "between 0 and 1")
    for mean in (0.75, 0.7575, 0.76):
        said = hints("07.3", mean, "mean over all pulls")
        assert f"{right:.2f}" not in said
