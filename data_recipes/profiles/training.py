"""Trains the network of edge profiles: a shift, its spread and its slopes for every candidate, by Student's likelihood.

Its tails are heavy: a candidate that belongs to a shadow, a scratch or another edge says nothing of the rest.

What the edges of a part have in common is told as a tracker tells it (`edge_traits`): a step of the training takes a
scene, finds the traits that make the edges of some of its views agree, whatever their poses, and asks how well they
explain all views of it. So slopes are learnt that move edges by what one view of a part tells of the others, and traits
need no names: nobody tells the network how far a part's edges are broken.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from acp_lab.generator.one_thread import one_thread
from acp_lab.generator.training_loop import AdamOneCycle, LossGradient, Training, batch_gradient
from acp_lab.geometry.arrays import Float32Array
from acp_lab.tracking.learning.edge_profiles import (
    FARTHEST,
    FEATURES,
    LEAST_LOG_SPREAD,
    MOST_LOG_SPREAD,
    ProfileConfig,
    ProfileNetwork,
)
from acp_lab.tracking.learning.edge_traits import FREEDOM
from data_recipes.profiles.examples import Examples

# Enough for weights to settle.
_ROUNDS = 3
# By so many px (rms) a view's pose step may move its edges: as in the tracker, edges alone tell it.
_DOUBT_PX = 30.0
# The first slopes are small, lest the first traits are wild.
_FIRST_SLOPES = 0.3


@dataclass(frozen=True)
class ProfileTraining:
    """How the network is trained.

    Attributes:
        hidden: units of each of the two hidden layers; traits: how many it knows of.
        epochs, peak_rate: of Adam on a one-cycle schedule, a scene a step.
        usual_share: of the loss that is of a usual part, none of whose traits are known.
        seed: of the first weights and of the order of the scenes.
    """

    hidden: int = 48
    traits: int = 2
    epochs: int = 14
    peak_rate: float = 3e-3
    usual_share: float = 0.25
    seed: int = 0


@dataclass(frozen=True, eq=False)
class _Scene:
    """Examples as tensors: inputs (k, FEATURES), shifts (k,) px, Jacobian (k, 6), views (k,), best (k,) bool."""

    inputs: Tensor
    shifts: Tensor
    jacobian: Tensor
    views: Tensor
    best: Tensor

    @staticmethod
    def of(examples: Examples, mean: np.ndarray, spread: np.ndarray) -> _Scene:
        """Features less their mean, in spreads of them."""
        inputs = np.clip((examples.features - mean) / spread, -FARTHEST, FARTHEST)
        arrays = inputs.astype(np.float32), examples.shifts_px, _to_one_size(examples.jacobian)
        return _Scene(*map(torch.from_numpy, (*arrays, examples.views, examples.best)))


def _to_one_size(jacobian: Float32Array) -> Float32Array:
    """(k, 6) with columns of root mean square 1: turns in rad and shifts in mm alike move edges by about a px."""
    return jacobian / np.sqrt((jacobian**2).mean(0) + np.float32(1e-12))


def train(
    examples: Sequence[Examples], config: ProfileTraining, progress: Callable[[int, float], None] | None = None
) -> ProfileNetwork:
    """The network that explains the shifts of all scenes best; progress: called with epochs done and mean loss."""
    with one_thread():
        features = np.concatenate([one.features for one in examples])
        mean, spread = features.mean(0), features.std(0) + 1e-3
        scenes = [_Scene.of(one, mean, spread) for one in examples]
        with torch.random.fork_rng():
            torch.manual_seed(config.seed)
            model = torch.nn.Sequential(
                torch.nn.Linear(FEATURES, config.hidden), torch.nn.ReLU(),
                torch.nn.Linear(config.hidden, config.hidden), torch.nn.ReLU(),
                last := torch.nn.Linear(config.hidden, 2 + config.traits),
            )  # fmt: skip
            with torch.no_grad():
                last.weight[2:] *= _FIRST_SLOPES
        generator = torch.Generator().manual_seed(config.seed)
        optimiser = AdamOneCycle(model.parameters(), config.peak_rate, config.epochs * len(scenes))

        def batches(epoch: int) -> tuple[Tensor, ...]:
            return torch.randperm(len(scenes), generator=generator).split(1)

        def gradient(batch: Tensor) -> LossGradient:
            scene = scenes[int(batch[0])]
            loss = _loss(model(scene.inputs), scene, config.usual_share, generator)
            return batch_gradient(loss, optimiser.parameters)

        for epoch in Training(config.epochs, batches, gradient, optimiser.step).run():
            if progress is not None:
                progress(epoch.done, epoch.loss)
    tensors = [parameter.detach().numpy() for parameter in model.parameters()]
    weights = tuple(np.ascontiguousarray(tensor.T) for tensor in tensors[::2])
    return ProfileNetwork(weights, tuple(tensors[1::2]), mean, (1.0 / spread).astype(np.float32))


def _loss(found: Tensor, scene: _Scene, usual_share: float, generator: torch.Generator) -> Tensor:
    """Of a network's answers (k, 2 + traits): for a usual part, and with the traits that some of the views tell."""
    usual = student_loss(found[:, 0], found[:, 1], scene.shifts).mean()
    if found.shape[1] == 2:
        return usual
    views = scene.views.unique()
    some = int(torch.randint(max(len(views) // 2, 1), (), generator=generator)) + 1
    asked = views[torch.randperm(len(views), generator=generator)[:some]]
    traits = traits_of(found, scene.shifts, scene.jacobian, scene.views, scene.best & torch.isin(scene.views, asked))
    told = student_loss(found[:, 0] + found[:, 2:] @ traits, found[:, 1], scene.shifts).mean()
    return usual_share * usual + (1.0 - usual_share) * told


def traits_of(found: Tensor, shifts_px: Tensor, jacobian: Tensor, views: Tensor, asked: Tensor) -> Tensor:
    """(traits,) that make the candidates asked (k,) bool of some views agree, whatever the poses: `EdgeTraits.learn`.

    found: (k, 2 + traits) of the network; views: (k,) of each; jacobian: (k, 6), each column about 1 in size. What of
    an edge's evidence is new is what the tracker takes by default (`ProfileConfig.evidence_share`).
    """
    usual, slopes, rows = (shifts_px - found[:, 0])[asked], found[asked, 2:], jacobian[asked]
    spread, views = found[asked, 1].clamp(LEAST_LOG_SPREAD, MOST_LOG_SPREAD).exp(), views[asked]
    count, share = slopes.shape[1], ProfileConfig().evidence_share
    told = torch.zeros_like(usual)
    traits = torch.zeros(count)
    doubt = torch.eye(6) * (1.0 / _DOUBT_PX**2)
    for _ in range(_ROUNDS):
        left = (usual - told).detach()
        weights = share * (FREEDOM + 1.0) / (FREEDOM * spread.square() + left.square())
        weighted = slopes * weights[:, None]
        matrix, vector = torch.eye(count) + weighted.T @ slopes, weighted.T @ usual
        steps = []
        for view in views.unique():
            of_view = views == view
            moved = rows[of_view] * weights[of_view, None]
            both = moved.T @ slopes[of_view]
            sides = torch.cat([both, moved.T @ usual[of_view, None]], 1)
            step = torch.linalg.solve(moved.T @ rows[of_view] + doubt, sides)
            matrix, vector = matrix - both.T @ step[:, :count], vector - both.T @ step[:, count]
            steps.append((of_view, step))
        traits = torch.linalg.solve(matrix, vector)
        with torch.no_grad():
            told = slopes @ traits
            for of_view, step in steps:
                told[of_view] += rows[of_view] @ (step[:, count] - step[:, :count] @ traits)
    return traits


def student_loss(shift: Tensor, log_spread: Tensor, shifts_px: Tensor) -> Tensor:
    """(k,) minus the log-likelihood, but for a constant, of shifts (k,) by what a network says of each (k,)."""
    log_spread = log_spread.clamp(LEAST_LOG_SPREAD, MOST_LOG_SPREAD)
    normalised = (shifts_px - shift) / log_spread.exp()
    return log_spread + 0.5 * (FREEDOM + 1.0) * torch.log1p(normalised.square() / FREEDOM)


def mean_loss(network: ProfileNetwork, examples: Examples, with_traits: bool = True) -> float:
    """Of a network on a scene that it was not trained on, with the traits that its views tell or a usual part's."""
    found, shifts = torch.from_numpy(network(examples.features)), torch.from_numpy(examples.shifts_px)
    shift = found[:, 0]
    if with_traits and network.traits:
        jacobian = torch.from_numpy(_to_one_size(examples.jacobian))
        views, best = torch.from_numpy(examples.views), torch.from_numpy(examples.best)
        shift = shift + found[:, 2:] @ traits_of(found, shifts, jacobian, views, best)
    return float(student_loss(shift, found[:, 1], shifts).mean())


def constant_loss(shown: Sequence[Examples], held_out: Sequence[Examples]) -> float:
    """Mean over scenes held out of the loss of one shift and spread, the best for those shown: what is to be beaten."""
    shifts_px = np.concatenate([one.shifts_px for one in shown]).astype(np.float64)
    shift, spread = float(np.median(shifts_px)), 1.0
    for _ in range(60):
        weights = (FREEDOM + 1.0) / (FREEDOM + ((shifts_px - shift) / spread) ** 2)
        shift = float((weights * shifts_px).sum() / weights.sum())
        spread = max(float(np.sqrt((weights * (shifts_px - shift) ** 2).mean())), 1e-6)
    answer = torch.tensor(shift), torch.tensor(float(np.log(spread)))
    return float(np.mean([student_loss(*answer, torch.from_numpy(one.shifts_px)).mean() for one in held_out]))
