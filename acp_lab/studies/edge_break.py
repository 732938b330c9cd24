"""How far image edges lie from the CAD model's edges, in millimetres: the effect of broken edges.

Machined edges are broken by some tenths of a millimetre, so the outline of a real part lies *inside* its
model's. Measured at the true pose, edge point by edge point, with the strongest image edge along the normal; and what
is left of it when the profiles of these edges tell where the CAD's would be (`tracking.learning.edge_profiles`), with
what the edges have in common as the frames tell it (`tracking.learning.edge_traits`).

Convention: mm at the depth of the point; outward, away from the part's own material, counts as positive.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from acp_lab.cad.edges import facing
from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.errors import SequenceError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import transform
from acp_lab.geometry.pose_step import image_directions, step_jacobian
from acp_lab.imaging.edge_search import SearchConfig, image_patch, search_along_normals
from acp_lab.sequences.bop import BopScene
from acp_lab.sequences.frame import Frame
from acp_lab.studies.true_edges import TrueEdges
from acp_lab.tracking.learning.edge_profiles import EdgeProfiles, EdgeViews, ProfileConfig
from acp_lab.tracking.learning.edge_traits import TraitEvidence

REACH_PX = 3
LEAST_SCORE = 0.4


@dataclass(frozen=True, eq=False)
class EdgeOffsets:
    """Offsets of all frames together. Prints as two lines.

    Attributes:
        outline_mm: (n,) of samples on the part's outlines.
        inner_mm: (m,) of convex creases with both faces in view.
    """

    outline_mm: FloatArray
    inner_mm: FloatArray

    def __str__(self) -> str:
        lines = []
        for name, offsets_mm in (("outlines", self.outline_mm), ("creases inside", self.inner_mm)):
            low, middle, high = np.quantile(offsets_mm, [0.25, 0.5, 0.75])
            lines.append(f"{name}: median {middle:+.2f} mm, half of them from {low:+.2f} to {high:+.2f} mm")
        return "\n".join(lines)


def edge_offsets(truth: TrueEdges, scene: BopScene, object_id: int, frame_ids: Sequence[int]) -> EdgeOffsets:
    """Measure the offsets in frames that can be read and have truth; SequenceError when none has an edge."""
    return _measured(truth, scene, object_id, frame_ids, None)


def offsets_beside_profiles(
    truth: TrueEdges, scene: BopScene, object_id: int, frame_ids: Sequence[int], config: ProfileConfig | None = None
) -> EdgeOffsets:
    """The same of where the profiles of these image edges say that the CAD's edges are; arguments as before.

    As a tracker would, frame by frame: the poses are left out when the frames are asked what the edges have in common.
    """
    return _measured(truth, scene, object_id, frame_ids, EdgeProfiles(config or ProfileConfig()))


def _measured(
    truth: TrueEdges, scene: BopScene, object_id: int, frame_ids: Sequence[int], profiles: EdgeProfiles | None
) -> EdgeOffsets:
    outlines, inner = [], []
    for frame_id in frame_ids:
        frame, pose = scene.frame(frame_id), scene.truth(frame_id, object_id)
        if pose is not None and isinstance(frame, Frame):
            of_outline, of_crease = _in_frame(truth, frame, pose, profiles)
            outlines.append(of_outline)
            inner.append(of_crease)
    if not outlines or not sum(map(len, outlines)) or not sum(map(len, inner)):
        raise SequenceError(f"{scene.name}: no image edge near the part's in these frames: choose others")
    return EdgeOffsets(np.concatenate(outlines), np.concatenate(inner))


def _in_frame(
    truth: TrueEdges, frame: Frame, pose: FloatArray, profiles: EdgeProfiles | None
) -> tuple[FloatArray, FloatArray]:
    rows = truth.rows(pose)
    at = truth.project(rows, pose, frame.camera)
    height, width = frame.image.shape[:2]
    patch = image_patch(frame.image, (0, 0, width, height))
    candidates = search_along_normals(patch, at.points, at.normals, REACH_PX, SearchConfig())
    best = candidates.scores.argmax(1)[:, None]
    outline = facing(truth.edges, eye_position(pose)).outline[rows]
    offsets = candidates.offsets
    if profiles is not None:
        views = EdgeViews(truth.edges, rows, outline, pose, frame.camera.fx, truth.part.times_usual)
        told = profiles.read(patch, at.points, at.normals, candidates, views, REACH_PX, 0.0)
        points_cam = transform(pose, truth.edges.points_obj[rows])
        centre_cam = transform(pose, truth.part.box_centre)
        jacobian = step_jacobian(points_cam, image_directions(points_cam, at.normals, frame.camera), centre_cam)
        chosen = np.arange(len(rows)), best[:, 0]
        residuals_px = np.where(candidates.scores[chosen] > LEAST_SCORE, (offsets + told.shifts_px)[chosen], np.nan)
        slopes_px, spreads_px = told.slopes_px[chosen], told.spreads_px[chosen]
        profiles.traits.learn(
            TraitEvidence(residuals_px, slopes_px, spreads_px, jacobian, float(centre_cam[2]), told.told_with)
        )
        told = profiles.read(patch, at.points, at.normals, candidates, views, REACH_PX, 0.0)
        offsets = offsets + told.shifts_px
    offset_px = np.take_along_axis(offsets, best, 1)[:, 0]
    found = np.take_along_axis(candidates.scores, best, 1)[:, 0] > LEAST_SCORE
    # Out of the material is where the sum of both face normals points.
    outward_cam = truth.edges.off_obj[rows] @ pose[:3, :3].T
    side = np.sign((at.normals * outward_cam[:, :2]).sum(1))
    depth_mm = transform(pose, truth.edges.points_obj[rows])[:, 2]
    offset_mm = side * offset_px * depth_mm / frame.camera.fx
    return offset_mm[found & outline], offset_mm[found & ~outline & truth.edges.convex[rows]]
