"""From four image points to the pose: PnP of a plane, with both of its solutions.

Convention: row i of points_obj (mm, object frame, coplanar) is seen at row i of points_image ((x, y) px,
undistorted). A plane seen with little perspective has two poses that explain it almost equally well (it tilts
towards or away from the camera): both are refined and kept, and `nearest` chooses by the last pose.
Choosing the better reprojection instead flips the part from frame to frame.
Source: T. Collins, A. Bartoli, "Infinitesimal plane-based pose estimation" (2014), as cv2.SOLVEPNP_IPPE.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np

from acp_lab.errors import GeometryError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.homography import corner_areas, extent
from acp_lab.geometry.pose import inverse, make_pose, rotation_angle_deg, so3_exp, transform

_OFF_PLANE = 1e-4
"""W may be off its plane by this share of its size: files in float32 or with three decimals are rounded."""
_FLAT_OBJ = 1e-4
_FLAT_PX = 1e-3
"""Three points closer to one line than this (share of the size; px) determine no pose."""
_STOP = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-15)
_NUDGE_PX = 1e-3 * np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.5], [0.0, 0.0]])


@dataclass(frozen=True)
class PlanarPnP:
    """The two poses of a plane, best first.

    poses: (2, 4, 4) cam_T_obj; reprojection_px: (2,) root mean square distance in px of the four points.
    Where the two solutions have merged (a plane seen head-on), both rows hold the same pose.
    """

    poses: FloatArray
    reprojection_px: FloatArray

    def nearest(self, prior: FloatArray) -> FloatArray:
        """The pose (4, 4) closest to a prior cam_T_obj (4, 4).

        Closeness is the rotation angle in rad plus the shift as a share of the prior's distance, which is the
        angle that the shift is seen under: both are radians, and neither needs a weight in mm.
        """
        distance = max(float(np.linalg.norm(prior[:3, 3])), 1e-9)
        first, second = (
            np.radians(rotation_angle_deg(prior[:3, :3], pose[:3, :3]))
            + float(np.linalg.norm(pose[:3, 3] - prior[:3, 3])) / distance
            for pose in self.poses
        )
        return self.poses[0 if first <= second else 1]


def solve_planar_pnp(points_obj: FloatArray, points_image: FloatArray, camera: Camera) -> PlanarPnP:
    """Both poses cam_T_obj from which four coplanar points (4, 3), mm, are seen at (4, 2), px.

    Each is IPPE's solution refined on the reprojection error by Levenberg-Marquardt, through the pinhole part
    of the camera. Raises GeometryError when the object points are not coplanar or three of them are collinear,
    when three image points are collinear, and when no plane in front of the camera shows them in this order.

    Example:
        >>> from acp_lab.geometry.camera import Camera
        >>> camera = Camera(640, 480, 600.0, 600.0, 319.5, 239.5)
        >>> square_obj = np.array([[-20.0, -20.0, 0.0], [20.0, -20.0, 0.0], [20.0, 20.0, 0.0], [-20.0, 20.0, 0.0]])
        >>> seen_px = camera.project(square_obj + [0.0, 0.0, 300.0])
        >>> solve_planar_pnp(square_obj, seen_px, camera).poses[0][:3, 3].round(3) + 0.0
        array([  0.,   0., 300.])
    """
    w, i = _four_rows(points_obj, 3, "object points"), _four_rows(points_image, 2, "image points")
    obj_T_plane = _turned_like_image(_plane_of(w.tobytes()), w, i)
    points_plane = transform(inverse(obj_T_plane), w)
    points_plane[:, 2] = 0.0

    refined = (_refine(points_plane, i, camera, *start) for start in _ippe(points_plane, i, camera.matrix))
    # A refinement that ends behind the camera (NaN) is no pose; the other solution then counts twice.
    solutions = sorted((s for s in refined if np.isfinite(s[0])), key=lambda s: s[0])
    if not solutions:
        raise GeometryError(f"image points {i.tolist()}: no pose in front of the camera fits them: check them")
    both = solutions[0], solutions[-1]
    plane_T_obj = inverse(obj_T_plane)
    return PlanarPnP(
        poses=np.stack([cam_T_plane @ plane_T_obj for _, cam_T_plane in both]),
        reprojection_px=np.array([error for error, _ in both]),
    )


def _ippe(points_plane: FloatArray, points_image: FloatArray, matrix: FloatArray) -> list[tuple[Any, Any]]:
    """cv2's two solutions, as (rotation vector, shift).

    Of a quad that lies exactly symmetric in the image cv2 makes NaN at some tilts; a thousandth of a px helps, and the
    refinement goes back to the points themselves.
    """
    for points in (points_image, points_image + _NUDGE_PX):
        _, turns, shifts, _ = cv2.solvePnPGeneric(points_plane, points, matrix, None, flags=cv2.SOLVEPNP_IPPE)
        if np.isfinite(turns).all() and np.isfinite(shifts).all():
            break
    return list(zip(turns, shifts, strict=True))


def _refine(
    points_plane: FloatArray, points_image: FloatArray, camera: Camera, turn: Any, shift: Any
) -> tuple[float, FloatArray]:
    """Root mean square error in px (NaN behind the camera) and the refined cam_T_plane (4, 4)."""
    turn, shift = cv2.solvePnPRefineLM(points_plane, points_image, camera.matrix, None, turn, shift, _STOP)
    cam_T_plane = make_pose(so3_exp(turn[:, 0]), shift[:, 0])
    off = camera.project(transform(cam_T_plane, points_plane)) - points_image
    return math.sqrt(float((off * off).sum()) / 4.0), cam_T_plane


def _four_rows(points: FloatArray, columns: int, name: str) -> FloatArray:
    array = np.ascontiguousarray(points, dtype=np.float64)
    if array.shape != (4, columns):
        raise GeometryError(f"{name} have shape {array.shape}: planar PnP takes 4 rows of {columns} numbers")
    if not np.isfinite(array).all():
        raise GeometryError(f"{name} {array.tolist()}: a number is not finite")
    return array


@lru_cache(maxsize=32)
def _plane_of(points_obj: bytes) -> FloatArray:
    """obj_T_plane (4, 4) of points (4, 3): origin in their centre, z along the normal; read-only.

    W is the same in every frame: taking its bytes lets the answer be kept.
    """
    w = np.frombuffer(points_obj).reshape(4, 3)
    centre = w.mean(axis=0)
    _, spread, axes = np.linalg.svd(w - centre)
    if not spread[1] > _FLAT_OBJ * spread[0]:
        raise GeometryError(f"object points {w.tolist()}: collinear or all in one place: choose a proper quadrilateral")
    if spread[2] > _OFF_PLANE * spread[0]:
        raise GeometryError(
            f"object points {w.tolist()}: not coplanar, off by {spread[2]:.3g} mm: move them onto one plane"
        )
    if np.linalg.det(axes) < 0.0:
        axes[2] = -axes[2]
    obj_T_plane = make_pose(axes.T, centre)
    obj_T_plane.flags.writeable = False
    return obj_T_plane


def _turned_like_image(obj_T_plane: FloatArray, w: FloatArray, image: FloatArray) -> FloatArray:
    """The plane's frame with z away from the camera and x, y turned to lie as in the image.

    The rotation left to be found is then a tilt of less than about 90 degrees. Near 180 degrees, which a part
    seen from its other side or upside down reaches, cv2's IPPE loses up to 7 degrees (its rotation vector is
    taken from the trace), and the refinement does not always come back.
    """
    flat = ((w - obj_T_plane[:3, 3]) @ obj_T_plane[:3, :3])[:, :2]
    side = 1.0 if _sees_same_side(flat, image) else -1.0
    x, y = flat[:, 0], side * flat[:, 1]
    u, v = image.T  # not centred: x and y are, which takes the image's centre out of the sums
    roll = math.atan2(float(x @ v - y @ u), float(x @ u + y @ v))
    c, s = math.cos(roll), math.sin(roll)
    # Columns: where the new axes point in the old plane's frame; side -1 is half a turn about its x axis.
    turn = np.array([[c, s, 0.0], [-side * s, side * c, 0.0], [0.0, 0.0, side]])
    return make_pose(obj_T_plane[:3, :3] @ turn, obj_T_plane[:3, 3])


def _sees_same_side(flat: FloatArray, image: FloatArray) -> bool:
    """Whether the image shows the plane's points (4, 2) turning the same way; refuses what no view can show.

    A view keeps the turning direction of all four triangles of the plane or, from behind, flips all of them.
    """
    areas, areas_image = corner_areas(flat), corner_areas(image)
    if not min(map(abs, areas)) > _FLAT_OBJ * extent(flat) ** 2:
        raise GeometryError(f"object points {flat.tolist()} in their plane: three are collinear: move one")
    if not min(map(abs, areas_image)) > _FLAT_PX * extent(image):
        raise GeometryError(f"image points {image.tolist()}: three collinear, the plane is seen edge-on: pose unknown")
    agree = [(a > 0.0) == (b > 0.0) for a, b in zip(areas, areas_image, strict=True)]
    if any(agree) and not all(agree):
        raise GeometryError(f"image points {image.tolist()}: folded, no view of the object points: check their order")
    return agree[0]
