"""Edges of a rigid part: visible 3D edge samples at the estimate's pose.

Also what every source of 3D samples shares: outlines drawn where broken edges show them, samples moved to another pose,
and how their projections follow I.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np

from acp_lab.cad.edges import EdgeSamples, facing
from acp_lab.control_points.canonical_frame import CANONICAL_SIZE, eye_position
from acp_lab.errors import PreparationError
from acp_lab.generator.base import GeneratedEdges, RigidGenerator, VisibleSamples, project_samples
from acp_lab.generator.painted.edge_images import OUTLINE_SHARE_OF_BREAK
from acp_lab.generator.painted.image_generator import PointSet
from acp_lab.generator.templates import TemplateGenerator
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import transform
from acp_lab.geometry.pose_step import image_directions
from acp_lab.prepared_part import PreparedPart
from acp_lab.tracking.frame_view import Estimate, View

# For derivatives by differences: far from rounding, and the edges are nearly straight over it.
DIFFERENCE_PX = 0.25


@dataclass(frozen=True)
class CadSamples:
    """Configuration: 3D edge samples of the CAD model that a rigid generator chooses.

    Attributes:
        generator: "learned" (the visibility network), "templates", or "best": the first of these that is prepared.
        inset_outlines: draw outlines inside the CAD's by what broken edges take off (not in the paper); leave it off
            where the method learns the offsets of its samples.
        outlines_only: leave out all edges that are no silhouette, for methods that look at nothing else.
    """

    kind: ClassVar[str] = "cad-samples"
    knows_samples: ClassVar[bool] = True
    generator: Literal["best", "learned", "templates"] = "best"
    inset_outlines: bool = False
    outlines_only: bool = False

    def open(self, model: PreparedPart, point_set: PointSet) -> RigidSource:
        """The source of a part; PreparationError when the generator is not prepared."""
        generator = _rigid_generator(model, self.generator)
        inset_mm = outline_inset_mm(model) if self.inset_outlines else 0.0
        return RigidSource(generator, inset_mm, self.outlines_only)


class RigidSource:
    """t(I) of a rigid generator, such as the visibility network."""

    knows_samples = True

    def __init__(self, generator: RigidGenerator, inset_mm: float, outlines_only: bool = False) -> None:
        self.name = generator.name
        self.regions = generator.regions
        self.canonical_size = CANONICAL_SIZE
        self._generator = generator
        self._inset_mm, self._outlines_only = inset_mm, outlines_only
        self.is_exact = not inset_mm

    def generate(self, at: Estimate, count: int) -> GeneratedEdges:
        """The edges of an estimate."""
        pose = at.cam_T_obj
        if self._outlines_only and isinstance(self._generator, TemplateGenerator):
            visible = self._generator.outlines(pose, count)
        elif self._outlines_only:
            visible = self._generator.visible(pose, at.view.region, len(self._generator.edges))
            rows = np.flatnonzero(visible.outline)[:count]
            visible = VisibleSamples(visible.ids[rows], visible.outline[rows], visible.weights[rows])
        else:
            visible = self._generator.visible(pose, at.view.region, count)
        return project_inset(self._generator.edges, visible, at.view, pose, self._inset_mm)

    def reproject(self, at: Estimate, edges: GeneratedEdges) -> GeneratedEdges:
        """The same samples at the estimate's pose."""
        return project_again(self._generator.edges, edges, at, self._inset_mm)

    def flow(self, at: Estimate, edges: GeneratedEdges, by_differences: bool) -> FloatArray:
        """(n, 2, 8), see `rigid_flow`."""
        return rigid_flow(at, self._generator.edges.points_obj[edges.sample_ids], by_differences)


def outline_inset_mm(model: PreparedPart) -> float:
    """mm by which the outlines of the real part are expected to lie inside those of its CAD model."""
    return OUTLINE_SHARE_OF_BREAK * model.edge_break_mm


def project_inset(
    edges: EdgeSamples, visible: VisibleSamples, view: View, cam_T_obj: FloatArray, inset_mm: float
) -> GeneratedEdges:
    """Visible samples at a pose (4, 4), outlines drawn inside by inset_mm."""
    drawn = project_samples(edges, visible, cam_T_obj, view.camera)
    if not inset_mm:
        return drawn
    normals = drawn.normals
    points_cam = transform(cam_T_obj, edges.points_obj[visible.ids])
    directions_obj = image_directions(points_cam, normals, view.camera) @ cam_T_obj[:3, :3]
    # Which way along the image normal leads off the material.
    outward = np.sign(np.einsum("nj,nj->n", directions_obj, edges.off_obj[visible.ids]))
    px_per_mm = outward * np.linalg.norm(directions_obj, axis=1)
    offsets_px = np.where(visible.outline, -inset_mm, 0.0) * px_per_mm
    return replace(drawn, points=drawn.points + offsets_px[:, None] * normals)


def project_again(edges: EdgeSamples, drawn: GeneratedEdges, at: Estimate, inset_mm: float) -> GeneratedEdges:
    """Edge points of known samples moved to the pose of an estimate, with their weights as they were."""
    ids, outline = drawn.sample_ids, drawn.outline
    if inset_mm:
        outline = facing(edges, eye_position(at.cam_T_obj)).outline[ids]
    return project_inset(edges, VisibleSamples(ids, outline, drawn.weights), at.view, at.cam_T_obj, inset_mm)


def pose_flow(view: View, cam_T_obj: FloatArray, points_obj: FloatArray) -> FloatArray:
    """(n, 2, 6) how the projections of points_obj (n, 3) mm move by a pose step about the part's centre."""
    at = view.at_pose(cam_T_obj)
    along = (np.tile(axis, (len(points_obj), 1)) for axis in np.eye(2))
    return np.stack([at.lines(points_obj, directions).jacobian for directions in along], 1)


def rigid_flow(at: Estimate, points_obj: FloatArray, by_differences: bool) -> FloatArray:
    """(n, 2, 8) how projections of points_obj (n, 3) mm follow I through PnP.

    By the pose that follows I in the least-squares sense, or by differences of PnP itself.
    """
    view = at.view
    if not by_differences:
        pose = at.cam_T_obj
        # Two of the eight directions are no rigid motion; the pseudo-inverse gives the rigid motion next to them.
        return pose_flow(view, pose, points_obj) @ np.linalg.pinv(view.control_jacobian(pose))
    flow = np.empty((len(points_obj), 2, 8))
    for k, nudge in enumerate(np.eye(8).reshape(8, 4, 2) * DIFFERENCE_PX):
        ahead, behind = (
            view.camera.project(transform(view.at_points(at.control_points + sign * nudge).cam_T_obj, points_obj))
            for sign in (1.0, -1.0)
        )
        flow[:, :, k] = (ahead - behind) / (2.0 * DIFFERENCE_PX)
    return flow


def _rigid_generator(model: PreparedPart, name: str) -> RigidGenerator:
    if name == "best":
        return model.best_generator()
    if name not in model.generator_names:
        raise PreparationError(
            f"{model.part.name}: generator {name} is not prepared; {model.prepare_command} --generator {name}"
        )
    return model.best_generator() if name == "learned" or model.templates is None else model.templates
