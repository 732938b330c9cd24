"""A part whose painted edge images need no training: a perfect painter, for convex parts.

From control points it works out the eye that sees them so in its canonical frame, and draws every edge of the part
that faces this eye. What a painting method does with what it paints can be tried with it, and with the wrong part's.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields

import numpy as np
from scipy.optimize import least_squares

from acp_lab.cad.edges import facing
from acp_lab.control_points.canonical_frame import CanonicalFrame, canonical_frame
from acp_lab.control_points.view_regions import ALL_REGIONS
from acp_lab.generator.device import Device
from acp_lab.generator.painted.edge_images import PaintingFrame, draw_strokes
from acp_lab.generator.painted.image_generator import PointSet
from acp_lab.geometry.arrays import Float32Array, FloatArray
from acp_lab.prepared_part import PreparedPart
from tests.tracking.lit_part import lit_part


class Drawn:
    """An image generator in the frame at the pose.

    model: whose control points it is given. shown: whose edges it draws. asked: what it was asked for.
    """

    size = 128
    frame: PaintingFrame = "pose"

    def __init__(self, model: PreparedPart, shown: PreparedPart, regions: tuple[int, ...]) -> None:
        self.regions = regions
        self.asked: list[tuple[int, PointSet]] = []
        self._model, self._shown = model, shown

    def check_frame(self, wanted: PaintingFrame) -> None:
        assert wanted == self.frame

    def edge_image(self, points: FloatArray, region: int, point_set: PointSet = "regressed") -> Float32Array:
        self.asked.append((region, point_set))
        eye_obj = self._eye(points, region, point_set)
        frame, edges = self._frame(eye_obj, region), self._shown.edges
        seen = edges.take(np.flatnonzero(facing(edges, eye_obj).shows))
        half = 0.5 * edges.spacing_mm * seen.tangents_obj
        strokes = np.stack([frame.project(seen.points_obj + side * half) for side in (-1.0, 1.0)], 1)
        return draw_strokes(strokes, np.zeros(len(strokes), np.int64), 1, self.size, 0.8)[0]

    def _frame(self, eye_obj: FloatArray, region: int) -> CanonicalFrame:
        part = self._model.part
        return canonical_frame(eye_obj, part.box_centre, part.radius, ALL_REGIONS[region], self.size)

    def _eye(self, points: FloatArray, region: int, point_set: PointSet) -> FloatArray:
        part, view = self._model.part, ALL_REGIONS[region]
        w_obj = self._model.control_points(region, point_set)
        start = part.box_centre + 3.0 * part.diameter * view.sign * np.eye(3)[view.axis]
        found = least_squares(lambda eye: (self._frame(eye, region).project(w_obj) - points).ravel(), start)
        return np.asarray(found.x, np.float64)


@dataclass(frozen=True)
class DrawnPart(PreparedPart):
    """A prepared part with such a generator."""

    drawn: Drawn | None = field(default=None)

    def autoencoder(self, device: Device = "cpu") -> Drawn:  # type: ignore[override]
        assert self.drawn is not None
        return self.drawn


def drawn_part(
    model: PreparedPart, regions: tuple[int, ...] = (4,), shown: PreparedPart | None = None, points_share: float = 0.8
) -> DrawnPart:
    """The same part with painted images, of itself or of another part that is `shown`; W as in `lit_part`."""
    regressed = lit_part(model, regions, points_share).regressed_points
    values = {item.name: getattr(model, item.name) for item in fields(model)} | {"regressed_points": regressed}
    whole = PreparedPart(**values)
    return DrawnPart(**values, drawn=Drawn(whole, shown or whole, regions))
