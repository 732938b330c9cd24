"""A painting network without errors: what is left to lose when edges are read off a small picture.

It paints, of any rigid control points, the very edge image that a network is trained to paint. A tracker on its ridges
is what the paper's path could be at best, in this canonical frame, read in this way; the way from there to exact edges
is lost to the picture (lines closer than two pixels flow into one), the way from painted ones to there to training.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields

import numpy as np
from scipy.optimize import least_squares

from acp_lab.cad.edges import sample_edges
from acp_lab.cad.raycast import make_caster
from acp_lab.control_points.canonical_frame import CANONICAL_SIZE, CanonicalFrame, canonical_frame
from acp_lab.control_points.view_regions import ALL_REGIONS
from acp_lab.generator.device import Device
from acp_lab.generator.painted.edge_images import (
    MOST_SMOOTH_SAMPLES,
    OUTLINE_SHARE_OF_BREAK,
    PAINTING_SIZE,
    POINTS_PER_DIAMETER_128,
    EdgeImageConfig,
    PaintingFrame,
    analytic_view,
    draw_views,
)
from acp_lab.generator.painted.image_generator import POINT_SETS, PointSet
from acp_lab.geometry.arrays import Float32Array, FloatArray
from acp_lab.prepared_part import PreparedPart

# Where the search for an eye begins: diameters off; and how far off the region's axis, as shares of the way to its
# border. On the axis, and if that ends elsewhere, around it.
_START = 4.0
_ASIDE = [(0.0, 0.0), *((0.9 * x, 0.9 * y) for x in (-1, 0, 1) for y in (-1, 0, 1) if x or y)]
# A search that ends with control points further off has ended elsewhere, px.
_FOUND_PX = 0.05


class PerfectPainter:
    """In place of an `AutoencoderGenerator`, in the frame at the pose, for some regions; size: of its images, px."""

    name = "true edge images"
    frame: PaintingFrame = "pose"

    def __init__(self, model: PreparedPart, regions: tuple[int, ...], size: int) -> None:
        self.regions, self.size = regions, size
        self._part = model.part
        self._points_obj = {(r, which): model.control_points(r, which) for r in regions for which in POINT_SETS}
        spacing_mm = model.part.diameter / (POINTS_PER_DIAMETER_128 * size / CANONICAL_SIZE)
        self._edges = sample_edges(model.part, spacing_mm, max_smooth_samples=MOST_SMOOTH_SAMPLES)
        self._caster = make_caster(model.part)
        self._inset_mm = OUTLINE_SHARE_OF_BREAK * model.edge_break_mm

    def check_frame(self, wanted: PaintingFrame) -> None:
        """It is for methods that paint at the pose."""
        assert wanted == self.frame, "a perfect painter knows no prediction"

    def edge_image(self, points: FloatArray, region: int, point_set: PointSet = "regressed") -> Float32Array:
        """(size, size) the true edges of the part as the eye sees it that sees its control points so, (4, 2)."""
        eye_obj = self._eye(points, region, point_set)
        frame = self._frame(eye_obj, region)
        view = analytic_view(self._part, self._edges, self._caster, eye_obj, frame, self._inset_mm)
        return draw_views([view], np.eye(3)[None], EdgeImageConfig().line_sigma_px)[0]

    def _frame(self, eye_obj: FloatArray, region: int) -> CanonicalFrame:
        part = self._part
        return canonical_frame(eye_obj, part.box_centre, part.radius, ALL_REGIONS[region], self.size)

    def _eye(self, points: FloatArray, region: int, point_set: PointSet) -> FloatArray:
        part, view = self._part, ALL_REGIONS[region]
        w_obj = self._points_obj[region, point_set]
        towards, *aside = np.roll(np.eye(3), -view.axis, axis=0)

        def eye_obj(x: FloatArray) -> FloatArray:
            """Two slopes off the region's axis, and the logarithm of the way from the bounding sphere, outside it."""
            direction = view.sign * towards + x[0] * aside[0] + x[1] * aside[1]
            distance = part.radius + np.exp(x[2])
            return np.asarray(part.box_centre + distance * direction / np.linalg.norm(direction), np.float64)

        def off_px(x: FloatArray) -> FloatArray:
            return np.asarray(self._frame(eye_obj(x), region).project(w_obj) - points).ravel()

        sides = np.roll(part.box_size, -view.axis)
        best, least_px = np.zeros(3), np.inf
        for share in _ASIDE:
            start = np.array([*(np.array(share) * sides[1:] / sides[0]), np.log(_START * part.diameter)])
            found = least_squares(off_px, start)
            worst_px = float(np.abs(found.fun).max())
            if worst_px < least_px:
                best, least_px = found.x, worst_px
            if least_px < _FOUND_PX:
                break
        return eye_obj(best)


@dataclass(frozen=True)
class PerfectlyPainted(PreparedPart):
    """A prepared part whose painted images are the true ones."""

    painter: PerfectPainter | None = field(default=None)

    def autoencoder(self, device: Device = "cpu") -> PerfectPainter:  # type: ignore[override]
        """The painter."""
        assert self.painter is not None
        return self.painter


def perfectly_painted(
    model: PreparedPart, regions: tuple[int, ...], size: int = PAINTING_SIZE
) -> PerfectlyPainted:
    """The same part with a perfect painter for some view regions; PreparationError where W is not regressed.

    size: side of its images, px.
    """
    values = {item.name: getattr(model, item.name) for item in fields(model)}
    return PerfectlyPainted(**values, painter=PerfectPainter(model, regions, size))
