"""Training of one region's edge image generator (paper IV-A): the two stages, and two more that make it usable.

1. Auto-encoder: edge image -> latent code -> edge image, by eq. 4.
2. Latent regressor: control points -> latent code, by the mean square error against the encoder's codes; the decoder
   stays as it is. With this the paper is done.
3. Fine-tuning: regressor and decoder together, again by eq. 4. (Deviation from the paper; 0 epochs switch it off.)
4. A second regressor onto the same decoder, for control points that belong to the box's middle section as it is. Its
   targets are the codes of the first one, so no image is drawn.
"""

from __future__ import annotations

import hashlib
import math
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from acp_lab.cad.part import Part
from acp_lab.cad.raycast import RayCaster
from acp_lab.control_points.coplanar_points import mid_section_points
from acp_lab.control_points.view_regions import ViewRegion
from acp_lab.generator.denormals import denormals_as_zeros
from acp_lab.generator.device import Device, repeatable_convolutions, torch_device
from acp_lab.generator.one_thread import one_thread
from acp_lab.generator.painted.autoencoder import Decoder, Encoder, autoencoder_loss, bce_loss, inverse_psnr_loss
from acp_lab.generator.painted.checkpoint import Checkpoint, load_checkpoint
from acp_lab.generator.painted.config import AutoencoderConfig, AutoencoderReport
from acp_lab.generator.painted.edge_points import ridge
from acp_lab.generator.painted.half_batches import halves_gradient, two_threads
from acp_lab.generator.painted.image_generator import POINT_SETS, AutoencoderGenerator, PointSet, RegionAutoencoder
from acp_lab.generator.painted.latent_regressor import LatentRegressor
from acp_lab.generator.painted.orthogonal_steps import OrthogonalSteps
from acp_lab.generator.painted.pose_bias import pose_bias
from acp_lab.generator.painted.quality import comparison_grid, generation_quality
from acp_lab.generator.painted.training_set import Batch, Jittered, TrainingSet, edges_of
from acp_lab.generator.painted.watch import STAGE_NAMES, Watch, WatchedEpoch
from acp_lab.generator.training_loop import LossGradient, Training
from acp_lab.geometry.arrays import ByteImage, Float32Array, FloatArray

Progress = Callable[[int, int], None]

# The learning rate rises over this share of a stage, then falls along a cosine.
WARM_UP = 0.2
# A checkpoint of a training that computed its gradients otherwise would lead to other numbers.
_METHOD = "half batches"
GRID_ROWS = 8


@dataclass(frozen=True)
class TrainedRegion:
    """What training gives: the networks, how good they are, and a picture of held-out views.

    Attributes:
        grid: (h, w) uint8, a row per view: truth, auto-encoder, t(I).
    """

    autoencoder: RegionAutoencoder
    report: AutoencoderReport
    grid: ByteImage


def train_autoencoder(
    part: Part,
    caster: RayCaster,
    region: ViewRegion,
    regressed_points: FloatArray,
    config: AutoencoderConfig,
    seed: int,
    progress: Progress | None = None,
    checkpoint: Path | None = None,
    watch: Watch | None = None,
    device: Device = "auto",
) -> TrainedRegion:
    """Train one region's generator.

    On the CPU in two threads; the same seed gives the same weights on any number of cores. A GPU's weights are its own.

    Threads can be begun only while the program's main thread is alive: call it from there, or wait for it there.

    Args:
        regressed_points: (4, 3) mm, the region's W; the middle section's is trained beside it.
        progress: called with (epochs done, epochs in all), after the epoch was stored.
        checkpoint: file to store half-trained networks in and to resume from; it is left for the caller to remove.
        watch: shown what the networks paint after every epoch; it changes nothing in the result.
        device: "auto" takes a GPU where there is one.

    Raises:
        PreparationError: settings that do not fit together, or a device that is not there.
        PartError: the mesh has no edges.
        InputFileError: the checkpoint cannot be written.
    """
    points: dict[PointSet, FloatArray] = {
        "regressed": regressed_points,
        "mid-section": mid_section_points(part.box_min, part.box_max, region.axis),
    }
    on = torch_device(device)
    # This thread's own share of the work is small.
    with one_thread(), denormals_as_zeros(), repeatable_convolutions(on), two_threads() as workers:
        training = _RegionTraining(part, caster, region, points, config, seed, checkpoint, on)
        training.run(workers, progress, watch)
        return training.result()


@dataclass(frozen=True)
class _Stage:
    """What is particular to a stage; `draws`: its loss needs images."""

    epochs: int
    peak_rate: float
    parameters: list[torch.nn.Parameter]
    loss: Callable[[Batch], Tensor]
    draws: bool = True


class _RegionTraining:
    def __init__(
        self,
        part: Part,
        caster: RayCaster,
        region: ViewRegion,
        points_obj: Mapping[PointSet, FloatArray],
        config: AutoencoderConfig,
        seed: int,
        checkpoint: Path | None,
        device: torch.device,
    ) -> None:
        self._device = device
        self._begin = time.perf_counter()
        self._part, self._region, self._path = part, region.index, checkpoint
        w_obj = [points_obj[name].tolist() for name in POINT_SETS]
        marks = (_METHOD, config, seed, region.index, part.sha256, w_obj, device.type)
        self._belongs_to = hashlib.sha256(repr(marks).encode()).hexdigest()
        self._data = TrainingSet(part, caster, region, points_obj, config.images, config.batch, seed)
        self._shape, self._frame = replace(config.shape, size=config.images.size), config.images.frame
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed * 100 + region.index)
            self.encoder, self.decoder = Encoder(self._shape), Decoder(self._shape)
            self.regressors: dict[PointSet, LatentRegressor] = {
                name: LatentRegressor(self._shape) for name in POINT_SETS
            }
        for name, points in self._data.typical_points().items():
            self.regressors[name].standardise(points)
        for module in self._modules().values():
            module.to(device)
        self._stages = self._make_stages(config)
        self._reconstructions = torch.zeros(config.images.held_out, self._shape.size, self._shape.size)
        self._losses: list[float] = []
        self._earlier_s = 0.0

    def _make_stages(self, config: AutoencoderConfig) -> tuple[_Stage, ...]:
        first, second = self.regressors["regressed"], self.regressors["mid-section"]

        def reconstruction(batch: Batch) -> Tensor:
            return autoencoder_loss(self.decoder(self.encoder(batch.images)), batch.images)

        def code(batch: Batch) -> Tensor:
            with torch.no_grad():
                target = self.encoder(batch.images)
            return torch.nn.functional.mse_loss(first(batch.points["regressed"]), target)

        def generation(batch: Batch) -> Tensor:
            return autoencoder_loss(self.decoder(first(batch.points["regressed"])), batch.images)

        def same_code(batch: Batch) -> Tensor:
            with torch.no_grad():
                target = first(batch.points["regressed"])
            return torch.nn.functional.mse_loss(second(batch.points["mid-section"]), target)

        both = [*self.encoder.parameters(), *self.decoder.parameters()]
        tuned = [*first.parameters(), *self.decoder.parameters()]
        return (
            _Stage(config.autoencoder_epochs, config.autoencoder_rate, both, reconstruction),
            _Stage(config.latent_epochs, config.latent_rate, list(first.parameters()), code),
            _Stage(config.fine_tune_epochs, config.fine_tune_rate, tuned, generation),
            _Stage(config.second_epochs, config.latent_rate, list(second.parameters()), same_code, draws=False),
        )

    def run(self, workers: Executor, progress: Progress | None, watch: Watch | None = None) -> None:
        """All stages, from the checkpoint if there is a fitting one."""
        total = sum(stage.epochs for stage in self._stages)
        start = load_checkpoint(self._path, self._belongs_to) if self._path is not None else None
        done = 0
        for number, stage in enumerate(self._stages):
            if start is not None and number < start.stage:
                done += stage.epochs
                continue
            steps, first_epoch = OrthogonalSteps(stage.parameters), 0
            if start is not None and number == start.stage:
                self._restore(start, steps)
                first_epoch = start.epochs
                done += first_epoch
            else:
                self._losses.append(0.0)
            for epoch in self._training(number, steps, workers).run(first_epoch):
                self._losses[-1] = epoch.loss
                done += 1
                if number == 0 and epoch.done == stage.epochs:
                    self._reconstructions = self._reconstruct()
                self._store(number, epoch.done, steps)
                if progress is not None:
                    progress(done, total)
                if watch is not None:
                    watch(self._watched(number, epoch.done, done, total))

    def _training(self, number: int, steps: OrthogonalSteps, workers: Executor) -> Training[list[Jittered]]:
        """Data, loss and schedule of a stage."""
        stage, data = self._stages[number], self._data
        total = stage.epochs * data.batches_per_epoch
        # Without images a step is over before two threads have begun, and a GPU has threads of its own.
        shared = workers if stage.draws and self._device.type == "cpu" else None

        def mean_loss(jittered: Sequence[Jittered]) -> Tensor:
            return stage.loss(data.batch(jittered, stage.draws).to(self._device))

        def gradient(jittered: list[Jittered]) -> LossGradient:
            return halves_gradient(jittered, mean_loss, steps.parameters, shared)

        def step(gradients: Sequence[Tensor]) -> None:
            steps.step(gradients, stage.peak_rate * one_cycle((steps.count + 1) / total), shared)

        return Training(stage.epochs, partial(data.batches, number), gradient, step)

    def _reconstruct(self) -> Tensor:
        images = torch.from_numpy(self._data.images(self._data.held_out())[:, None]).to(self._device)
        with torch.no_grad():
            return torch.sigmoid(self.decoder(self.encoder(images)))[:, 0].cpu()

    def _watched(self, stage: int, epoch: int, done: int, total: int) -> WatchedEpoch:
        batch = self._data.batch(self._data.held_out(GRID_ROWS), draws=True).to(self._device)
        truth = batch.images
        with torch.no_grad():
            if stage == 0:
                codes = self.encoder(truth)
            else:
                name: PointSet = "mid-section" if STAGE_NAMES[stage] == "second regressor" else "regressed"
                codes = self.regressors[name](batch.points[name])
            logits = self.decoder(codes)
            painted = torch.sigmoid(logits)
            parts = bce_loss(logits, truth), inverse_psnr_loss(painted, truth), autoencoder_loss(logits, truth)
        return WatchedEpoch(
            STAGE_NAMES[stage],
            epoch,
            self._stages[stage].epochs,
            done,
            total,
            self._losses[-1],
            truth[:, 0].cpu().numpy(),
            painted[:, 0].contiguous().cpu().numpy(),
            *(part.item() for part in parts),
        )

    def result(self) -> TrainedRegion:
        """The stored form of the networks, judged as it will be used."""
        data = self._data
        stored = RegionAutoencoder.of_networks(self._shape, self.decoder, self.regressors, data.points_obj, self._frame)
        generator = AutoencoderGenerator({self._region: stored}, f"region {self._region}")
        held_out = data.held_out()
        truth, inputs = edges_of(held_out), data.control_points(held_out)
        generated = {
            which: generator.edge_images(inputs[which].reshape(-1, 4, 2), self._region, which) for which in POINT_SETS
        }
        reconstructed = self._reconstructions.numpy()
        first_loss, latent_loss, fine_tune_loss, second_loss = self._losses
        report = AutoencoderReport(
            self._region,
            generation_quality(generated["regressed"], truth),
            generation_quality(generated["mid-section"], truth),
            generation_quality(reconstructed, truth),
            first_loss,
            latent_loss,
            fine_tune_loss,
            second_loss,
            self._seconds(),
            self._bias_percent(generated["regressed"]),
        )
        drawn = data.images(held_out[:GRID_ROWS])
        grid = comparison_grid([drawn, reconstructed[:GRID_ROWS], generated["regressed"][:GRID_ROWS]])
        return TrainedRegion(stored, report, grid)

    def _bias_percent(self, generated: Float32Array) -> float | None:
        views = [view for view, _ in self._data.held_out()]
        if self._frame == "prediction" or np.isnan(views[0].points_obj).any():
            return None
        shares = [pose_bias(ridge(image), view, self._part) for image, view in zip(generated, views, strict=True)]
        return None if np.isnan(shares).all() else 100.0 * float(np.nanmedian(shares))

    def _seconds(self) -> float:
        return self._earlier_s + time.perf_counter() - self._begin

    def _modules(self) -> dict[str, torch.nn.Module]:
        modules: dict[str, torch.nn.Module] = {"encoder": self.encoder, "decoder": self.decoder}
        modules.update({str(name): regressor for name, regressor in self.regressors.items()})
        return modules

    def _store(self, stage: int, epochs: int, steps: OrthogonalSteps) -> None:
        if self._path is None:
            return
        tensors = {"reconstructions": self._reconstructions}
        for name, module in self._modules().items():
            tensors |= {f"{name}.{key}": value for key, value in module.state_dict().items()}
        for index, (first, second) in enumerate(zip(steps.first, steps.second, strict=True)):
            tensors |= {f"first.{index}": first, f"second.{index}": second}
        seconds, losses = self._seconds(), tuple(self._losses)
        Checkpoint(self._belongs_to, stage, epochs, steps.count, seconds, losses, tensors).save(self._path)

    def _restore(self, start: Checkpoint, steps: OrthogonalSteps) -> None:
        tensors = start.tensors
        for name, module in self._modules().items():
            module.load_state_dict({key: tensors[f"{name}.{key}"] for key in module.state_dict()})
        for index, (first, second) in enumerate(zip(steps.first, steps.second, strict=True)):
            first.copy_(tensors[f"first.{index}"])
            second.copy_(tensors[f"second.{index}"])
        steps.count = start.steps
        self._reconstructions = tensors["reconstructions"]
        self._losses, self._earlier_s = list(start.losses), start.train_s


def one_cycle(share: float) -> float:
    """Factor of the learning rate after a share 0..1 of a stage: from 0.04 up to 1 and down to 0, along cosines."""
    if share < WARM_UP:
        return 0.04 + 0.96 * 0.5 * (1.0 - math.cos(math.pi * share / WARM_UP))
    return 0.5 * (1.0 + math.cos(math.pi * (share - WARM_UP) / (1.0 - WARM_UP)))
