"""The edges that a CAD model truly shows at a pose: sampled once, hidden ones removed by rays, projected.

What generators t(I) are held against, and what the notebooks draw as truth.
Convention: px of the full image, poses cam_T_obj, mm.
"""

from __future__ import annotations

import numpy as np

from acp_lab.cad.edges import EdgeSamples, sample_edges, visible_samples
from acp_lab.cad.part import Part
from acp_lab.cad.raycast import make_caster
from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.generator.base import GeneratedEdges, VisibleSamples, project_samples
from acp_lab.generator.templates import RAY_OFFSET_IN_DIAMETERS
from acp_lab.geometry.arrays import FloatArray, IntArray
from acp_lab.geometry.camera import Camera


class TrueEdges:
    """A part's edges as any camera would see them.

    part: the CAD model. edges: its 3D edge samples. caster: answers what hides what.
    """

    def __init__(self, part: Part, edges: EdgeSamples | None = None) -> None:
        """edges: those of a prepared part; sampled anew by default. Raises PartError for a part without edges."""
        self.part = part
        self.edges = sample_edges(part) if edges is None else edges
        self.caster = make_caster(part)

    def rows(self, cam_T_obj: FloatArray) -> IntArray:
        """(k,) rows of the edge samples that are seen at a pose (4, 4), in their stable order."""
        offset_mm = RAY_OFFSET_IN_DIAMETERS * self.part.diameter
        return np.flatnonzero(visible_samples(self.edges, self.caster, eye_position(cam_T_obj), offset_mm))

    def at(self, cam_T_obj: FloatArray, camera: Camera) -> GeneratedEdges:
        """The edge points that are seen at a pose (4, 4), in the image of a camera, weights 1."""
        return self.project(self.rows(cam_T_obj), cam_T_obj, camera)

    def project(self, rows: IntArray, cam_T_obj: FloatArray, camera: Camera) -> GeneratedEdges:
        """Chosen samples (k,), seen or not, in the image of a camera: how the same edges move with the pose."""
        chosen = VisibleSamples(rows, np.zeros(len(rows), bool), np.ones(len(rows)))
        return project_samples(self.edges, chosen, cam_T_obj, camera)
