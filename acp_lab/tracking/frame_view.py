"""t(I) inside one frame: from eight image coordinates to edge points, and how these move when I moves.

The sources: `rigid_source` for generators that choose among the part's 3D edge samples, `painted_source` for the
auto-encoder, which paints an edge image. `flow` answers how edge points follow I when edges are generated anew:
through the network (autograd) or by differences.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from acp_lab.control_points.canonical_frame import CanonicalFrame
from acp_lab.generator.base import GeneratedEdges
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.planar_pnp import solve_planar_pnp
from acp_lab.geometry.pose_step import centre_position, control_point_jacobian, image_directions, step_jacobian

# For derivatives by differences: far from rounding, and the edges are nearly straight over it.
DIFFERENCE_PX = 0.25


@dataclass(frozen=True)
class View:
    """What stays fixed while one frame is solved.

    Attributes:
        camera: of the frame.
        prior: (4, 4) cam_T_obj predicted for the frame.
        region: 0..5; points_obj: (4, 3) its W, mm.
        centre_obj: (3,) mm, the part's centre.
        canonical: the canonical frame of the prior; image_H_canonical: (3, 3) from it to the image.
    """

    camera: Camera
    prior: np.ndarray
    region: int
    points_obj: np.ndarray
    centre_obj: np.ndarray
    canonical: CanonicalFrame
    image_H_canonical: np.ndarray

    def pose(self, control_points: np.ndarray) -> np.ndarray:
        """(4, 4) cam_T_obj by PnP of I (4, 2), of its two solutions the one nearer to the prior (paper IV-B).

        Raises GeometryError where I is degenerate, unless it is that of the prior.
        """
        if np.array_equal(control_points, self.prior_points):
            return self.prior  # where most frames start; PnP would say the same
        return solve_planar_pnp(self.points_obj, control_points, self.camera).nearest(self.prior)

    @cached_property
    def canonical_H_image(self) -> np.ndarray:
        """(3, 3) from the image to the canonical frame."""
        return np.linalg.inv(self.image_H_canonical)

    @cached_property
    def prior_points(self) -> np.ndarray:
        """(4, 2) px: I of the prior."""
        return self.project(self.prior)

    def project(self, cam_T_obj: np.ndarray) -> np.ndarray:
        """(4, 2) px: I of a pose (4, 4)."""
        return self.camera.project(self.points_obj @ cam_T_obj[:3, :3].T + cam_T_obj[:3, 3])

    def control_jacobian(self, cam_T_obj: np.ndarray) -> np.ndarray:
        """(8, 6) derivative of I by a pose step about the part's centre."""
        points_cam = self.points_obj @ cam_T_obj[:3, :3].T + cam_T_obj[:3, 3]
        return control_point_jacobian(points_cam, centre_position(cam_T_obj, self.centre_obj), self.camera)


class EdgeSource(Protocol):
    """t(I) in one frame."""

    def generate(self, view: View, control_points: np.ndarray) -> GeneratedEdges:
        """The edges of I (4, 2) px."""
        ...

    def settled(
        self, view: View, control_points: np.ndarray, cam_T_obj: np.ndarray, edges: GeneratedEdges
    ) -> GeneratedEdges:
        """The edges of I (4, 2) px with its pose (4, 4), given the `edges` of an I nearby.

        Sources that know which samples these show only move them: which ones show changes more slowly.
        """
        ...

    def flow(self, view: View, control_points: np.ndarray, edges: GeneratedEdges, by_differences: bool) -> np.ndarray:
        """(n, 2, 8) how the edge points that `generate` gave for I move by I, when edges are generated anew."""
        ...


def pose_flow(view: View, cam_T_obj: np.ndarray, points_obj: np.ndarray) -> np.ndarray:
    """(n, 2, 6) how the projections of points_obj (n, 3) mm move by a pose step about the part's centre."""
    points_cam = points_obj @ cam_T_obj[:3, :3].T + cam_T_obj[:3, 3]
    centre_cam = centre_position(cam_T_obj, view.centre_obj)
    flow = np.empty((len(points_obj), 2, 6))
    for axis, direction in enumerate(np.eye(2)):
        along = image_directions(points_cam, np.tile(direction, (len(points_cam), 1)), view.camera)
        flow[:, axis] = step_jacobian(points_cam, along, centre_cam)
    return flow
