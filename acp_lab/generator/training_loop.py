"""The one training loop: epochs of batches, the gradient of a loss on each batch, an optimiser's step along it.

A network hands over its data, its loss and its schedule; what happens between two epochs (progress, checkpoints,
pictures) is up to the caller, who iterates over them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
import torch
from torch import Tensor

Batch = TypeVar("Batch")


@dataclass(frozen=True)
class LossGradient:
    """loss: mean over a batch; gradients: of the loss, one per parameter, in their order."""

    loss: float
    gradients: tuple[Tensor, ...]


@dataclass(frozen=True)
class Epoch:
    """done: number of finished epochs, this one included; loss: mean over its batches."""

    done: int
    loss: float


@dataclass(frozen=True)
class Training(Generic[Batch]):
    """What a network hands over to be trained.

    Attributes:
        epochs: in all.
        batches: the data: batches of an epoch (0-based), in the order of the steps.
        gradient: the loss: its value on a batch and its gradient, see `batch_gradient`.
        step: the schedule: moves the parameters against a gradient. An optimiser counts its own steps and takes its
            rate from that count, so that it can go on from a checkpoint.
    """

    epochs: int
    batches: Callable[[int], Iterable[Batch]]
    gradient: Callable[[Batch], LossGradient]
    step: Callable[[Sequence[Tensor]], None]

    def run(self, first_epoch: int = 0) -> Iterator[Epoch]:
        """Train from an epoch (0-based) to the last; yields after each one."""
        for epoch in range(first_epoch, self.epochs):
            losses = []
            for batch in self.batches(epoch):
                found = self.gradient(batch)
                self.step(found.gradients)
                losses.append(found.loss)
            yield Epoch(epoch + 1, float(np.mean(losses)))


def batch_gradient(loss: Tensor, parameters: Sequence[torch.nn.Parameter]) -> LossGradient:
    """Value and gradient of a loss () that was computed from the parameters."""
    return LossGradient(loss.item(), torch.autograd.grad(loss, parameters))


class AdamOneCycle:
    """Adam, its rate and momentum on torch's one-cycle schedule: up to the peak rate, then down to nearly zero."""

    def __init__(self, parameters: Iterable[torch.nn.Parameter], peak_rate: float, steps: int) -> None:
        self.parameters = list(parameters)
        # Fused: one pass over the numbers of a parameter in place of ten.
        self._adam = torch.optim.Adam(self.parameters, lr=peak_rate, fused=True)
        self._schedule = torch.optim.lr_scheduler.OneCycleLR(self._adam, peak_rate, total_steps=steps)

    def step(self, gradients: Sequence[Tensor]) -> None:
        """Move the parameters against the gradients of a loss, one for each."""
        for parameter, gradient in zip(self.parameters, gradients, strict=True):
            parameter.grad = gradient
        self._adam.step()
        self._schedule.step()
