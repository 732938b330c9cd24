"""A part whose painted edge images need no training: every pixel is lit, so that each edge that faces the camera shows.

On a convex part that is what an auto-encoder should find, and the paper's path can be tried without one.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, fields

import numpy as np

from acp_lab.control_points.coplanar_points import mid_section_points
from acp_lab.control_points.view_regions import ALL_REGIONS
from acp_lab.generator.device import Device
from acp_lab.generator.painted.edge_images import PaintingFrame
from acp_lab.generator.painted.image_generator import PointSet
from acp_lab.geometry.arrays import Float32Array, FloatArray
from acp_lab.prepared_part import PreparedPart, Trained


class Lit:
    """An image generator for some regions that paints everything, and keeps what it was asked."""

    size = 32
    frame: PaintingFrame = "pose"

    def __init__(self, regions: tuple[int, ...]) -> None:
        self.regions = regions
        self.asked: list[tuple[int, PointSet]] = []

    def check_frame(self, wanted: PaintingFrame) -> None:
        pass

    def edge_image(self, points: FloatArray, region: int, point_set: PointSet = "regressed") -> Float32Array:
        self.asked.append((region, point_set))
        return np.ones((self.size, self.size), np.float32)


@dataclass(frozen=True)
class LitPart(PreparedPart):
    """A prepared part with such a generator."""

    lit: Lit = field(default_factory=lambda: Lit((4,)))

    def autoencoder(self, device: Device = "cpu") -> Lit:  # type: ignore[override]
        return self.lit


def lit_part(model: PreparedPart, regions: Iterable[int] = range(6), points_share: float = 0.8) -> LitPart:
    """The same part with painted images; W is regressed to the middle section, smaller by a share."""
    part, regions = model.part, tuple(regions)
    middle = {r: mid_section_points(part.box_min, part.box_max, ALL_REGIONS[r].axis) for r in regions}
    regressed = {r: part.box_centre + points_share * (w - part.box_centre) for r, w in middle.items()}
    values = {item.name: getattr(model, item.name) for item in fields(model)}
    values["regressed_points"] = Trained(regressed)
    return LitPart(**values, lit=Lit(regions))
