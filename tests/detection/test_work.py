"""Computations in slices: what they cost, and that a budget is kept."""

from __future__ import annotations

import pytest

from acp_lab.detection.work import Errand, Steps, finish


def counting(slices: int, cost: float) -> Steps[int]:
    for _ in range(slices):
        yield cost
    return slices


def test_finish_gives_the_result() -> None:
    assert finish(counting(7, 3.0)) == 7
    assert finish(counting(0, 3.0)) == 0


def test_an_errand_goes_on_where_it_stopped() -> None:
    errand = Errand(counting(7, 3.0))
    left = [errand.go_on(8.0) for _ in range(2)]
    assert left == [-1.0, -1.0]  # three slices each: the last one begins within the budget
    assert errand.result is None
    assert errand.go_on(8.0) == 5.0
    assert errand.result == 7
    assert errand.go_on(8.0) == 8.0


def test_without_a_budget_nothing_is_done() -> None:
    errand = Errand(counting(1, 3.0))
    assert errand.go_on(0.0) == 0.0
    assert errand.go_on(-2.0) == -2.0
    assert errand.result is None


def test_an_error_ends_an_errand() -> None:
    def failing() -> Steps[int]:
        yield 1.0
        raise RuntimeError

    errand = Errand(failing())
    with pytest.raises(RuntimeError):
        errand.go_on(5.0)
    assert errand.is_done
    assert errand.go_on(5.0) == 5.0
    assert errand.result is None


def test_a_result_may_be_none_and_cost_nothing() -> None:
    def nothing() -> Steps[None]:
        return
        yield

    errand = Errand(nothing())
    assert errand.go_on(5.0) == 5.0
    assert errand.is_done
    assert not errand.worked
