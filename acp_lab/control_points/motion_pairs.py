"""Pairs of views before and after a small motion: the data of control point regression (paper IV-C, steps 1 and 2).

Each pair has one virtual camera, a canonical frame whose image holds the part before and after the motion. The
edges before are points, because they will be moved by a homography; the edges after are a distance map,
because their distance to the moved points is what counts.

Deviations from the paper: views are spread evenly over the region's area (the paper's steps of latitude and
longitude crowd at the poles), their distances evenly in 1/distance (the paper names none), and the camera's
roll is that of the canonical frame; e_3d does not depend on roll. Edges are the CAD's own visible samples, so
nothing is rendered.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from acp_lab.cad.edges import EdgeSamples, visible_samples
from acp_lab.cad.part import Part
from acp_lab.cad.raycast import RayCaster
from acp_lab.control_points.canonical_frame import CanonicalFrame, canonical_frame
from acp_lab.control_points.view_regions import ViewRegion, sample_directions
from acp_lab.errors import GeometryError
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import disturb_pose, transform
from acp_lab.imaging.distance import distance_map

Progress = Callable[[int, int], None]

RAY_OFFSET_IN_DIAMETERS = 0.002
LARGEST_SHIFT_IN_DIAMETERS = 0.1
_FRACTION_BITS = 4


@dataclass(frozen=True)
class PairConfig:
    """Which views are taken, and which motion.

    Attributes:
        views: motion pairs in all.
        turn_deg, shift_mm: the motion between the two views of a pair, both at once, as we read the paper's 0.5 degrees
            and 5 mm.
            Parts that are larger than usual, see `cad.part.USUAL_DIAMETERS`, shift by more in proportion, and small
            ones by no more than a tenth of their diameter. (Deviation from the paper, which does not say for parts of
            which size its 5 mm are.)
        overlap: share by which the views reach into the neighbouring regions.
        nearest, farthest: distances of the eye in diameters.
        size: side of the square virtual image in px; the part nearly fills it.
        points: at most so many edge points of a view are moved; they are spread evenly along its edges.
    """

    views: int = 96
    turn_deg: float = 0.5
    shift_mm: float = 5.0
    overlap: float = 0.15
    nearest: float = 2.0
    farthest: float = 12.0
    size: int = 512
    points: int = 400


@dataclass(frozen=True)
class MotionPairs:
    """Motion pairs of one region; v views, m edge points over all of them.

    Attributes:
        camera_matrices: (v, 3, 3) K of the virtual cameras, px.
        before_T_obj, after_T_obj: (v, 4, 4) object to virtual camera before and after the motion, mm.
        points: (m, 2) px, edge points before the motion (E_i of the paper).
        points_after: (m, 2) px, the same points of the part after it; the regression does not know them.
        view_of_point: (m,) row of the view that each point belongs to.
        distances: (v, size, size) float32 px, distance maps of the edges after the motion.
    """

    camera_matrices: np.ndarray
    before_T_obj: np.ndarray
    after_T_obj: np.ndarray
    points: np.ndarray
    points_after: np.ndarray
    view_of_point: np.ndarray
    distances: np.ndarray

    def __len__(self) -> int:
        return len(self.camera_matrices)


def make_motion_pairs(
    part: Part,
    edges: EdgeSamples,
    caster: RayCaster,
    region: ViewRegion,
    config: PairConfig,
    seed: int,
    progress: Progress | None = None,
) -> MotionPairs:
    """Sample views of a region and a random motion for each.

    Args:
        edges, caster: of this part.
        progress: called with (pairs done, pairs in all).

    Raises:
        GeometryError: nearest, farthest or size leave no room for the part and its motion.
    """
    if not (config.farthest >= config.nearest >= 1.0 and config.size >= 32):
        raise GeometryError(
            f"motion pairs at {config.nearest:g} to {config.farthest:g} diameters, {config.size} px: keep the eye "
            "a diameter or more away, and the image at 32 px or more"
        )
    shift_mm = min(max(part.times_usual, 1.0) * config.shift_mm, LARGEST_SHIFT_IN_DIAMETERS * part.diameter)
    matrices, before, after, points, points_after, distances = [], [], [], [], [], []
    rng = np.random.default_rng([seed, region.index, 2])
    directions = sample_directions(region, 0.5 * part.box_size, config.views, config.overlap, seed)
    nearness = rng.uniform(1.0 / config.farthest, 1.0 / config.nearest, config.views)
    for row, (direction, near) in enumerate(zip(directions, nearness, strict=True)):
        frame = view_frame(part, region, direction, part.diameter / near, shift_mm, config.size)
        cam_T_obj = frame.canonical_T_obj
        moved_T_obj = disturb_pose(cam_T_obj, part.box_centre, config.turn_deg, shift_mm, rng)
        seen = visible_rows(part, edges, caster, cam_T_obj)[: config.points]
        seen_after = visible_rows(part, edges, caster, moved_T_obj)
        camera = Camera.from_matrix(frame.matrix, frame.size, frame.size)
        matrices.append(frame.matrix)
        before.append(cam_T_obj)
        after.append(moved_T_obj)
        points.append(camera.project(transform(cam_T_obj, edges.points_obj[seen])))
        points_after.append(camera.project(transform(moved_T_obj, edges.points_obj[seen])))
        distances.append(distance_map(draw_samples(edges, seen_after, camera, moved_T_obj)))
        if progress is not None:
            progress(row + 1, config.views)
    return MotionPairs(
        np.stack(matrices),
        np.stack(before),
        np.stack(after),
        np.concatenate(points),
        np.concatenate(points_after),
        np.repeat(np.arange(config.views), [len(p) for p in points]),
        np.stack(distances),
    )


def view_frame(
    part: Part, region: ViewRegion, direction_obj: np.ndarray, distance_mm: float, shift_mm: float, size: int
) -> CanonicalFrame:
    """The virtual camera of a pair: a canonical frame that still holds the part when it is shifted by `shift_mm`."""
    eye_obj = part.box_centre + distance_mm * direction_obj
    return canonical_frame(eye_obj, part.box_centre, part.radius + shift_mm, region, size)


def visible_rows(part: Part, edges: EdgeSamples, caster: RayCaster, cam_T_obj: np.ndarray) -> np.ndarray:
    """(k,) rows of the edge samples that are seen at a pose (4, 4), in their stable, evenly spread order."""
    eye_obj = -cam_T_obj[:3, :3].T @ cam_T_obj[:3, 3]
    return np.flatnonzero(visible_samples(edges, caster, eye_obj, RAY_OFFSET_IN_DIAMETERS * part.diameter))


def draw_samples(edges: EdgeSamples, rows: np.ndarray, camera: Camera, cam_T_obj: np.ndarray) -> np.ndarray:
    """The edge image of the samples `rows` at a pose: (h, w) bool, one px wide strokes from sample to sample."""
    strokes = np.round(stroke_ends(edges, rows, camera, cam_T_obj) * (1 << _FRACTION_BITS))
    canvas = np.zeros((camera.height, camera.width), np.uint8)
    # cv2 takes fixed-point coordinates; the fractional bits keep a stroke's slope and place.
    cv2.polylines(canvas, list(strokes.astype(np.int32)), False, 255, shift=_FRACTION_BITS)
    return canvas > 0


def stroke_ends(edges: EdgeSamples, rows: np.ndarray, camera: Camera, cam_T_obj: np.ndarray) -> np.ndarray:
    """(k, 2, 2) px: both ends of the piece of edge that each of the samples `rows` (k,) stands for."""
    half = 0.55 * edges.spacing_mm * edges.tangents_obj[rows]
    middles = edges.points_obj[rows]
    return np.stack([camera.project(transform(cam_T_obj, middles + step)) for step in (-half, half)], axis=1)
