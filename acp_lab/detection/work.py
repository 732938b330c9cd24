"""Long computations in slices, so that a tracker can spread a search over many frames.

A computation is a generator: it yields what the slice behind it cost and returns its result at the end. Costs are
counted from sizes, not timed, so that results do not depend on the machine's speed. A unit is about a microsecond of
one core of a present-day computer.
"""

from __future__ import annotations

from collections.abc import Generator
from typing import Generic, TypeVar

T = TypeVar("T")
Steps = Generator[float, None, T]
"""Yields the work of each slice, returns a result."""


def finish(steps: Steps[T]) -> T:
    """The result, with all of the work done now."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            result: T = end.value
            return result


class Errand(Generic[T]):
    """A computation that is taken up again and again.

    result: None until it is done. is_done: whether it ended, with an error perhaps. worked: whether any slice cost
    anything.
    """

    def __init__(self, steps: Steps[T]) -> None:
        self._steps = steps
        self.result: T | None = None
        self.is_done = self.worked = False

    def go_on(self, budget: float) -> float:
        """Work until the budget is spent or the result is there; what is left of the budget, below 0 by a slice."""
        while budget > 0.0 and not self.is_done:
            try:
                budget -= next(self._steps)
                self.worked = True
            except StopIteration as end:
                self.result, self.is_done = end.value, True
            except BaseException:
                self.is_done = True  # a generator that raised would only end next time
                raise
        return budget
