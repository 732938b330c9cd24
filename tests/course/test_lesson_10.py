"""The grader of notebook 10."""

from __future__ import annotations

import pytest

from acp_lab import course
from tests.course.grading import hints, passes


def camera():  # type: ignore[no-untyped-def]
    return course.sample_scene().camera(0)


def right() -> list[float]:
    c = camera()
    return [c.fx / 2, c.fy / 2, c.cx / 2 - 0.25, c.cy / 2 - 0.25]


def test_half_the_pixels() -> None:
    assert "distortion" in passes("10.1", tuple(right()))


@pytest.mark.parametrize(
    ("place", "wrong", "fragment"),
    [
        (0, lambda c: c.fx, "fx is that of the full size"),
        (1, lambda c: 2 * c.fy, "fy: the pixels became larger"),
        (1, lambda c: 0.4 * c.fy, "fy: the lens is the same"),
        (2, lambda c: c.cx, "cx is that of the full size"),
        (2, lambda c: c.cx / 2, "cx: nearly"),
        (3, lambda c: c.cy / 2, "cy: nearly"),
        (3, lambda c: c.cy / 2 + 0.25, "cy: measure from the picture's border"),
    ],
)
def test_wrong_cameras(place: int, wrong, fragment: str) -> None:  # type: ignore[no-untyped-def]
    answer = right()
    answer[place] = wrong(camera())
    said = hints("10.1", answer, fragment)
    assert f"{right()[place]:.1f}" not in said


def test_other_things() -> None:
    hints("10.1", 459.0, "four numbers")
    hints("10.1", camera(), "no array of numbers")
    hints("10.1", right()[:3], "shape")
