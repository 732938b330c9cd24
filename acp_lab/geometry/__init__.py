"""Geometry of one camera and one rigid part: cameras, poses, pose steps, homographies, splines and PnP.

NumPy on small float64 arrays, the loops of each frame compiled, and nothing of edges or trackers; of images only what
undoes a lens (`Undistorter`, cv2) and warps by splines (kornia). docs/conventions.md spells out axes,
pixel centres, units and names.
"""

from __future__ import annotations

from acp_lab.geometry.camera import Camera, Undistorter
from acp_lab.geometry.homography import (
    apply_homography,
    check_quad,
    homography_from_points,
    homography_points_jacobian,
)
from acp_lab.geometry.planar_pnp import PlanarPnP, solve_planar_pnp
from acp_lab.geometry.pose import (
    check_pose,
    check_rotation,
    disturb_pose,
    interpolate,
    inverse,
    make_pose,
    rotation,
    rotation_angle_deg,
    se3_exp,
    se3_log,
    so3_exp,
    so3_log,
    transform,
    translation,
)
from acp_lab.geometry.tps import warp_image_tps, warp_points_tps

__all__ = [
    "Camera",
    "PlanarPnP",
    "Undistorter",
    "apply_homography",
    "check_pose",
    "check_quad",
    "check_rotation",
    "disturb_pose",
    "homography_from_points",
    "homography_points_jacobian",
    "interpolate",
    "inverse",
    "make_pose",
    "rotation",
    "rotation_angle_deg",
    "se3_exp",
    "se3_log",
    "so3_exp",
    "so3_log",
    "solve_planar_pnp",
    "transform",
    "translation",
    "warp_image_tps",
    "warp_points_tps",
]
