"""Reading answers: whatever a learner hands in becomes an array, a number, a choice, or a sentence that helps.

Graders compare what these functions return; they never see a list where they wait for an array, and a function
that fails tells its own error instead of the grader's.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from acp_lab.geometry.arrays import FloatArray


class Hint(Exception):
    """An answer that is not right yet; the message says what to look at, not what the answer is."""


def as_array(answer: Any, shape: Sequence[int | None], what: str) -> FloatArray:
    """The answer as float64 of a shape, in which None stands for any length.

    what: named in the hint, such as "four pixels, (4, 2)". Raises Hint for another shape or no numbers.
    """
    array = as_numbers(answer, what)
    fits = array.ndim == len(shape) and all(n is None or n == m for n, m in zip(shape, array.shape, strict=True))
    if not fits:
        raise Hint(f"This wants {what}; yours has shape {array.shape}.")
    if not np.isfinite(array).all():
        raise Hint(f"This wants {what}; yours holds a number that is not finite (NaN or infinity).")
    return array


def as_numbers(answer: Any, what: str) -> FloatArray:
    """The answer as float64 of any shape, finite or not; what: as in `as_array`. Raises Hint for what is no numbers."""
    try:
        return np.asarray(answer, dtype=np.float64)
    except Exception:  # text, ragged lists, numbers beyond all floats, tensors with a gradient: each has its own error
        raise Hint(f"This wants {what}; yours, a {type(answer).__name__}, is no array of numbers.") from None


def as_number(answer: Any, what: str) -> float:
    """The answer as one finite float; what: such as "a length in mm". Raises Hint."""
    if isinstance(answer, bool | str):
        raise Hint(f"This wants {what}, as a plain number.")
    try:
        number = float(np.asarray(answer, dtype=np.float64).item())
    except Exception:  # as above
        raise Hint(f"This wants {what}, as one number; yours is a {type(answer).__name__}.") from None
    if not math.isfinite(number):
        raise Hint(f"This wants {what}; yours is not finite.")
    return number


def as_choice(answer: Any, choices: Sequence[str]) -> str:
    """The answer as one of the choices, whatever its case and spaces; α is alpha. Raises Hint that lists them."""
    text = " ".join(str(answer).lower().replace("α", "alpha").split()) if isinstance(answer, str) else ""
    for choice in choices:
        if text == choice.lower():
            return choice
    raise Hint(f"Answer with one of these words, in quotes: {', '.join(choices)}.")


def as_choices(answer: Any, choices: Sequence[str]) -> frozenset[str]:
    """The answer as a set of some of the choices; one string alone will do. Raises Hint."""
    wanted = f"Answer with a list of some of these words, each in quotes: {', '.join(choices)}."
    given = [answer] if isinstance(answer, str) else answer
    try:
        items = list(given)
    except Exception:  # as above
        raise Hint(wanted) from None
    try:
        return frozenset(as_choice(item, choices) for item in items)
    except Hint:
        raise Hint(wanted) from None


def as_function(answer: Any, what: str) -> Callable[..., Any]:
    """The answer as a function that turns its own failures into hints; what: "a function of two poses".

    It gets copies of arrays: one that writes into them may still be right.
    """
    if not callable(answer):
        raise Hint(f"This wants {what}; hand in the function itself, without calling it.")

    def guarded(*arguments: Any) -> Any:
        try:
            result = answer(*(one.copy() if isinstance(one, np.ndarray) else one for one in arguments))
        except Exception as error:  # whatever a learner's function does
            raise Hint(f"Your function stopped with {type(error).__name__}: {error}") from None
        if result is None:
            raise Hint("Your function returns None: does its last line begin with return?")
        return result

    return guarded


def near(value: float, truth: float, relative: float = 0.01, absolute: float = 0.0) -> bool:
    """Whether two numbers agree within a share of the truth or an absolute distance."""
    return abs(value - truth) <= max(relative * abs(truth), absolute)
