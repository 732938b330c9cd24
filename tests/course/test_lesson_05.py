"""The graders of notebook 05."""

from __future__ import annotations

import numpy as np
import pytest

from tests.course.grading import hints, passes

RIGHT = np.sqrt([[1.0, 2.0, 5.0, 5.0, 4.0], [0.0, 1.0, 4.0, 2.0, 1.0], [1.0, 2.0, 4.0, 1.0, 0.0]])


def test_tiny_distance_map() -> None:
    passes("05.1", RIGHT)
    passes("05.1", RIGHT.round(2).tolist())
    hints("05.1", RIGHT**2, "squared")
    hints("05.1", -RIGHT, "negative")
    hints("05.1", RIGHT + 1.0, "own nearest edge")
    hints("05.1", [[1, 2, 3, 3, 2], [0, 1, 2, 2, 1], [1, 2, 2, 1, 0]], "straight line")
    hints("05.1", [[1, 1, 2, 2, 2], [0, 1, 2, 1, 1], [1, 1, 2, 1, 0]], "diagonal step")
    hints("05.1", RIGHT.T, "3 x 5")


def test_a_hint_names_the_place_and_not_the_distance() -> None:
    wrong = RIGHT.copy()
    wrong[0, 2] = 3.5
    said = hints("05.1", wrong, "row 0, column 2")
    assert "2.2" not in said
    assert "5" not in said.replace("15", "")


def top(before: float, peak: float, after: float) -> float:
    return 0.5 * (before - after) / (before - 2.0 * peak + after)


def test_parabola() -> None:
    passes("05.2", top)


@pytest.mark.parametrize(
    ("wrong", "fragment"),
    [
        (lambda b, p, a: -top(b, p, a), "larger neighbour"),
        (lambda b, p, a: 2.0 * top(b, p, a), "factor of two"),
        (lambda b, p, a: (a - b) / (b + p + a), "centre of mass"),
        (lambda b, p, a: 0.3, "at -1, 0 and 1"),
        (lambda b, p, a: top(b, p, a) if a != b else 0.1, "equal neighbours"),
        (lambda b, p, a: [1, 2], "one number"),
        (lambda b, p: 0.0, "stopped with TypeError"),
        (0.3, "the function itself"),
    ],
)
def test_wrong_parabolas(wrong, fragment: str) -> None:  # type: ignore[no-untyped-def]
    hints("05.2", wrong, fragment)
