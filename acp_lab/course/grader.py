"""Exercises and their graders: `check("01.2", answer)` says right, or says something that helps.

A grader is a function of the answer, registered by `@exercise("01.2")` in the module of its notebook. It returns
the sentence of praise, which may tell more than the question did, or raises `Hint` with a sentence that brings the
learner further without giving the answer away.
"""

from __future__ import annotations

import html
import importlib
import importlib.util
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

from acp_lab.course.answers import Hint
from acp_lab.display.look import css_colour
from acp_lab.errors import AcpLabError

Grader = Callable[[Any], str]
_G = TypeVar("_G", bound=Grader)

_ID = re.compile(r"\d\d\.\d+")
_GRADERS: dict[str, Grader] = {}


class CourseError(AcpLabError):
    """An exercise that does not exist."""


@dataclass(frozen=True)
class Verdict:
    """What the grader says. True when the answer passed; shows itself in a notebook and when printed.

    exercise: such as "01.2". message: praise, or a hint.
    """

    exercise: str
    passed: bool
    message: str

    def __bool__(self) -> bool:
        return self.passed

    def __str__(self) -> str:
        return f"Exercise {self.exercise}: {'right' if self.passed else 'not yet'}. {self.message}"

    __repr__ = __str__

    def _repr_html_(self) -> str:
        # Colours of the theme for the text, so that it reads on a dark page as well as on a light one.
        mark, word, colour = ("✓", "right", "right") if self.passed else ("→", "not yet", "hint")
        return (
            f'<div style="border-left: 5px solid {css_colour(colour)}; padding: 0.4em 0.9em; max-width: 50em">'
            f"<b>{mark} Exercise {html.escape(self.exercise)}: {word}.</b> {html.escape(self.message)}</div>"
        )


def exercise(exercise_id: str) -> Callable[[_G], _G]:
    """Register a grader, as a decorator; "NN.k" in the module `lesson_NN`.

    Raises CourseError for a name of another form, or one that is taken.
    """
    if not _ID.fullmatch(exercise_id):
        raise CourseError(f"exercise '{exercise_id}': write it as notebook, dot, number, such as 01.2")

    def register(grader: _G) -> _G:
        known = _GRADERS.get(exercise_id)
        # The same function again is a module that was loaded anew.
        if known is not None and known.__qualname__ != grader.__qualname__:
            raise CourseError(f"exercise {exercise_id}: is graded by {known.__qualname__}: choose a new number")
        _GRADERS[exercise_id] = grader
        return grader

    return register


def check(exercise_id: str, answer: Any) -> Verdict:
    """Grade an answer; a wrong one, of whatever type, gets a hint and never an error.

    None stands for an exercise that was not begun. Raises CourseError for an exercise that does not exist.
    """
    grader = _grader(exercise_id)
    if answer is None or answer is ...:
        return Verdict(exercise_id, False, "Put your answer in place of the None above, then run the cell again.")
    try:
        return Verdict(exercise_id, True, grader(answer))
    except Hint as hint:
        return Verdict(exercise_id, False, str(hint))


def exercises(lesson: str) -> tuple[str, ...]:
    """The exercises of a notebook, such as "01", in their order; () when it has none."""
    _load(lesson)
    own = (name for name in _GRADERS if name.startswith(f"{lesson}."))
    return tuple(sorted(own, key=lambda name: int(name.partition(".")[2])))


def _grader(exercise_id: str) -> Grader:
    text = str(exercise_id)
    if _ID.fullmatch(text):
        _load(text[:2])
    if text not in _GRADERS:
        known = exercises(text[:2]) if _ID.fullmatch(text) else ()
        offer = f"choose one of {', '.join(known)}" if known else 'write it as the notebook does, such as "01.1"'
        raise CourseError(f"exercise {text}: there is none of that name: {offer}")
    return _GRADERS[text]


def _load(lesson: str) -> None:
    name = f"acp_lab.course.lesson_{lesson}"
    # Asked beforehand, so that an import that fails inside a lesson is not taken for a missing one.
    if lesson.isdecimal() and importlib.util.find_spec(name) is not None:
        importlib.import_module(name)
