"""How much of the edges' motion a homography of the control points explains, in px (paper IV-C's assumption).

When a part moves, its edges off the plane of W do not follow the plane's homography. Here both motions are exact
ones of the same edge samples, measured along the edge's normal, the only part of a motion that an edge shows.
What is left unexplained is the error of every step that "moves the edges by H", however good the optimiser.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acp_lab.cad.edges import EdgeSamples
from acp_lab.cad.part import Part
from acp_lab.cad.raycast import RayCaster
from acp_lab.control_points.motion_pairs import stroke_ends, view_frame, visible_rows
from acp_lab.control_points.view_regions import ViewRegion, sample_directions
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.homography import apply_homography, homography_from_points
from acp_lab.geometry.pose import disturb_pose, transform


@dataclass(frozen=True)
class HomographyResidual:
    """Means over views and edge points, px of the given camera, along the edges' normals.

    Attributes:
        turn_deg, shift_mm: the motion, about a random axis and in a random direction for each view.
        moved_px: how far the edges move.
        unexplained_px: how far they are then from where the homography puts them.
    """

    turn_deg: float
    shift_mm: float
    moved_px: float
    unexplained_px: float

    @property
    def share(self) -> float:
        """unexplained_px / moved_px: 0 where the homography says it all, 1 where it says nothing."""
        return self.unexplained_px / self.moved_px

    def __str__(self) -> str:
        return (
            f"{self.turn_deg:g} deg, {self.shift_mm:g} mm: edges move {self.moved_px:.2f} px, "
            f"{self.unexplained_px:.2f} px of it unexplained ({100.0 * self.share:.0f}%)"
        )


def homography_residual(
    part: Part,
    edges: EdgeSamples,
    caster: RayCaster,
    region: ViewRegion,
    points_obj: np.ndarray,
    camera: Camera,
    distance_mm: float,
    turn_deg: float,
    shift_mm: float,
    views: int = 60,
    seed: int = 0,
) -> HomographyResidual:
    """The residual of control points W over the views of a region.

    Args:
        edges, caster: of this part.
        points_obj: (4, 3) W, mm.
        camera: whose px count; it looks at the box centre.
        distance_mm: from the eye to the box centre.
        turn_deg, shift_mm: the motion between two images, as of `disturb_pose`; one of them may be 0.

    Raises:
        GeometryError: the eye is inside the part, or W is seen edge-on.
    """
    moved, unexplained = [], []
    rng = np.random.default_rng([seed, region.index, 3])
    for direction in sample_directions(region, 0.5 * part.box_size, views, seed=seed):
        cam_T_obj = view_frame(part, region, direction, distance_mm, shift_mm, camera.width).canonical_T_obj
        moved_T_obj = disturb_pose(cam_T_obj, part.box_centre, turn_deg, shift_mm, rng)
        rows = visible_rows(part, edges, caster, cam_T_obj)
        here, there = (camera.project(transform(pose, edges.points_obj[rows])) for pose in (cam_T_obj, moved_T_obj))
        ends = stroke_ends(edges, rows, camera, moved_T_obj)
        along = ends[:, 1] - ends[:, 0]
        # A sample seen end-on is a dot without a direction.
        length = np.linalg.norm(along, axis=1)
        normals = np.stack([-along[:, 1], along[:, 0]], 1) / np.maximum(length, 1e-9)[:, None]
        image_points = [camera.project(transform(pose, points_obj)) for pose in (cam_T_obj, moved_T_obj)]
        predicted = apply_homography(homography_from_points(*image_points), here)
        moved.append(np.abs(((there - here) * normals).sum(1)))
        unexplained.append(np.abs(((there - predicted) * normals).sum(1)))
    return HomographyResidual(
        turn_deg, shift_mm, float(np.concatenate(moved).mean()), float(np.concatenate(unexplained).mean())
    )
