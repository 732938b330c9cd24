"""Training of the visibility network: views of one region by ray casting, then Adam on a BCE loss.

About 1000 views per region, as in paper IV-A, with some overlap into the neighbouring regions so
that the hysteresis of region choice never leaves what was learned.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from acp_lab.cad.edges import EdgeSamples, facing, nearly_showing, unoccluded
from acp_lab.cad.part import Part
from acp_lab.cad.raycast import RayCaster
from acp_lab.control_points.view_regions import ViewRegion, sample_directions
from acp_lab.generator.one_thread import one_thread
from acp_lab.generator.templates import RAY_OFFSET_IN_DIAMETERS
from acp_lab.generator.training_loop import AdamOneCycle, LossGradient, Training, batch_gradient
from acp_lab.generator.visibility import RegionNetwork, network_inputs

Progress = Callable[[int, int], None]

_DRAWING = threading.Lock()


@dataclass(frozen=True)
class TrainingConfig:
    """Settings of one region's training.

    Attributes:
        views: training views; held_out: further views for the report.
        overlap: share by which a region reaches into its neighbours.
        nearest, farthest: distances of the eye in diameters, sampled evenly in 1/distance.
        hidden: width of the two hidden layers.
    """

    views: int = 1000
    held_out: int = 150
    epochs: int = 30
    batch: int = 40
    peak_rate: float = 5e-3
    overlap: float = 0.3
    nearest: float = 1.5
    farthest: float = 12.0
    hidden: int = 128

    @classmethod
    def fast(cls) -> TrainingConfig:
        """A quarter of the views and two thirds of the epochs, for lessons and tests."""
        return cls(views=250, held_out=60, epochs=20)


@dataclass(frozen=True)
class TrainingReport:
    """How well one region's network tells free samples from hidden ones, on held-out views.

    Attributes:
        precision: share of samples called free that are.
        recall: share of free samples that are called so.
        hidden_found: share of hidden samples that are called hidden; most samples are free, so the two above
            are high even for a network that learned nothing.
        final_loss: mean BCE over the last epoch.
    """

    region: int
    precision: float
    recall: float
    hidden_found: float
    final_loss: float


@dataclass(frozen=True)
class _Views:
    inputs: np.ndarray  # (v, 8) float32
    asked: np.ndarray  # (v, n) bool, the sample nearly shows, so its hiding matters
    free: np.ndarray  # (v, n) bool
    shows: np.ndarray  # (v, n) bool


def train_region(
    part: Part,
    edges: EdgeSamples,
    caster: RayCaster,
    region: ViewRegion,
    config: TrainingConfig,
    seed: int,
    progress: Progress | None = None,
) -> tuple[RegionNetwork, TrainingReport]:
    """Train one region's network; the same seed and thread count give the same weights.

    Args:
        progress: called with (epochs done, epochs in all).
    """
    with one_thread():
        views = _make_views(part, edges, caster, region, config.views + config.held_out, config, seed)
        rows = np.flatnonzero(views.asked[: config.views].any(0))
        # Within a region some coordinates hardly vary; unscaled, the network would ignore them.
        seen = views.inputs[: config.views]
        mean, spread = seen.mean(0), seen.std(0) + 1e-3
        inputs = torch.from_numpy((views.inputs - mean) / spread)
        torch_seed = seed * 100 + region.index
        model = _network(config.hidden, len(rows), torch_seed)
        training = _training(model, inputs, views, rows, config, torch_seed)
        loss = float("nan")
        for epoch in training.run():
            loss = epoch.loss
            if progress is not None:
                progress(epoch.done, config.epochs)
        called = np.zeros_like(views.free[config.views :])
        with torch.no_grad():
            called[:, rows] = (model(inputs[config.views :]) > 0).numpy()
    return _stored(model, mean, spread, rows), _report(region.index, called, views, config.views, loss)


def _network(hidden: int, outputs: int, torch_seed: int) -> torch.nn.Sequential:
    # The generator that new layers take their weights from is one for all threads. No GPU is asked for its own.
    with _DRAWING, torch.random.fork_rng(devices=[]):
        torch.manual_seed(torch_seed)
        return torch.nn.Sequential(
            torch.nn.Linear(8, hidden),
            torch.nn.ReLU(),
            torch.nn.Linear(hidden, hidden),
            torch.nn.ReLU(),
            torch.nn.Linear(hidden, outputs),
        )


def _training(
    model: torch.nn.Sequential, inputs: Tensor, views: _Views, rows: np.ndarray, config: TrainingConfig, torch_seed: int
) -> Training[Tensor]:
    """Data, loss and schedule; a batch is a row of numbers (b,) of training views."""
    # Picking columns leaves an array whose rows are scattered, and rows are what batches are made of.
    free, asked = (
        torch.from_numpy(np.ascontiguousarray(of_views[: config.views, rows]))
        for of_views in (views.free, views.asked)
    )
    generator = torch.Generator().manual_seed(torch_seed)
    optimiser = AdamOneCycle(model.parameters(), config.peak_rate, config.epochs * -(-config.views // config.batch))

    def batches(epoch: int) -> tuple[Tensor, ...]:
        return torch.randperm(config.views, generator=generator).split(config.batch)

    def gradient(batch: Tensor) -> LossGradient:
        mask = asked[batch].float()
        loss = torch.nn.functional.binary_cross_entropy_with_logits(
            model(inputs[batch]), free[batch].float(), weight=mask, reduction="sum"
        ) / mask.sum().clamp(min=1.0)
        return batch_gradient(loss, optimiser.parameters)

    return Training(config.epochs, batches, gradient, optimiser.step)


def _stored(model: torch.nn.Sequential, mean: np.ndarray, spread: np.ndarray, rows: np.ndarray) -> RegionNetwork:
    """The trained network; the scaling of its inputs goes into the first layer."""
    tensors = [parameter.detach().numpy().astype(np.float32) for parameter in model.parameters()]
    weight1, bias1, weight2, bias2, weight3, bias3 = tensors
    bias1 = bias1 - weight1 @ (mean / spread)
    # Rounded to what is stored, so that a part gives the same edges before and after it was saved.
    weight3 = weight3.astype(np.float16).astype(np.float32)
    return RegionNetwork(weight1 / spread, bias1, weight2, bias2, weight3, bias3, rows.astype(np.int32))


def _report(region: int, called: np.ndarray, views: _Views, first: int, loss: float) -> TrainingReport:
    shows, free = views.shows[first:], views.free[first:]
    right = float((called & free & shows).sum())
    return TrainingReport(
        region,
        precision=right / max(float((called & shows).sum()), 1.0),
        recall=right / max(float((free & shows).sum()), 1.0),
        hidden_found=float((~called & ~free & shows).sum()) / max(float((~free & shows).sum()), 1.0),
        final_loss=loss,
    )


def _make_views(
    part: Part,
    edges: EdgeSamples,
    caster: RayCaster,
    region: ViewRegion,
    count: int,
    config: TrainingConfig,
    seed: int,
) -> _Views:
    rng = np.random.default_rng([seed, region.index, 1])
    directions = sample_directions(region, 0.5 * part.box_size, count, config.overlap, seed)
    nearness = rng.uniform(1.0 / config.farthest, 1.0 / config.nearest, count)
    inputs = np.empty((count, 8), np.float32)
    asked, free, shows = (np.zeros((count, len(edges)), bool) for _ in range(3))
    for row, (direction, near) in enumerate(zip(directions, nearness, strict=True)):
        eye_obj = part.box_centre + part.diameter / near * direction
        inputs[row] = network_inputs(part, eye_obj, region.index)
        asked[row] = nearly_showing(edges, eye_obj, margin_deg=2.0)
        rows = np.flatnonzero(asked[row])
        free[row, rows] = unoccluded(edges.take(rows), caster, eye_obj, RAY_OFFSET_IN_DIAMETERS * part.diameter)
        shows[row] = facing(edges, eye_obj).shows
    return _Views(inputs, asked, free, shows)
