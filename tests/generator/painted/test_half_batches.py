"""The gradient by halves is the gradient, in threads or not."""

from __future__ import annotations

import threading
from collections.abc import Sequence

import pytest
import torch
from torch import Tensor

from acp_lab.generator.painted.half_batches import halves_gradient, two_threads

pytestmark = pytest.mark.usefixtures("one_torch_thread")


@pytest.mark.parametrize("count", [1, 2, 7, 8])
@pytest.mark.parametrize("threaded", [False, True])
def test_halves_add_up_to_the_batch(count: int, threaded: bool) -> None:
    torch.manual_seed(0)
    layer, items = torch.nn.Linear(5, 3).double(), list(torch.randn(count, 5, dtype=torch.float64))

    def mean_loss(some: Sequence[Tensor]) -> Tensor:
        return layer(torch.stack(list(some))).square().mean()

    parameters = list(layer.parameters())
    loss = mean_loss(items)
    expected = torch.autograd.grad(loss, parameters)
    with two_threads() as workers:
        found = halves_gradient(items, mean_loss, parameters, workers if threaded else None)
    assert found.loss == pytest.approx(loss.item())
    for one, other in zip(found.gradients, expected, strict=True):
        torch.testing.assert_close(one, other)


def test_the_halves_are_computed_at_once_by_two_threads_of_one_each() -> None:
    together, seen = threading.Barrier(2, timeout=30.0), []
    weight = torch.nn.Parameter(torch.ones(1))

    def mean_loss(some: Sequence[float]) -> Tensor:
        together.wait()  # would time out if one half waited for the other
        seen.append((threading.get_ident(), torch.get_num_threads()))
        return weight.sum() * sum(some)

    torch.set_num_threads(3)
    with two_threads() as workers:
        halves_gradient([1.0, 2.0], mean_loss, [weight], workers)
    assert len({thread for thread, _ in seen}) == 2
    assert [count for _, count in seen] == [1, 1]


def test_what_goes_wrong_in_a_thread_comes_out() -> None:
    def mean_loss(some: Sequence[float]) -> Tensor:
        raise ValueError("no such view")

    with two_threads() as workers, pytest.raises(ValueError, match="no such view"):
        halves_gradient([1.0, 2.0], mean_loss, [], workers)
