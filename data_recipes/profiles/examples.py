"""What the network learns from: candidates beside the true edges of a scene's views, and how far off these are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from acp_lab.cad.edges import facing, sample_edges, visible_samples
from acp_lab.cad.part import Part
from acp_lab.cad.raycast import make_caster
from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.generator.base import VisibleSamples, project_samples
from acp_lab.geometry.arrays import BoolArray, Float32Array, FloatArray, IntArray
from acp_lab.geometry.pose import transform
from acp_lab.geometry.pose_step import image_directions, step_jacobian
from acp_lab.imaging.edge_search import AS_THEY_ARE, image_patch, search_along_normals
from acp_lab.tracking.learning.edge_profiles import FEATURES, EdgeViews, describe
from data_recipes.profiles.stills import Stills, read_stills

# As the tracker's last level searches and what it takes for noise.
_REACH_PX, _LEAST_SCORE = 6, 0.02
# The network that comes with the package has learnt from pictures that are not sharpened. With one that has learnt from
# sharpened ones parts are tracked no better.
_SEARCH = AS_THEY_ARE
_ANY_PX = 1e6
# A candidate farther off is another edge.
_FARTHEST_PX = 2.5
# Of an edge's candidates the one counts whose score times nearness is highest, as in the tracker's last level.
_BEST_SIGMA_PX = 1.0
_MOST_SAMPLES, _LEAST_SAMPLES = 700, 50
_LEAST_VISIBLE = 0.35
_BORDER_PX, _ROOM_PX = 8, 20
# Where no edge is smeared by as much, nothing is averaged, and a view is shown once.
_SMEARED_PX = 2.0
_RAY_OFFSET_IN_DIAMETERS = 0.002


@dataclass(frozen=True, eq=False)
class Examples:
    """k candidates of one scene.

    Attributes:
        features: (k, FEATURES) float32, see `edge_profiles.describe`.
        shifts_px: (k,) float32 across the edge from the candidate to the CAD's edge.
        jacobian: (k, 6) float32 motion across the edge by a pose step (rad, mm) about the middle of the part's box.
        views: (k,) which view of the scene each is of.
        best: (k,) bool, of each edge the candidate that fits best.
    """

    features: Float32Array
    shifts_px: Float32Array
    jacobian: Float32Array
    views: IntArray
    best: BoolArray

    def __len__(self) -> int:
        return len(self.shifts_px)


def examples_of(stills: Stills) -> Examples:
    """Of all views of a scene that show enough of the part."""
    part = Part.from_mesh(stills.part.vertices, stills.part.faces, stills.part.name)
    edges, caster, camera = sample_edges(part), make_caster(part), stills.camera
    offset_mm = _RAY_OFFSET_IN_DIAMETERS * part.diameter
    found_in_views = list[Examples]()
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
        patch = image_patch(image, (left, top, int(right), int(bottom)), _SEARCH)
        seen_as = EdgeViews(edges, found.sample_ids, found.outline, pose, camera.fx, part.times_usual)
        points_cam, centre_cam = transform(pose, edges.points_obj[found.sample_ids]), transform(pose, part.box_centre)
        directions = image_directions(points_cam, found.normals, camera)
        jacobian = step_jacobian(points_cam, directions, centre_cam)
        blur_px = np.abs(jacobian @ motion)
        # As where the motion is known, and as where it is not, such as in a first frame.
        for told_px in (blur_px, np.zeros(len(found))) if blur_px.max() >= _SMEARED_PX else (blur_px,):
            candidates = search_along_normals(patch, found.points, found.normals, _REACH_PX, _SEARCH, told_px)
            profiles = describe(
                patch, found.points, found.normals, candidates, seen_as, _ANY_PX, _LEAST_SCORE, told_px
            )
            rows, sides = profiles.rows, profiles.sides[profiles.rows]
            offsets = candidates.offsets[rows, profiles.columns] * sides
            fits = candidates.scores[rows, profiles.columns] * np.exp(-0.5 * (offsets / _BEST_SIGMA_PX) ** 2)
            near = np.abs(offsets) < _FARTHEST_PX
            found_in_views.append(
                Examples(
                    profiles.features[near],
                    -offsets[near].astype(np.float32),
                    (jacobian[rows] * sides[:, None])[near].astype(np.float32),
                    np.full(np.count_nonzero(near), len(found_in_views)),
                    _is_best(rows, fits)[near],
                )
            )
    return _together(found_in_views)


def _together(examples: Sequence[Examples]) -> Examples:
    """All of several."""
    nothing = Examples(
        np.zeros((0, FEATURES), np.float32), np.zeros(0, np.float32), np.zeros((0, 6), np.float32),
        np.zeros(0, np.intp), np.zeros(0, bool),
    )  # fmt: skip
    parts = [[getattr(one, field.name) for one in (nothing, *examples)] for field in fields(Examples)]
    return Examples(*(np.concatenate(arrays) for arrays in parts))


def _is_best(rows: IntArray, fits: FloatArray) -> BoolArray:
    """(k,) of candidates of edges `rows` (k,), which of each edge's fits best."""
    order = np.lexsort((-fits, rows))
    best = np.zeros(len(rows), bool)
    best[order[np.diff(rows[order], prepend=-1) != 0]] = True
    return best


def read_examples(path: Path) -> Examples:
    """Of the scene in a file; see `stills.read_stills`."""
    return examples_of(read_stills(path))
