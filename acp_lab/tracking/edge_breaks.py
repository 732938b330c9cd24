"""What all edges of a part have in common: they are broken by more, or by less, than anybody knows.

A machinist breaks every edge of a part in one go, and one light falls on all of them. So what puts one image edge
beside the CAD's puts the others there too, and a thousand edge points that agree say no more of it than ten. Two
unknowns stand for that: by how many mm the edges of the outline are broken, and by how many the creases within it. (A
smooth outline has no edge to break; the light is the same for it.) A frame's information of the pose is told together
with that of these two: how exact the pose is depends on what is known of them (`uncertainty`).
(Not in the paper, which takes CAD edges as they are; see docs/paper-ledger.md.)
"""

from __future__ import annotations

import numpy as np

from acp_lab.cad.edges import EdgeSamples
from acp_lab.generator.base import GeneratedEdges
from acp_lab.geometry.arrays import FloatArray, plain
from acp_lab.tracking.frame_view import Estimate

COUNT = 2
"""Breaks: of the outline, of the creases within it."""


def into_material(samples: EdgeSamples) -> FloatArray:
    """(n, 3) unit: where an edge goes when it is broken, off the material in a concave corner, which is filled.

    Halfway between its faces; zero at the rim of an open mesh, which has one face only.
    """
    off = samples.off_obj
    length = np.linalg.norm(off, axis=1, keepdims=True)
    signs = np.where(samples.convex, -1.0, 1.0)[:, None]
    return plain(np.where(length > 1e-9, signs * off / np.maximum(length, 1e-9), 0.0))


class BrokenEdges:
    """How edge points move in the image by the two breaks.

    samples: the part's; into_obj: of these, see `into_material`; at: the estimate that the edges are seen at.
    """

    def __init__(self, samples: EdgeSamples, into_obj: FloatArray, at: Estimate) -> None:
        self._samples, self._into_obj, self._at = samples, into_obj, at

    def __call__(self, edges: GeneratedEdges, directions: FloatArray) -> FloatArray:
        """(n, 2) px per mm along image directions (n, 2); zeros where an edge point shows no known sample."""
        ids = edges.sample_ids
        # Lines are kept by their directions alone; those of other 3D points would be of painted edges, with no ids.
        points_obj = self._samples.points_obj.take(ids, axis=0)
        px_per_mm = self._at.lines(points_obj, directions).directions @ self._at.cam_T_obj[:3, :3]
        moved = np.einsum("nj,nj->n", px_per_mm, self._into_obj.take(ids, axis=0))
        if ids.min(initial=0) < 0:
            moved = np.where(ids >= 0, moved, 0.0)
        rows = np.empty((len(ids), COUNT))
        rows[:, 0] = moved * edges.outline
        rows[:, 1] = moved - rows[:, 0]
        return rows
