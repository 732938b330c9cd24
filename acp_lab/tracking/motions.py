"""How the edges of one level move with the variables: three directions for control points, one for a pose.

    HomographyMotion    generated once, moved by the homography that moves the control points (paper III and IV-C)
    RegeneratedMotion   generated anew at every I; the derivative comes through the generator or by differences
    RigidMotion         generated once, lifted to 3D, moved as a rigid part: what a 6DoF optimiser does ("w/o CP")

A motion knows nothing of images or losses. Its variables are an array: I (4, 2) px or a pose (4, 4).
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from acp_lab.generator.base import GeneratedEdges
from acp_lab.geometry.homography import QuadWarp, WarpedPoints
from acp_lab.geometry.pose_step import move_pose
from acp_lab.tracking.frame_view import EdgeSource, View, pose_flow


class Motion(Protocol):
    """Edge points as a function of the variables."""

    def edges(self, variables: np.ndarray) -> GeneratedEdges:
        """The edge points at some variables."""
        ...

    def linearised(self, variables: np.ndarray) -> tuple[GeneratedEdges, np.ndarray]:
        """The edge points at some variables, and (n, 2, k) how they move by a step of the k variables."""
        ...

    def moved(self, variables: np.ndarray, step: np.ndarray) -> np.ndarray:
        """The variables after a step (k,)."""
        ...


class _ControlPointMotion:
    """Variables I (4, 2): a step is added."""

    def moved(self, variables: np.ndarray, step: np.ndarray) -> np.ndarray:
        """I after a step (8,) px."""
        return variables + step.reshape(4, 2)


class HomographyMotion(_ControlPointMotion):
    """x' = H x with H from the four control points (eqs 8 and 9), analytic in all eight coordinates."""

    def __init__(self, edges: GeneratedEdges, control_points: np.ndarray) -> None:
        self._edges = edges
        self._warp = QuadWarp(control_points, edges.points)

    def edges(self, variables: np.ndarray) -> GeneratedEdges:
        """The edges moved by the homography; GeometryError where I is degenerate."""
        return self._moved(self._warp.to(variables))

    def linearised(self, variables: np.ndarray) -> tuple[GeneratedEdges, np.ndarray]:
        """The same, and (n, 2, 8)."""
        warped = self._warp.to(variables)
        return self._moved(warped), warped.jacobian()

    def _moved(self, warped: WarpedPoints) -> GeneratedEdges:
        start = self._edges
        return GeneratedEdges(warped.points, warped.tangents(start.tangents), start.weights, start.sample_ids)


class RegeneratedMotion(_ControlPointMotion):
    """t(I) itself, generated at every I."""

    def __init__(self, source: EdgeSource, view: View, by_differences: bool) -> None:
        self._source = source
        self._view = view
        self._by_differences = by_differences

    def edges(self, variables: np.ndarray) -> GeneratedEdges:
        """t(I); GeometryError where I is degenerate."""
        return self._source.generate(self._view, variables)

    def linearised(self, variables: np.ndarray) -> tuple[GeneratedEdges, np.ndarray]:
        """The same, and (n, 2, 8)."""
        edges = self.edges(variables)
        return edges, self._source.flow(self._view, variables, edges, self._by_differences)


class RigidMotion:
    """Edge points with their 3D points (n, 3) mm, NaN for those to leave out, moved by a pose (4, 4)."""

    def __init__(self, edges: GeneratedEdges, points_obj: np.ndarray, view: View, cam_T_obj: np.ndarray) -> None:
        known = np.isfinite(points_obj).all(1)
        self._edges = GeneratedEdges(
            edges.points[known], edges.tangents[known], edges.weights[known], edges.sample_ids[known]
        )
        self._points_obj = points_obj[known]
        self._view = view
        # Lifting puts points on the nearest CAD edge; what it moved them by stays with them as a constant.
        self._lift_px = self._edges.points - self._project(cam_T_obj)

    def edges(self, variables: np.ndarray) -> GeneratedEdges:
        """The edges at a pose; directions are kept, a level turns them little."""
        points = self._project(variables) + self._lift_px
        return GeneratedEdges(points, self._edges.tangents, self._edges.weights, self._edges.sample_ids)

    def linearised(self, variables: np.ndarray) -> tuple[GeneratedEdges, np.ndarray]:
        """The same, and (n, 2, 6) by rotation (rad) and shift (mm), camera axes."""
        return self.edges(variables), pose_flow(self._view, variables, self._points_obj)

    def moved(self, variables: np.ndarray, step: np.ndarray) -> np.ndarray:
        """The pose after a step (6,)."""
        return move_pose(variables, self._view.centre_obj, step)

    def _project(self, cam_T_obj: np.ndarray) -> np.ndarray:
        return self._view.camera.project(self._points_obj @ cam_T_obj[:3, :3].T + cam_T_obj[:3, 3])
