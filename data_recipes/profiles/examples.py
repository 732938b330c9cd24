"""What the network learns from: candidates beside the true edges of a scene's views, and how far off these are."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from acp_lab.cad.edges import facing, sample_edges, visible_samples
from acp_lab.cad.part import Part
from acp_lab.cad.raycast import make_caster
from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.generator.base import VisibleSamples, project_samples
from acp_lab.geometry.arrays import Float32Array
from acp_lab.geometry.pose import transform
from acp_lab.geometry.pose_step import image_directions, step_jacobian
from acp_lab.imaging.edge_search import SearchConfig, image_patch, search_along_normals
from acp_lab.tracking.learning.edge_profiles import FEATURES, EdgeViews, describe
from data_recipes.profiles.stills import Stills, read_stills

# As the tracker's last level searches and what it takes for noise.
_REACH_PX, _LEAST_SCORE = 6, 0.02
_ANY_PX = 1e6
# A candidate farther off is another edge.
_FARTHEST_PX = 2.5
_MOST_SAMPLES, _LEAST_SAMPLES = 700, 50
_LEAST_VISIBLE = 0.35
_BORDER_PX, _ROOM_PX = 8, 20
# Where no edge is smeared by as much, nothing is averaged, and a view is shown once.
_SMEARED_PX = 2.0
_RAY_OFFSET_IN_DIAMETERS = 0.002


@dataclass(frozen=True, eq=False)
class Examples:
    """k candidates.

    Attributes:
        features: (k, FEATURES) float32, see `edge_profiles.describe`.
        shifts_px: (k,) float32 across the edge from the candidate to the CAD's edge.
    """

    features: Float32Array
    shifts_px: Float32Array

    def __len__(self) -> int:
        return len(self.shifts_px)


def examples_of(stills: Stills) -> Examples:
    """Of all views of a scene that show enough of the part."""
    part = Part.from_mesh(stills.part.vertices, stills.part.faces, stills.part.name)
    edges, caster, camera = sample_edges(part), make_caster(part), stills.camera
    offset_mm = _RAY_OFFSET_IN_DIAMETERS * part.diameter
    features, shifts = [], []
    views = zip(stills.images, stills.cam_T_obj, stills.motions, stills.visible, strict=True)
    for image, pose, motion, visible in views:
        if visible < _LEAST_VISIBLE:
            continue
        eye_obj = eye_position(pose)
        ids = np.flatnonzero(visible_samples(edges, caster, eye_obj, offset_mm))[:_MOST_SAMPLES]
        seen = VisibleSamples(ids, facing(edges, eye_obj).outline[ids], np.ones(len(ids)))
        found = project_samples(edges, seen, pose, camera)
        last = np.array([camera.width, camera.height]) - 1 - _BORDER_PX
        inside = (found.points > _BORDER_PX) & (found.points < last)
        found = found.take(np.flatnonzero(inside.all(1)))
        if len(found) < _LEAST_SAMPLES:
            continue
        (left, top), (right, bottom) = (found.points.min(0) - _ROOM_PX).astype(int), found.points.max(0) + _ROOM_PX
        search = SearchConfig()
        patch = image_patch(image, (left, top, int(right), int(bottom)), search.blur_px, search.gamma)
        seen_as = EdgeViews(edges, found.sample_ids, found.outline, pose, camera.fx)
        points_cam, centre_cam = transform(pose, edges.points_obj[found.sample_ids]), transform(pose, part.box_centre)
        directions = image_directions(points_cam, found.normals, camera)
        blur_px = np.abs(step_jacobian(points_cam, directions, centre_cam) @ motion)
        # As where the motion is known, and as where it is not, such as in a first frame.
        for told_px in (blur_px, np.zeros(len(found))) if blur_px.max() >= _SMEARED_PX else (blur_px,):
            candidates = search_along_normals(patch, found.points, found.normals, _REACH_PX, search, told_px)
            profiles = describe(
                patch, found.points, found.normals, candidates, seen_as, _ANY_PX, _LEAST_SCORE, told_px
            )
            offsets = candidates.offsets[profiles.rows, profiles.columns] * profiles.sides[profiles.rows]
            near = np.abs(offsets) < _FARTHEST_PX
            features.append(profiles.features[near])
            shifts.append(-offsets[near].astype(np.float32))
    nothing = np.zeros((0, FEATURES), np.float32), np.zeros(0, np.float32)
    return Examples(np.concatenate([nothing[0], *features]), np.concatenate([nothing[1], *shifts]))


def read_examples(path: Path) -> Examples:
    """Of the scene in a file; see `stills.read_stills`."""
    return examples_of(read_stills(path))
