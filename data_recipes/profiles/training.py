"""Trains the network of edge profiles: a shift and its spread for every candidate, by Student's likelihood.

Its tails are heavy: a candidate that belongs to a shadow, a scratch or another edge says nothing of the rest.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from acp_lab.generator.one_thread import one_thread
from acp_lab.generator.training_loop import AdamOneCycle, LossGradient, Training, batch_gradient
from acp_lab.tracking.learning.edge_profiles import (
    FARTHEST,
    FEATURES,
    LEAST_LOG_SPREAD,
    MOST_LOG_SPREAD,
    ProfileNetwork,
)
from data_recipes.profiles.examples import Examples

# Degrees of freedom of Student's distribution.
_FREEDOM = 3.0


@dataclass(frozen=True)
class ProfileTraining:
    """How the network is trained.

    Attributes:
        hidden: units of each of the two hidden layers.
        epochs, batch, peak_rate: of Adam on a one-cycle schedule.
        seed: of the first weights and of the order of the examples.
    """

    hidden: int = 48
    epochs: int = 20
    batch: int = 4096
    peak_rate: float = 4e-3
    seed: int = 0


def train(
    examples: Sequence[Examples], config: ProfileTraining, progress: Callable[[int, float], None] | None = None
) -> ProfileNetwork:
    """The network that explains the shifts of all examples best; progress: called with epochs done and mean loss."""
    with one_thread():
        features = np.concatenate([one.features for one in examples])
        mean, spread = features.mean(0), features.std(0) + 1e-3
        inputs = torch.from_numpy(np.clip((features - mean) / spread, -FARTHEST, FARTHEST))
        shifts = torch.from_numpy(np.concatenate([one.shifts_px for one in examples]))
        with torch.random.fork_rng():
            torch.manual_seed(config.seed)
            model = torch.nn.Sequential(
                torch.nn.Linear(FEATURES, config.hidden), torch.nn.ReLU(),
                torch.nn.Linear(config.hidden, config.hidden), torch.nn.ReLU(),
                torch.nn.Linear(config.hidden, 2),
            )  # fmt: skip
        generator = torch.Generator().manual_seed(config.seed)
        steps = -(-len(shifts) // config.batch)
        optimiser = AdamOneCycle(model.parameters(), config.peak_rate, config.epochs * steps)

        def batches(epoch: int) -> tuple[Tensor, ...]:
            return torch.randperm(len(shifts), generator=generator).split(config.batch)

        def gradient(batch: Tensor) -> LossGradient:
            return batch_gradient(student_loss(model(inputs[batch]), shifts[batch]).mean(), optimiser.parameters)

        for epoch in Training(config.epochs, batches, gradient, optimiser.step).run():
            if progress is not None:
                progress(epoch.done, epoch.loss)
    tensors = [parameter.detach().numpy() for parameter in model.parameters()]
    weights = tuple(np.ascontiguousarray(tensor.T) for tensor in tensors[::2])
    return ProfileNetwork(weights, tuple(tensors[1::2]), mean, (1.0 / spread).astype(np.float32))


def student_loss(found: Tensor, shifts_px: Tensor) -> Tensor:
    """(k,) minus the log-likelihood, but for a constant, of shifts (k,) by a network's answers (k, 2)."""
    log_spread = found[:, 1].clamp(LEAST_LOG_SPREAD, MOST_LOG_SPREAD)
    normalised = (shifts_px - found[:, 0]) / log_spread.exp()
    return log_spread + 0.5 * (_FREEDOM + 1.0) * torch.log1p(normalised.square() / _FREEDOM)


def mean_loss(network: ProfileNetwork, examples: Examples) -> float:
    """Of a network on examples that it was not trained on."""
    found = torch.from_numpy(network(examples.features))
    return float(student_loss(found, torch.from_numpy(examples.shifts_px)).mean())


def constant_loss(shown: Sequence[Examples], held_out: Sequence[Examples]) -> float:
    """Mean over scenes held out of the loss of one shift and spread, the best for those shown: what is to be beaten."""
    shifts_px = np.concatenate([one.shifts_px for one in shown]).astype(np.float64)
    shift, spread = float(np.median(shifts_px)), 1.0
    for _ in range(60):
        weights = (_FREEDOM + 1.0) / (_FREEDOM + ((shifts_px - shift) / spread) ** 2)
        shift = float((weights * shifts_px).sum() / weights.sum())
        spread = max(float(np.sqrt((weights * (shifts_px - shift) ** 2).mean())), 1e-6)
    answer = torch.tensor([[shift, float(np.log(spread))]])
    return float(np.mean([student_loss(answer, torch.from_numpy(one.shifts_px)).mean() for one in held_out]))
