"""Edges of a rigid part: visible 3D edge samples at the pose of I, so that for any I they are those of a rigid part."""

from __future__ import annotations

import numpy as np

from acp_lab.cad.edges import facing
from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.generator.base import GeneratedEdges, RigidGenerator, VisibleSamples, project_samples
from acp_lab.geometry.pose_step import image_directions
from acp_lab.tracking.frame_view import DIFFERENCE_PX, View, pose_flow
from acp_lab.tracking.learning.contour_offsets import ContourOffsets


class RigidEdgeSource:
    """t(I) of a rigid generator, such as the visibility network."""

    def __init__(self, generator: RigidGenerator, offsets: ContourOffsets, count: int) -> None:
        self._generator = generator
        self._offsets = offsets
        self._count = count

    def generate(self, view: View, control_points: np.ndarray) -> GeneratedEdges:
        """The edges of I (4, 2) px."""
        pose = view.pose(control_points)
        return project_with_offsets(self._offsets, self._generator.visible(pose, view.region, self._count), view, pose)

    def settled(
        self, view: View, control_points: np.ndarray, cam_T_obj: np.ndarray, edges: GeneratedEdges
    ) -> GeneratedEdges:
        """The same samples at the pose (4, 4)."""
        return project_again(self._offsets, edges, view, cam_T_obj)

    def flow(self, view: View, control_points: np.ndarray, edges: GeneratedEdges, by_differences: bool) -> np.ndarray:
        """(n, 2, 8), see `rigid_flow`."""
        return rigid_flow(view, control_points, self._offsets.edges.points_obj[edges.sample_ids], by_differences)


def project_with_offsets(
    offsets: ContourOffsets, visible: VisibleSamples, view: View, cam_T_obj: np.ndarray
) -> GeneratedEdges:
    """Visible samples at a pose, outlines where the broken edges of the real part show them (not in the paper)."""
    drawn = project_samples(offsets.edges, visible, cam_T_obj, view.camera)
    points_cam = offsets.edges.points_obj[visible.ids] @ cam_T_obj[:3, :3].T + cam_T_obj[:3, 3]
    directions = image_directions(points_cam, drawn.normals, view.camera)
    expected = offsets.expect(visible.ids, visible.outline, directions @ cam_T_obj[:3, :3])
    points = drawn.points + expected.offsets_px[:, None] * drawn.normals
    return GeneratedEdges(points, drawn.tangents, drawn.weights, drawn.sample_ids)


def project_again(offsets: ContourOffsets, edges: GeneratedEdges, view: View, cam_T_obj: np.ndarray) -> GeneratedEdges:
    """Edge points of known samples moved to another pose (4, 4), with their weights as they were."""
    outline = facing(offsets.edges, eye_position(cam_T_obj)).outline[edges.sample_ids]
    return project_with_offsets(offsets, VisibleSamples(edges.sample_ids, outline, edges.weights), view, cam_T_obj)


def rigid_flow(view: View, control_points: np.ndarray, points_obj: np.ndarray, by_differences: bool) -> np.ndarray:
    """(n, 2, 8) how projections of points_obj (n, 3) mm follow I (4, 2) px through PnP.

    By the pose that follows I in the least-squares sense, or by differences of PnP itself.
    """
    if not by_differences:
        pose = view.pose(control_points)
        # Two of the eight directions are no rigid motion; the pseudo-inverse gives the rigid motion next to them.
        return pose_flow(view, pose, points_obj) @ np.linalg.pinv(view.control_jacobian(pose))
    flow = np.empty((len(points_obj), 2, 8))
    for k, nudge in enumerate(np.eye(8).reshape(8, 4, 2) * DIFFERENCE_PX):
        there, back = (view.pose(control_points + sign * nudge) for sign in (1.0, -1.0))
        ahead, behind = (view.camera.project(points_obj @ p[:3, :3].T + p[:3, 3]) for p in (there, back))
        flow[:, :, k] = (ahead - behind) / (2.0 * DIFFERENCE_PX)
    return flow
