"""From generated edge points back to the CAD model: the 3D point that an edge point shows.

An edge image has no depth, and moving its edges as a rigid part moves ("w/o CP" in paper Table III) needs one. The
point is that of the nearest 3D edge sample that is visible at the pose; ray casting decides which are.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from acp_lab.cad.edges import EdgeSamples, facing, unoccluded
from acp_lab.cad.part import Part
from acp_lab.cad.raycast import RayCaster, make_caster
from acp_lab.compiled import kernel
from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.generator.base import GeneratedEdges
from acp_lab.generator.templates import RAY_OFFSET_IN_DIAMETERS
from acp_lab.geometry.arrays import FloatArray, IntArray, plain
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
    """(n,) for each of points (n, 2) the row of the nearest of places (m, 2); -1 where none is nearer than far_px."""
    order = np.argsort(places[:, 0])
    found = np.empty(len(points), np.int64)
    _nearest_within(np.ascontiguousarray(places[order]), plain(points), far_px, found)
    found[found >= 0] = order[found[found >= 0]]
    return found


@kernel("void(f8[:, ::1], f8[:, ::1], f8, i8[::1])")
def _nearest_within(places: FloatArray, points: FloatArray, far_px: float, found: IntArray) -> None:
    """See `nearest_within`; places in the order of their x, NaN last."""
    count = len(places)
    while count > 0 and np.isnan(places[count - 1, 0]):
        count -= 1
    for i in range(len(points)):
        x, y, best = points[i, 0], points[i, 1], far_px * far_px
        found[i] = -1
        # The first place right of the point; then from there both ways, until x alone is too far.
        low, high = 0, count
        while low < high:
            middle = (low + high) // 2
            if places[middle, 0] < x:
                low = middle + 1
            else:
                high = middle
        for direction in (1, -1):
            k = low if direction == 1 else low - 1
            while 0 <= k < count:
                dx, dy = places[k, 0] - x, places[k, 1] - y
                if dx * dx >= best:
                    break
                if dx * dx + dy * dy < best:
                    best, found[i] = dx * dx + dy * dy, k
                k += direction
