"""The gradient of a batch as the mean of its two halves, each computed in a thread of its own.

torch can use several threads inside one operation. These networks are small, which makes that wasteful, and the sums
differ in their last digits with the number of threads. A half batch per thread, with one thread inside, is faster on
two cores and gives the same weights on any number of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from typing import TypeVar

import torch
from torch import Tensor

from acp_lab.generator.training_loop import LossGradient

T = TypeVar("T")


def two_threads() -> ThreadPoolExecutor:
    """Two workers whose torch operations take one thread each, denormals as zeros; to be closed, as a context."""
    return ThreadPoolExecutor(2, "half-batch", initializer=_set_up)


def _set_up() -> None:
    torch.set_num_threads(1)
    torch.set_flush_denormal(True)


def halves_gradient(
    items: Sequence[T],
    mean_loss: Callable[[Sequence[T]], Tensor],
    parameters: Sequence[torch.nn.Parameter],
    workers: Executor | None,
) -> LossGradient:
    """Loss and gradient of a batch of one item or more.

    Args:
        mean_loss: the loss () of some of the items, a mean over them; it is called in a worker.
        workers: of `two_threads`; None computes one half after the other, to the same numbers.
    """
    middle = (len(items) + 1) // 2
    halves = [half for half in (items[:middle], items[middle:]) if len(half)]

    def of_half(half: Sequence[T]) -> tuple[Tensor, ...]:
        loss = mean_loss(half)
        return (loss.detach(), *torch.autograd.grad(loss, parameters))

    found = list((map if workers is None else workers.map)(of_half, halves))
    mean = found[0]
    if len(found) == 2:
        share = middle / len(items)
        mean = tuple(share * a + (1.0 - share) * b for a, b in zip(*found, strict=True))
    return LossGradient(mean[0].item(), mean[1:])
