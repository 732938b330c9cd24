"""Which pose painted edges show: the errors of a painting network are not independent along the part.

One network paints all lines of a view, so its errors go together: a part that is painted a little too small, or
turned, has lines that are each off by a fraction of a pixel and all in the way of one pose. Independent errors of that
size would average out over some hundred edge points; these do not, and no tracker can undo them. So the errors are
judged by the pose that fits the painted lines best, beside how far off the lines are.

Convention: px of the full image; poses cam_T_obj, mm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from acp_lab.cad.edges import facing, visible_samples
from acp_lab.cad.raycast import RayCaster, make_caster
from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.control_points.view_regions import choose_region
from acp_lab.errors import PreparationError
from acp_lab.evaluation.metrics import add_mm
from acp_lab.generator.base import GeneratedEdges, VisibleSamples
from acp_lab.generator.painted.image_generator import PointSet
from acp_lab.generator.templates import RAY_OFFSET_IN_DIAMETERS
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose_step import move_pose
from acp_lab.prepared_part import PreparedPart
from acp_lab.tracking.frame_view import View
from acp_lab.tracking.sources.painted import PaintedRidges
from acp_lab.tracking.sources.rigid import outline_inset_mm, project_inset

MOST_POINTS = 5000
# A painted point further than this from every true edge is an invention, and says nothing of a pose.
FAR_PX = 3.0
_SCALE_PX = 1.0
_FITS = 8


@dataclass(frozen=True, eq=False)
class PaintingBias:
    """One view.

    Attributes:
        edges: the n painted edge points at the true pose.
        off_px: (n,) how far each lies from the true line, signed along its normal; NaN for inventions.
        fitted: (4, 4) the pose whose true edges fit the painted ones best.
        add_share: ADD between that pose and the true one, as a share of the diameter.
    """

    edges: GeneratedEdges
    off_px: FloatArray
    fitted: FloatArray
    add_share: float

    @property
    def mean_off_px(self) -> float:
        """Mean distance of painted points from the true lines, without inventions."""
        return float(np.nanmean(np.abs(self.off_px)))


class PaintingBench:
    """One part with its auto-encoder, and the true edges to judge it by: those that it was trained to paint."""

    def __init__(self, model: PreparedPart, point_set: PointSet = "regressed") -> None:
        """PreparationError when no auto-encoder is prepared."""
        self.model = model
        generator = model.autoencoder()
        self._source = PaintedRidges(frame=generator.frame).open(model, point_set)
        self._point_set = point_set
        self._inset_mm = outline_inset_mm(model)
        self._caster: RayCaster = make_caster(model.part)

    def view(self, camera: Camera, cam_T_obj: FloatArray) -> View:
        """What the generator is asked for at a pose (4, 4); PreparationError in a region that was not trained."""
        part = self.model.part
        region = choose_region(eye_position(cam_T_obj) - part.box_centre, 0.5 * part.box_size)
        if region not in self._source.regions:
            raise PreparationError(f"{part.name}: the auto-encoder of view region {region} is not trained")
        points_obj = self.model.control_points(region, self._point_set)
        return View(camera, cam_T_obj, region, points_obj, part, self._source.canonical_size)

    def painted(self, view: View) -> GeneratedEdges:
        """The ridges of what is painted at the view's prior."""
        return self._source.generate(view.at_pose(view.prior), MOST_POINTS)

    def bias(self, camera: Camera, cam_T_obj: FloatArray) -> PaintingBias:
        """The painted edges of a true pose (4, 4), and the pose that they show."""
        view = self.view(camera, cam_T_obj)
        painted = self.painted(view)
        fitted = self.fit(painted, view)
        part = self.model.part
        add_share = add_mm(part.vertices, fitted, cam_T_obj) / part.diameter
        return PaintingBias(painted, self._off(painted, view, cam_T_obj)[0], fitted, add_share)

    def fit(self, edges: GeneratedEdges, view: View) -> FloatArray:
        """(4, 4) the pose near the view's prior whose true edges fit edge points best, by Gauss-Newton."""
        pose, centre = view.prior, self.model.part.box_centre
        for _ in range(_FITS):
            off_px, points_obj = self._off(edges, view, pose)
            known = np.isfinite(off_px)
            lines = view.at_pose(pose).lines(points_obj[known], edges.normals[known])
            # Robust, as a tracker's loss is: Geman-McClure, by the square root of its weights.
            weights = 1.0 / (1.0 + (off_px[known] / _SCALE_PX) ** 2)
            step = np.linalg.lstsq(weights[:, None] * lines.jacobian, weights * off_px[known], rcond=None)[0]
            pose = move_pose(pose, centre, np.asarray(step, np.float64))
        return pose

    def _off(self, edges: GeneratedEdges, view: View, cam_T_obj: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(n,) signed px from the true line at a pose, NaN where there is none near; (n, 3) mm its nearest points."""
        samples, eye_obj = self.model.edges, eye_position(cam_T_obj)
        offset_mm = RAY_OFFSET_IN_DIAMETERS * self.model.part.diameter
        rows = np.flatnonzero(visible_samples(samples, self._caster, eye_obj, offset_mm))
        visible = VisibleSamples(rows, facing(samples, eye_obj).outline[rows], np.ones(len(rows)))
        true = project_inset(samples, visible, view, cam_T_obj, self._inset_mm)
        _, nearest = cKDTree(true.points).query(edges.points)
        gaps = edges.points - true.points[nearest]
        across = np.einsum("nj,nj->n", gaps, edges.normals)
        # Lines that run the same way: at a corner the nearest sample may belong to the other edge.
        along = np.abs(np.einsum("nj,nj->n", edges.tangents, true.tangents[nearest])) > np.cos(np.radians(20.0))
        near = (np.abs(across) < FAR_PX) & (np.linalg.norm(gaps, axis=1) < 2.0 * FAR_PX) & along
        return np.where(near, across, np.nan), samples.points_obj[true.sample_ids[nearest]]
