"""Which pose a painting shows, of views whose true edges are known.

One network paints all lines of a view, so its errors go together, and what part of them looks like another pose no
tracker can undo (`studies.painting_bias` tells more, on the frames of a sequence). Here it is measured where a
generator is judged: on held-out views, in their canonical cameras.

Convention: canonical px; mm.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from acp_lab.cad.part import Part
from acp_lab.generator.painted.edge_images import EdgeView
from acp_lab.generator.painted.edge_points import RidgePoints
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import transform
from acp_lab.geometry.pose_step import centre_position, image_directions, move_pose, step_jacobian

# A painted point further than this from every true edge is an invention, and says nothing of a pose.
FAR_PX = 3.0
SCALE_PX = 1.0
_PARALLEL = float(np.cos(np.radians(20.0)))
_FITS = 8
_LEAST_POINTS = 12


def pose_bias(painted: RidgePoints, view: EdgeView, part: Part) -> float:
    """ADD between a view's pose and the pose that painted ridges show, as a share of the diameter.

    To first order: the pose step whose motion of the true edges fits best how far the ridges are off them, robustly.
    NaN where too few ridges lie near true edges.
    """
    first, last = view.strokes.transpose(1, 0, 2)
    along = last - first
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    gaps, nearest = _gaps(painted.points, 0.5 * (first + last))
    normals = painted.normals
    off_px = np.einsum("nj,nj->n", gaps, normals)
    near = (np.abs(off_px) < FAR_PX) & (np.linalg.norm(gaps, axis=1) < 2.0 * FAR_PX)
    near &= np.abs(np.einsum("nj,nj->n", painted.tangents, along[nearest])) > _PARALLEL
    if near.sum() < _LEAST_POINTS:
        return float("nan")
    frame = view.frame
    middle = 0.5 * (frame.size - 1)
    camera = Camera(frame.size, frame.size, frame.focal_px, frame.focal_px, middle, middle)
    points_cam = transform(frame.canonical_T_obj, view.points_obj[nearest[near]])
    centre_cam = centre_position(frame.canonical_T_obj, part.box_centre)
    jacobian = step_jacobian(points_cam, image_directions(points_cam, normals[near], camera), centre_cam)
    shown = move_pose(frame.canonical_T_obj, part.box_centre, _robust_step(jacobian, off_px[near]))
    moved = transform(shown, part.vertices) - transform(frame.canonical_T_obj, part.vertices)
    return float(np.linalg.norm(moved, axis=1).mean()) / part.diameter


def _gaps(points: FloatArray, lines: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(n, 2) from the nearest of the points along lines to each point, and (n,) which that is."""
    if len(points) == 0 or len(lines) == 0:
        return np.full((len(points), 2), np.inf), np.zeros(len(points), np.intp)
    nearest = cKDTree(lines).query(points)[1]
    return points - lines[nearest], nearest


def _robust_step(jacobian: FloatArray, off_px: FloatArray) -> FloatArray:
    """(6,) rad and mm; Geman-McClure, as a tracker's loss is, by the square root of its weights."""
    step: FloatArray = np.zeros(6)
    for _ in range(_FITS):
        weights = 1.0 / (1.0 + ((off_px - jacobian @ step) / SCALE_PX) ** 2)
        solved = np.linalg.lstsq(weights[:, None] * jacobian, weights * off_px, rcond=None)[0]
        step = np.asarray(solved, np.float64)
    return step
