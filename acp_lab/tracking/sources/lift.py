"""From generated edge points back to the CAD model: the 3D point that an edge point shows.

An edge image has no depth, and moving its edges as a rigid part moves ("w/o CP" in paper Table III) needs one. The
point is that of the nearest 3D edge sample that is visible at the pose; ray casting decides which are.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from acp_lab.cad.edges import EdgeSamples, facing, unoccluded
from acp_lab.cad.part import Part
from acp_lab.cad.raycast import RayCaster, make_caster
from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.generator.base import GeneratedEdges
from acp_lab.generator.templates import RAY_OFFSET_IN_DIAMETERS
from acp_lab.geometry.arrays import FloatArray, IntArray
from acp_lab.geometry.pose import transform
from acp_lab.tracking.frame_view import Estimate

# Further from any visible CAD edge, a painted edge is an invention of the network.
_FAR_PX = 4.0
_SAMPLES = 3000


class EdgeLifter:
    """Finds the 3D points of edge points of one part."""

    def __init__(self, part: Part, edges: EdgeSamples) -> None:
        self._all_points_obj = edges.points_obj
        # The first samples are spread evenly, and more than these would only cost time.
        self._edges = edges.take(np.arange(min(len(edges), _SAMPLES)))
        self._offset_mm = RAY_OFFSET_IN_DIAMETERS * part.diameter
        self._part = part

    @cached_property
    def _caster(self) -> RayCaster:
        # Only edge points that are no known samples need it.
        return make_caster(self._part)

    def lift(self, generated: GeneratedEdges, at: Estimate) -> FloatArray:
        """(n, 3) mm in the object frame, NaN where no visible CAD edge is near; known samples are what they are."""
        if (generated.sample_ids >= 0).all():
            return self._all_points_obj[generated.sample_ids]
        cam_T_obj = at.cam_T_obj
        eye_obj, camera = eye_position(cam_T_obj), at.view.camera
        lifted = np.full((len(generated), 3), np.nan)
        # Of the samples that turn this way only those near an edge point matter: rays are cast for these alone.
        rows = np.flatnonzero(facing(self._edges, eye_obj).shows)
        places = camera.project(transform(cam_T_obj, self._edges.points_obj[rows]))
        near = nearest_within(generated.points, places, _FAR_PX) >= 0
        rows, places = rows[near], places[near]
        seen = unoccluded(self._edges.take(rows), self._caster, eye_obj, self._offset_mm)
        rows, places = rows[seen], places[seen]
        nearest = nearest_within(places, generated.points, _FAR_PX)
        known = nearest >= 0
        lifted[known] = self._edges.points_obj[rows[nearest[known]]]
        return lifted


def nearest_within(places: FloatArray, points: FloatArray, far_px: float) -> IntArray:
    """(n,) for each of points (n, 2) the row of the nearest of places (m, 2); -1 where none is nearer than far_px.

    What has no place (NaN) is near nothing.
    """
    found = np.full(len(points), -1, np.int64)
    rows, asked = (np.flatnonzero(np.isfinite(each).all(1)) for each in (places, points))
    if len(rows):
        distances, nearest = cKDTree(places[rows]).query(points[asked], distance_upper_bound=far_px)
        near = np.isfinite(distances)
        found[asked[near]] = rows[nearest[near]]
    return found
