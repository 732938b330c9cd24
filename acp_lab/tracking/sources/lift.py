"""From generated edge points back to the CAD model: the 3D point that an edge point shows.

An edge image has no depth, and moving its edges as a rigid part moves ("w/o CP" in paper Table III) needs one. The
point is that of the nearest 3D edge sample that is visible at the pose; ray casting decides which are.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import cv2
import numpy as np
from scipy.spatial import cKDTree

from acp_lab.cad.edges import EdgeSamples, facing, unoccluded
from acp_lab.cad.part import Part
from acp_lab.cad.raycast import RayCaster, caster_of
from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.generator.base import GeneratedEdges
from acp_lab.generator.templates import RAY_OFFSET_IN_DIAMETERS
from acp_lab.geometry.arrays import BoolArray, FloatArray, IntArray
from acp_lab.geometry.pose import transform
from acp_lab.tracking.frame_view import Estimate

# Further from any visible CAD edge, a painted edge is an invention of the network.
_FAR_PX = 4.0
_SAMPLES = 3000
# An edge seen nearly end-on would otherwise outweigh all others.
_MOST_FORESHORTENED = 3.0
# Of a board over the image; edge points thrown further apart are compared one by one.
_MOST_SQUARES = 1e6
# Beyond it, whole numbers of squares would not be told apart.
_FARTHEST_SQUARE = 1e12


class EdgeLifter:
    """Finds the 3D points of edge points of one part."""

    def __init__(self, part: Part, edges: EdgeSamples) -> None:
        # With a last row of NaN, which is that of sample -1.
        self._points_obj = np.vstack([edges.points_obj, np.full(3, np.nan)])
        self._tangents_obj = edges.tangents_obj
        # The first samples are spread evenly, and more than these would only cost time.
        self._edges = edges.take(np.arange(min(len(edges), _SAMPLES)))
        self._offset_mm = RAY_OFFSET_IN_DIAMETERS * part.diameter
        self._part = part

    @cached_property
    def _caster(self) -> RayCaster:
        # Only edge points that are no known samples need it.
        return caster_of(self._part)

    def lift(self, generated: GeneratedEdges, at: Estimate) -> FloatArray:
        """(n, 3) mm in the object frame, NaN where no visible CAD edge is near; known samples are what they are."""
        return self.points_obj(self.samples(generated, at))

    def samples(self, generated: GeneratedEdges, at: Estimate) -> IntArray:
        """(n,) rows of the CAD's edge samples, -1 where no visible one is near; known samples are what they are."""
        if (generated.sample_ids >= 0).all():
            return generated.sample_ids
        cam_T_obj = at.cam_T_obj
        eye_obj, camera = eye_position(cam_T_obj), at.view.camera
        # Of the samples that turn this way only those near an edge point matter: rays are cast for these alone.
        rows = np.flatnonzero(facing(self._edges, eye_obj).shows)
        places = camera.project(transform(cam_T_obj, self._edges.points_obj[rows]))
        near = may_be_within(generated.points, places, _FAR_PX)
        rows, places = rows[near], places[near]
        seen = unoccluded(self._edges.take(rows), self._caster, eye_obj, self._offset_mm)
        rows, places = rows[seen], places[seen]
        nearest = nearest_within(places, generated.points, _FAR_PX)
        known = nearest >= 0
        found = np.full(len(generated), -1, np.int64)
        found[known] = rows[nearest[known]]
        return found

    def points_obj(self, samples: IntArray) -> FloatArray:
        """(n, 3) mm in the object frame of samples (n,), NaN for -1."""
        points_obj: FloatArray = self._points_obj.take(samples, axis=0)
        return points_obj

    def by_length_on_part(self, generated: GeneratedEdges, samples: IntArray, at: Estimate) -> GeneratedEdges:
        """The same edges, their weights times the length on the part of what a px shows; samples (n,) are theirs.

        Ridges stand a px apart in the image, so that an edge that runs towards the camera has few of them; CAD samples
        are spread evenly over the part. The factor is 1 / sin of the angle between edge and line of sight, at most 3:
        these weights are no longer beliefs in [0, 1]. CAD samples, which count by length on the part already, and edges
        without one near them stay as they are.
        """
        weighed = np.flatnonzero((samples >= 0) & (generated.sample_ids < 0))
        rays_obj = self._points_obj[samples[weighed]] - eye_position(at.cam_T_obj)
        tangents_obj = self._tangents_obj[samples[weighed]]
        along = np.einsum("nj,nj->n", rays_obj, tangents_obj) ** 2 / np.einsum("nj,nj->n", rays_obj, rays_obj)
        sines = np.sqrt(np.maximum(1.0 - along, 0.0))
        weights = np.array(generated.weights)
        weights[weighed] /= np.maximum(sines, 1.0 / _MOST_FORESHORTENED)
        return replace(generated, weights=weights)


def may_be_within(places: FloatArray, points: FloatArray, far_px: float) -> BoolArray:
    """(n,) whether points (n, 2) lie in a square of side far_px with one of places (m, 2), or in one beside it.

    So all that lie within far_px of a place are among them, and it takes far less time than `nearest_within`, which
    answers where places lie too far apart for a board of squares.
    """
    found = np.zeros(len(points), bool)
    rows, asked = (np.flatnonzero(np.isfinite(each).all(1)) for each in (places, points))
    if not len(rows):
        return found
    taken, squares = np.floor(places[rows] / far_px), np.floor(points[asked] / far_px)
    first = taken.min(0) - 1.0
    shape = taken.max(0) + 2.0 - first
    if np.abs(taken).max() > _FARTHEST_SQUARE or shape.prod() > _MOST_SQUARES:
        return nearest_within(places, points, far_px) >= 0
    board = np.zeros(shape.astype(np.int64), np.uint8)
    board[tuple((taken - first).T.astype(np.int64))] = 1
    board = cv2.dilate(board, np.ones((3, 3), np.uint8))
    inside = ((squares >= first) & (squares < first + shape)).all(1)
    found[asked[inside]] = board[tuple((squares[inside] - first).T.astype(np.int64))] > 0
    return found


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
