"""The graders of notebook 11."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab import course
from acp_lab.course.lesson_11 import ERRORS
from acp_lab.evaluation import add_mm, adds_mm
from acp_lab.geometry.pose import transform
from tests.course.grading import hints, passes


def apart(points, est, true):  # type: ignore[no-untyped-def]
    return transform(est, points) - transform(true, points)


def test_add() -> None:
    passes("11.1", add_mm)


@pytest.mark.parametrize(
    ("wrong", "fragment"),
    [
        (adds_mm, "ADD-S"),
        (lambda p, a, b: np.linalg.norm(a[:3, 3] - b[:3, 3]), "origins alone"),
        (lambda p, a, b: np.linalg.norm(apart(p, a, b).mean(0)), "cancel"),
        (lambda p, a, b: np.sqrt((apart(p, a, b) ** 2).sum(1).mean()), "root of the mean square"),
        (lambda p, a, b: add_mm(p, a, b) / course.sample_part().diameter, "in mm"),
        (lambda p, a, b: np.abs(apart(p, a, b)).mean(), "two places"),
        (apart, "one number"),
        (3.0, "the function itself"),
    ],
)
def test_wrong_adds(wrong, fragment: str) -> None:  # type: ignore[no-untyped-def]
    hints("11.1", wrong, fragment)


def test_how_deep() -> None:
    part = course.sample_part()
    passes("11.2", 0.02 * part.diameter)
    passes("11.2", -0.02 * part.diameter)
    hints("11.2", 0.02, "of what")
    hints("11.2", 2, "of what")
    hints("11.2", 0.02 * course.sample_scene().first_pose[2, 3], "distance to the camera")
    hints("11.2", 0.02 * part.box_size.max(), "longest side")
    said = hints("11.2", 4.0, "mean of the distances")
    assert f"{0.02 * part.diameter:.1f}" not in said


def test_recall() -> None:
    errors = np.array(ERRORS)
    scored = errors[1:]
    passes("11.3", (scored < 0.02).mean())
    passes("11.3", round((scored < 0.02).mean(), 2))
    hints("11.3", (errors < 0.02).mean(), "first frame")
    hints("11.3", (scored[np.isfinite(scored)] < 0.02).mean(), "failure")
    hints("11.3", (scored <= 0.02).mean(), "strictly")
    hints("11.3", (scored >= 0.02).mean(), "failed")
    hints("11.3", (scored < 0.05).mean(), "within 5%")
    hints("11.3", 37.5, "between 0 and 1")
    hints("11.3", 0.9, "how many frames")


def test_the_wrong_ways_to_count_differ_from_the_right_one_and_each_other() -> None:
    errors = np.array(ERRORS)
    scored = errors[1:]
    shares = [
        (scored < 0.02).mean(),
        (errors < 0.02).mean(),
        (scored[np.isfinite(scored)] < 0.02).mean(),
        (scored <= 0.02).mean(),
        (scored >= 0.02).mean(),
        (scored < 0.05).mean(),
    ]
    assert np.diff(np.sort(shares)).min() > 0.01


def test_how_late() -> None:
    passes("11.4", 0.62)
    hints("11.4", -0.6, "late, not early")
    hints("11.4", 0.8, "more exact")
    hints("11.4", 3.0, "three axes")
    hints("11.4", "late", "number of frames")
