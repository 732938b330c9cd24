"""Whatever a learner hands in is read, or answered by a sentence."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import torch

from acp_lab.course.answers import Hint, as_array, as_choice, as_choices, as_function, as_number, near


def test_a_function_may_write_into_what_it_is_given() -> None:
    points = np.ones((2, 3))

    def in_place(given: np.ndarray, factor: float) -> np.ndarray:
        given *= factor
        return given

    assert (as_function(in_place, "a function")(points, 2.0) == 2.0).all()
    assert (points == 1.0).all()


def test_arrays_of_any_kind() -> None:
    assert as_array([[1, 2], [3, 4]], (2, 2), "a square").dtype == np.float64
    assert as_array(((1, 2),) * 5, (None, 2), "pixels").shape == (5, 2)


@pytest.mark.parametrize(
    ("answer", "fragment"),
    [
        ([[1, 2, 3]], "shape (1, 3)"),
        (3.0, "shape ()"),
        ([[1, 2], [3]], "no array of numbers"),
        ("abc", "a str"),
        ([[math.nan, 1.0]], "not finite"),
        (object(), "a object"),
        ([[10**400, 0]], "a list"),
        (torch.zeros(3, 2, requires_grad=True), "a Tensor"),
    ],
)
def test_what_is_no_such_array(answer: Any, fragment: str) -> None:
    with pytest.raises(Hint, match="pixels") as caught:
        as_array(answer, (None, 2), "pixels, (n, 2)")
    assert fragment in str(caught.value)


def test_numbers() -> None:
    assert as_number(np.float32(2.5), "mm") == 2.5
    assert as_number(np.array([3]), "mm") == 3.0


@pytest.mark.parametrize(
    "answer", ["3", True, math.inf, math.nan, [1, 2], object(), 1j, 10**400, torch.zeros(1, requires_grad=True)]
)
def test_what_is_no_number(answer: Any) -> None:
    with pytest.raises(Hint, match="a length in mm"):
        as_number(answer, "a length in mm")


def test_choices() -> None:
    words = ("Depth", "in the plane")
    assert as_choice("  depth ", words) == "Depth"
    assert as_choices(["IN THE  plane", "depth"], words) == {"Depth", "in the plane"}
    assert as_choices("depth", words) == {"Depth"}
    assert as_choices([], words) == frozenset()


class _Broken:
    def __iter__(self) -> Iterator[str]:
        raise RuntimeError


@pytest.mark.parametrize("answer", ["height", 3, ["depth", "height"], [3], _Broken()])
def test_what_is_no_choice(answer: Any) -> None:
    with pytest.raises(Hint, match="Depth, in the plane"):
        as_choices(answer, ("Depth", "in the plane"))


def test_functions_tell_their_own_errors() -> None:
    assert as_function(lambda x: x + 1, "a function of x")(2) == 3
    with pytest.raises(Hint, match="hand in the function itself"):
        as_function(3, "a function of x")
    with pytest.raises(Hint, match="stopped with ZeroDivisionError: division by zero"):
        as_function(lambda x: x / 0, "a function of x")(2)
    with pytest.raises(Hint, match="begin with return"):
        as_function(lambda x: None, "a function of x")(2)
    with pytest.raises(Hint, match="stopped with TypeError"):
        as_function(lambda: 1, "a function of x")(2)


def test_near() -> None:
    assert near(1.009, 1.0)
    assert not near(1.011, 1.0)
    assert near(0.3, 0.0, absolute=0.5)
    assert not near(math.nan, 1.0)
