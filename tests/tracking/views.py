"""Views, and plain differences of motions, for the tests of what happens inside one frame."""

from __future__ import annotations

import numpy as np

from acp_lab.cad.part import Part
from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.control_points.coplanar_points import mid_section_points
from acp_lab.control_points.view_regions import ALL_REGIONS, choose_region
from acp_lab.generator.painted.edge_images import PaintingFrame
from acp_lab.generator.painted.image_generator import PointSet
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.tracking.frame_view import Estimate, View
from acp_lab.tracking.motions import Motion
from tests.tracking.rendered import CAMERA


def view_at(part: Part, cam_T_obj: FloatArray, camera: Camera = CAMERA) -> View:
    """The view of a pose in its own region, W the box's middle section."""
    region = ALL_REGIONS[choose_region(eye_position(cam_T_obj) - part.box_centre, 0.5 * part.box_size)]
    return View(camera, cam_T_obj, region.index, mid_section_points(part.box_min, part.box_max, region.axis), part)


def prior_of(view: View) -> Estimate:
    """The estimate that a frame starts with."""
    return view.at_pose(view.prior)


def differences(motion: Motion, at: Estimate, size: int, step: float) -> FloatArray:
    """(n, 2, size) how edge points move by each variable, by central differences."""
    columns = []
    for k in range(size):
        nudge = np.zeros(size)
        nudge[k] = step
        ahead, behind = (motion.edges(motion.moved(at, sign * nudge)).points for sign in (1.0, -1.0))
        columns.append((ahead - behind) / (2.0 * step))
    return np.stack(columns, 2)


class PaintedLines:
    """An image generator of which all is known: two soft lines through the control points' midpoints."""

    regions = tuple(range(6))
    size = 128
    frame: PaintingFrame = "prediction"

    def edge_images(self, points: FloatArray, region: int, point_set: PointSet = "regressed") -> FloatArray:
        return np.stack([self.edge_image(p, region, point_set) for p in points])

    def edge_image(self, points: FloatArray, region: int, point_set: PointSet = "regressed") -> FloatArray:
        y, x = np.mgrid[:128, :128].astype(np.float64)
        upright = points[:, 0].mean() + 0.2 * (y - 63.5) / 64.0 * (points[1, 0] - points[0, 0])
        level = points[:, 1].mean()
        near = np.minimum(np.abs(x - upright), np.abs(y - level))
        image: FloatArray = np.exp(-0.5 * (near / 1.0) ** 2).astype(np.float32)
        return image

    def edge_image_derivatives(
        self, points: FloatArray, region: int, point_set: PointSet
    ) -> tuple[FloatArray, FloatArray]:
        nudges = np.eye(8).reshape(8, 4, 2) * 1e-2
        ahead, behind = (self.edge_images(points + side * nudges, region) for side in (1.0, -1.0))
        return self.edge_image(points, region), np.moveaxis(ahead - behind, 0, -1) / 2e-2


class LeftHalf:
    """An image generator that paints everything left of the middle of the canonical frame, and nothing else."""

    regions = tuple(range(6))
    size = 128
    frame: PaintingFrame = "prediction"

    def edge_image(self, points: FloatArray, region: int, point_set: PointSet = "regressed") -> FloatArray:
        image = np.zeros((128, 128), np.float32)
        image[:, :64] = 1.0
        return image
