"""The graders of notebook 06."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab import course
from acp_lab.imaging import canny, distance_map
from acp_lab.studies.true_edges import TrueEdges
from tests.course.grading import hints, passes


def test_lowest_place() -> None:
    passes("06.1", "Just above alpha")
    hints("06.1", "on the edge", "beyond alpha")
    hints("06.1", "just below alpha", "which sign")
    hints("06.1", "far away", "from which side")
    hints("06.1", 15.0, "one of these words")


def weight(distances, alpha):  # type: ignore[no-untyped-def]
    return (alpha**2 / (distances**2 + alpha**2)) ** 2


def test_weight() -> None:
    passes("06.2", weight)
    passes("06.2", lambda distances, alpha: weight(distances, alpha).tolist())


@pytest.mark.parametrize(
    ("wrong", "fragment"),
    [
        (lambda d, a: 0.5 * a**2 * d**2 / (d**2 + a**2), "the loss itself"),
        (lambda d, a: d * weight(d, a), "divide it by D"),
        (lambda d, a: d * weight(d, a) / d, "zero by zero"),
        (lambda d, a: a**2 / (d**2 + a**2), "quotient rule"),
        (lambda d, a: 2.0 * weight(d, a), "factor of two"),
        (lambda d, a: weight(d, a) / a**2, "should be one"),
        (lambda d, a: np.maximum(1.0 - (d / a) ** 2, 0.0) ** 2, "Tukey"),
        (lambda d, a: 0.3 * weight(d, a), "least squares"),
        (lambda d, a: np.exp(-d / a), "numerical differences"),
        (lambda d, a: 1.0, "one weight per distance"),
        (lambda d, a: "x", "one weight per distance"),
        (lambda d, a: [[1, 2], [3]], "one weight per distance"),
        (lambda d: d, "stopped with TypeError"),
        (0.25, "the function itself"),
    ],
)
def test_wrong_weights(wrong, fragment: str) -> None:  # type: ignore[no-untyped-def]
    hints("06.2", wrong, fragment)


def share(frame_id: int, just_above: float = 3.0) -> float:
    scene = course.sample_scene()
    frame, pose = scene.frame(frame_id), scene.truth(frame_id, 1)
    assert pose is not None
    x, y = np.round(TrueEdges(course.sample_part()).at(pose, frame.camera).points).astype(int).T
    return float((distance_map(canny(frame.image))[y, x] > just_above).mean())


def test_missing_share() -> None:
    right = share(39)
    assert 0.02 < right < 0.6
    assert abs(right - share(20)) > 0.02, "the grader must tell the two frames apart"
    passes("06.3", right)
    hints("06.3", 1.0 - right, "has an edge")
    hints("06.3", share(39, 2.999), "just three pixels away")  # distances between are none
    hints("06.3", 100.0 * right, "percent")
    hints("06.3", share(20), "frame 20")
    hints("06.3", right + 0.4, "row, then column")
    hints("06.3", -0.1, "between 0 and 1")
