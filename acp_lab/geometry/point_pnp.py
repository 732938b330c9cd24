"""From image points to the pose: PnP for four or more known object points in any arrangement.

Convention: row i of points_obj (mm, object frame) is seen at row i of points_image ((x, y) px, undistorted).
Source: G. Terzakis, M. Lourakis, "A consistently fast and globally optimal solution to the
perspective-n-point problem" (2020), as cv2.SOLVEPNP_SQPNP; then Levenberg-Marquardt on the reprojection error.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from acp_lab.errors import GeometryError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import make_pose, so3_exp, transform

LEAST_POINTS = 4
_FLAT = 1e-4
_STOP = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-15)


@dataclass(frozen=True)
class PointPnP:
    """cam_T_obj: (4, 4) mm. reprojection_px: (n,) distance of each point from where the pose puts it."""

    cam_T_obj: FloatArray
    reprojection_px: FloatArray

    @property
    def rms_px(self) -> float:
        """Root mean square of the distances."""
        return float(np.sqrt((self.reprojection_px**2).mean()))


def solve_point_pnp(points_obj: FloatArray, points_image: FloatArray, camera: Camera) -> PointPnP:
    """The pose from which points (n, 3), mm, are seen at (n, 2), px, n >= 4, with the smallest error.

    Raises GeometryError for fewer points, points that are all collinear or not finite, and when no pose in
    front of the camera fits.
    """
    points = np.ascontiguousarray(points_obj, dtype=np.float64)
    pixels = np.ascontiguousarray(points_image, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3 or pixels.shape != (len(points), 2):
        raise GeometryError(f"points {points.shape} and pixels {pixels.shape}: give (n, 3) mm and (n, 2) px")
    if len(points) < LEAST_POINTS:
        raise GeometryError(f"a pose needs {LEAST_POINTS} points, there are {len(points)}: add some")
    if not (np.isfinite(points).all() and np.isfinite(pixels).all()):
        raise GeometryError("a point or pixel is not finite: leave it out")
    for rows, name in ((points, "points"), (pixels, "pixels")):
        spread = np.linalg.svd(rows - rows.mean(axis=0), compute_uv=False)
        if not spread[1] > _FLAT * spread[0]:
            raise GeometryError(f"all {len(points)} {name} are collinear or in one place: choose others")
    found = cv2.solvePnPGeneric(points, pixels, camera.matrix, None, flags=cv2.SOLVEPNP_SQPNP)
    solutions = []
    for turn, shift in zip(found[1], found[2], strict=True):
        turn, shift = cv2.solvePnPRefineLM(points, pixels, camera.matrix, None, turn, shift, _STOP)
        pose = make_pose(so3_exp(np.asarray(turn[:, 0], np.float64)), np.asarray(shift[:, 0], np.float64))
        off = np.linalg.norm(camera.project(transform(pose, points)) - pixels, axis=1)
        if np.isfinite(off).all():
            solutions.append(PointPnP(pose, off))
    if not solutions:
        raise GeometryError("no pose in front of the camera fits these points: check which pixel belongs to which")
    return min(solutions, key=lambda solution: solution.rms_px)
