"""What the edge image generator of one region is trained on: views, cameras, drawn images, control points.

Every epoch shows each view once. Where the canonical frame stands at the pose itself, by the same camera, so that its
image is drawn only once and its edges need not be kept; where it stands at a prediction, by a freshly jittered one.
All random choices of an epoch come from (seed, region, stage, epoch), so that a training that is resumed from its
checkpoint ends in the same numbers as one in one go.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
import torch
from torch import Tensor

from acp_lab.cad.part import Part
from acp_lab.cad.raycast import RayCaster
from acp_lab.control_points.view_regions import ViewRegion
from acp_lab.generator.painted.edge_images import (
    EdgeImageConfig,
    EdgeView,
    draw_views,
    edge_views,
    jitter_homographies,
    true_points,
)
from acp_lab.generator.painted.image_generator import PointSet
from acp_lab.geometry.arrays import Float32Array, FloatArray
from acp_lab.geometry.homography import apply_homography

Jittered = tuple[EdgeView, FloatArray]
"""A view, and the homography (3, 3) from its canonical frame into that of the camera, jittered or not."""

# In place of a stage: random choices that belong to none.
_FOR_WHITENING, _FOR_HELD_OUT = 8, 9


@dataclass(frozen=True)
class Batch:
    """images: (b, 1, size, size), empty where a stage draws none; points: (b, 8) canonical px, by W."""

    images: Tensor
    points: Mapping[PointSet, Tensor]

    def to(self, device: torch.device) -> Batch:
        """The same on a device."""
        return Batch(self.images.to(device), {name: points.to(device) for name, points in self.points.items()})


class TrainingSet:
    """The views of one region.

    Attributes:
        points_obj: (4, 3) mm by W, the control points that the jittered cameras see.
        batches_per_epoch: number of batches.
    """

    def __init__(
        self,
        part: Part,
        caster: RayCaster,
        region: ViewRegion,
        points_obj: Mapping[PointSet, FloatArray],
        config: EdgeImageConfig,
        batch: int,
        seed: int,
    ) -> None:
        self.points_obj = points_obj
        self._config, self._batch, self._seed, self._region = config, batch, seed, region.index
        # By the identity of a view, which lives as long as its set; filled where a view is always seen the same.
        self._drawn: dict[int, np.ndarray] = {}
        views = edge_views(part, caster, region, config, config.views + config.held_out, seed)
        self._views = [self._kept(view) for view in islice(views, config.views)]
        self._held_out = self._jitter(list(views), self._rng(_FOR_HELD_OUT, 0))
        self.batches_per_epoch = math.ceil(len(self._views) / batch)

    def batches(self, stage: int, epoch: int) -> Iterator[list[Jittered]]:
        """The batches of an epoch (0-based): every view once, each by a camera of its own if cameras are jittered."""
        rng = self._rng(stage, epoch + 1)
        order = rng.permutation(len(self._views))
        for start in range(0, len(order), self._batch):
            yield self._jitter([self._views[row] for row in order[start : start + self._batch]], rng)

    def batch(self, jittered: Sequence[Jittered], draws: bool) -> Batch:
        """Views as the networks take them; `draws`: with their images."""
        images = self.images(jittered)[:, None] if draws else np.empty(0, np.float32)
        points = self.control_points(jittered)
        return Batch(torch.from_numpy(images), {name: torch.from_numpy(value) for name, value in points.items()})

    def held_out(self, count: int | None = None) -> list[Jittered]:
        """The first `count` held-out views, default all; always by the same cameras."""
        return self._held_out[:count]

    def typical_points(self) -> dict[PointSet, Float32Array]:
        """(n, 8) by W: the control points of all training views, each by one jittered camera."""
        return self.control_points(self._jitter(self._views, self._rng(_FOR_WHITENING, 0)))

    def images(self, jittered: Sequence[Jittered]) -> Float32Array:
        """(b, size, size) edge images of the views."""
        if self._config.frame == "prediction":
            return draw_views(*_apart(jittered), self._config.line_sigma_px)
        return np.stack([self._image(view) for view, _ in jittered])

    def control_points(self, jittered: Sequence[Jittered]) -> dict[PointSet, Float32Array]:
        """(b, 8) by W: the control points that the jittered cameras see, canonical px."""
        return {
            name: np.stack([apply_homography(h, view.frame.project(points)).reshape(8) for view, h in jittered]).astype(
                np.float32
            )
            for name, points in self.points_obj.items()
        }

    def _kept(self, view: EdgeView) -> EdgeView:
        """What is kept of a training view: some thousand of them with all their edges would fill the memory."""
        if self._config.frame == "prediction":
            return replace(view, points_obj=np.empty((0, 3)))
        light = replace(view, strokes=np.empty((0, 2, 2)), points_obj=np.empty((0, 3)))
        self._drawn[id(light)] = self._draw(view).astype(np.float16)
        return light

    def _image(self, view: EdgeView) -> Float32Array:
        drawn = self._drawn.get(id(view))
        return self._draw(view) if drawn is None else drawn.astype(np.float32)

    def _draw(self, view: EdgeView) -> Float32Array:
        return draw_views([view], np.eye(3)[None], self._config.line_sigma_px)[0]

    def _jitter(self, views: list[EdgeView], rng: np.random.Generator) -> list[Jittered]:
        if self._config.frame != "prediction":
            return [(view, np.eye(3)) for view in views]
        homographies = jitter_homographies([view.frame for view in views], self._config, rng)
        return list(zip(views, homographies, strict=True))

    def _rng(self, stage: int, epoch: int) -> np.random.Generator:
        return np.random.default_rng([self._seed, self._region, stage, epoch])


def edges_of(jittered: Sequence[Jittered]) -> list[FloatArray]:
    """True edge points (n, 2) of each view in its jittered camera."""
    return [true_points(view, h) for view, h in jittered]


def _apart(jittered: Sequence[Jittered]) -> tuple[list[EdgeView], FloatArray]:
    return [view for view, _ in jittered], np.stack([h for _, h in jittered])
