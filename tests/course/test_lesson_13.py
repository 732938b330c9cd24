"""The graders of notebook 13."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.course.lesson_13 import SCALE, STEP, right_posterior, segments
from acp_lab.tracking.targets.step_posterior import PLACES
from tests.course.grading import hints, passes


def windows(inside):  # type: ignore[no-untyped-def]
    return np.lib.stride_tricks.sliding_window_view(inside, 8)


def log_sums(inside, step):  # type: ignore[no-untyped-def]
    return np.log(step * windows(inside) + (1 - step) * (1 - windows(inside))).sum(1)


def test_posterior() -> None:
    passes("13.1", right_posterior)


@pytest.mark.parametrize("place", [0, 3, 11])
def test_made_lines_end_where_they_say(place: int) -> None:
    assert int(np.argmax(right_posterior(segments(place), STEP))) == place


@pytest.mark.parametrize(
    ("wrong", "fragment"),
    [
        (lambda p, s: 3.0 * right_posterior(p, s), "add up to 1"),
        (lambda p, s: right_posterior(p, s)[::-1], "turned round"),
        (lambda p, s: (s * windows(p)).prod(1) / (s * windows(p)).prod(1).sum(), "second case"),
        (
            lambda p, s: (q := (s * windows(p) + (1 - s) * (1 - windows(p))).sum(1)) / q.sum(),
            "multiply",
        ),
        (lambda p, s: right_posterior(p, s[::-1]), "step is turned round"),
        (log_sums, "logarithms"),
        (lambda p, s: log_sums(p, s) / log_sums(p, s).sum(), "logarithms"),
        (lambda p, s: np.log(right_posterior(p, s)), "logarithms"),
        (lambda p, s: np.full(PLACES, 1 / PLACES), "inside[d : d + 8]"),
        (lambda p, s: p, "twelve probabilities"),
        (3.0, "the function itself"),
    ],
)
def test_wrong_posteriors(wrong, fragment: str) -> None:  # type: ignore[no-untyped-def]
    hints("13.1", wrong, fragment)


def test_how_far() -> None:
    passes("13.2", 5.5 * SCALE)


@pytest.mark.parametrize(
    ("wrong", "fragment"),
    [
        (9.5 * SCALE, "beyond them"),
        (6 * SCALE, "eleven"),
        (11 * SCALE, "middle"),
        (5.5, "in segments"),
        (11, "in segments"),
        (1.0, "twelve places"),
    ],
)
def test_wrong_distances(wrong: float, fragment: str) -> None:
    hints("13.2", wrong, fragment)
