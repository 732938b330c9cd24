"""Asking for exercises, and what a verdict looks like; lessons have tests of their own."""

from __future__ import annotations

from typing import Any

import pytest

from acp_lab import course
from acp_lab.course import grader
from acp_lab.errors import AcpLabError


@pytest.fixture
def twelve(monkeypatch: pytest.MonkeyPatch) -> None:
    """An exercise of a lesson that does not exist; its answer is 12."""
    monkeypatch.setattr(grader, "_GRADERS", {})

    @course.exercise("77.1")
    def grade(answer: Any) -> str:
        if answer != 12:
            raise course.Hint("Count <again> & slowly.")
        return "Twelve it is."


@pytest.mark.usefixtures("twelve")
def test_right_and_wrong_answers() -> None:
    right, wrong = course.check("77.1", 12), course.check("77.1", 11)
    assert (right.passed, bool(right), right.message) == (True, True, "Twelve it is.")
    assert (wrong.passed, bool(wrong), wrong.message) == (False, False, "Count <again> & slowly.")
    assert str(right) == "Exercise 77.1: right. Twelve it is."
    assert str(wrong) == repr(wrong) == "Exercise 77.1: not yet. Count <again> & slowly."


@pytest.mark.usefixtures("twelve")
@pytest.mark.parametrize("nothing", [None, ...])
def test_an_exercise_that_was_not_begun(nothing: Any) -> None:
    verdict = course.check("77.1", nothing)
    assert not verdict.passed
    assert "in place of" in verdict.message


@pytest.mark.usefixtures("twelve")
def test_a_notebook_shows_words_and_escapes_them() -> None:
    shown = course.check("77.1", 11)._repr_html_()
    assert "not yet" in shown
    assert "Count &lt;again&gt; &amp; slowly." in shown
    assert "background" not in shown, "the page's theme decides on the ground"


@pytest.mark.usefixtures("twelve")
@pytest.mark.parametrize("name", ["77.2", "78.1", "nonsense", "", 7, "7.1", "77.1 "])
def test_exercises_that_do_not_exist(name: Any) -> None:
    with pytest.raises(course.CourseError, match=r"^exercise .*: there is none of that name: ") as caught:
        course.check(name, 12)
    assert isinstance(caught.value, AcpLabError)
    assert "\n" not in str(caught.value)


@pytest.mark.usefixtures("twelve")
def test_an_unknown_number_offers_those_of_the_lesson() -> None:
    with pytest.raises(course.CourseError, match=r"choose one of 77\.1"):
        course.check("77.9", 12)


@pytest.mark.usefixtures("twelve")
def test_exercises_in_the_order_of_their_numbers() -> None:
    for number in (10, 2):
        course.exercise(f"77.{number}")(lambda answer: "fine")
    assert course.exercises("77") == ("77.1", "77.2", "77.10")
    assert course.exercises("00") == ()
    assert course.exercises("no lesson") == ()


@pytest.mark.usefixtures("twelve")
def test_names_of_exercises_are_unique_and_well_formed() -> None:
    def other(answer: Any) -> str:
        return "fine"

    with pytest.raises(course.CourseError, match="choose a new number"):
        course.exercise("77.1")(other)
    with pytest.raises(course.CourseError, match=r"such as 01\.2"):
        course.exercise("1.2")
    course.exercise("77.5")(other)
    assert course.exercise("77.5")(other) is other, "a lesson may be loaded anew"


@pytest.mark.usefixtures("twelve")
def test_errors_of_a_grader_are_not_taken_for_hints() -> None:
    @course.exercise("77.3")
    def broken(answer: Any) -> str:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        course.check("77.3", 1)
