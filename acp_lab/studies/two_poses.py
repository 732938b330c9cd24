"""The two poses of four coplanar points, while a part tilts past the camera: when do they fit alike, when do they flip?

Convention: tilts in degrees about the camera's y axis, 0 where the plane of the points is seen from the front.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from acp_lab.cad.part import Part
from acp_lab.control_points.coplanar_points import mid_section_points
from acp_lab.detection.view_templates import looking_along
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.planar_pnp import solve_planar_pnp
from acp_lab.geometry.pose import make_pose, so3_exp, so3_log, transform

Z_AXIS = 2
ALIKE_DEG = 1.0
"""Poses whose tilts differ by less have merged: neither is the wrong one."""


@dataclass(frozen=True, eq=False)
class TwoPoses:
    """PnP at one moment.

    cam_T_true: (4, 4). points: (4, 2) px, I with its noise. poses: (2, 4, 4), the one that fits better first; tilts_deg
    and errors_px: (2,) of them, the latter rms of the reprojection. true_deg: the true tilt.
    """

    cam_T_true: FloatArray
    points: FloatArray
    poses: FloatArray
    tilts_deg: FloatArray
    true_deg: float
    errors_px: FloatArray

    @property
    def is_flipped(self) -> bool:
        """Whether the pose that fits better is the wrong one."""
        off = np.abs(self.tilts_deg - self.true_deg)
        return bool(off[0] > off[1] + ALIKE_DEG)


def tilt_past_the_camera(
    part: Part, camera: Camera, distance_mm: float, tilts_deg: Sequence[float], noise_px: float, seed: int = 0
) -> tuple[TwoPoses, ...]:
    """The part's +z side turned about the vertical through the tilts, each of its four points seen with noise (sigma).

    Seen head-on, where the two poses have merged, both rows hold the same one.
    """
    rng = np.random.default_rng(seed)
    points_obj = mid_section_points(part.box_min, part.box_max, Z_AXIS)
    front = looking_along(np.array([0.0, 0.0, -1.0]))
    centre = np.array([0.0, 0.0, distance_mm])
    moments = []
    for tilt_deg in tilts_deg:
        rotation = so3_exp(np.radians([0.0, tilt_deg, 0.0])) @ front
        truth = make_pose(rotation, centre - rotation @ part.box_centre)
        points = camera.project(transform(truth, points_obj)) + rng.normal(0.0, noise_px, (4, 2))
        solution = solve_planar_pnp(points_obj, points, camera)
        order = np.argsort(solution.reprojection_px)
        poses = np.array(solution.poses)[order]
        tilts = np.array([np.degrees(so3_log(pose[:3, :3] @ front.T)[1]) for pose in poses])
        moments.append(
            TwoPoses(truth, points, poses, tilts, float(tilt_deg), np.array(solution.reprojection_px)[order])
        )
    return tuple(moments)
