"""The canonical frame: the view in which generators learn, and the homography back to the real image.

A virtual camera stands where the real one stands, looks at the box centre, has its up-vector fixed per
view region and a focal length that makes the bounding sphere fill 92% of a small square image. Because
both cameras share their centre, K R Kc^-1 maps one image to the other exactly at any depth. Of the six
degrees of freedom of a pose only three are left to learn: two of view, one of distance. (Deviation
from the paper, which generates in the full image.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acp_lab.control_points.view_regions import ViewRegion
from acp_lab.errors import GeometryError
from acp_lab.geometry.camera import Camera

CANONICAL_SIZE = 128
FILL = 0.46


@dataclass(frozen=True)
class CanonicalFrame:
    """A virtual camera at the eye that looks at the part.

    Attributes:
        canonical_T_obj: (4, 4) object to canonical camera, mm.
        focal_px: focal length in canonical px.
        size: side of the square canonical image in px.
    """

    canonical_T_obj: np.ndarray
    focal_px: float
    size: int = CANONICAL_SIZE

    @property
    def matrix(self) -> np.ndarray:
        """(3, 3) intrinsics Kc; the principal point is the middle of the image."""
        middle = 0.5 * (self.size - 1)
        return np.array([[self.focal_px, 0.0, middle], [0.0, self.focal_px, middle], [0.0, 0.0, 1.0]])

    def project(self, points_obj: np.ndarray) -> np.ndarray:
        """(n, 3) mm in the object frame to (n, 2) canonical px."""
        points = points_obj @ self.canonical_T_obj[:3, :3].T + self.canonical_T_obj[:3, 3]
        return self.focal_px * points[:, :2] / points[:, 2:] + 0.5 * (self.size - 1)

    def homography_to(self, camera: Camera, cam_T_obj: np.ndarray) -> np.ndarray:
        """(3, 3) from canonical px to px of the real image, K R Kc^-1, exact at any depth.

        `cam_T_obj` must have the same eye as this frame.
        """
        cam_R_canonical = cam_T_obj[:3, :3] @ self.canonical_T_obj[:3, :3].T
        return camera.matrix @ cam_R_canonical @ np.linalg.inv(self.matrix)


def eye_position(cam_T_obj: np.ndarray) -> np.ndarray:
    """(3,) mm: the camera's centre in the object frame."""
    return -(cam_T_obj[:3, :3].T @ cam_T_obj[:3, 3])


def canonical_frame(
    eye_obj: np.ndarray, box_centre: np.ndarray, radius: float, region: ViewRegion, size: int = CANONICAL_SIZE
) -> CanonicalFrame:
    """The canonical frame of an eye.

    Args:
        eye_obj: (3,) mm, camera centre in the object frame.
        box_centre: (3,) mm.
        radius: mm, of the bounding sphere about the box centre.
        region: whose up-vector is used.

    Raises:
        GeometryError: the eye lies inside the bounding sphere.
    """
    to_centre = box_centre - eye_obj
    distance = float(np.linalg.norm(to_centre))
    if not distance > radius:
        raise GeometryError(
            f"the camera is {distance:.1f} mm from the part's centre, inside its bounding sphere of {radius:.1f} mm; "
            "check the pose and its unit (mm)"
        )
    z_axis = to_centre / distance
    x_axis = _cross(z_axis, region.up_obj)
    x_axis /= np.linalg.norm(x_axis)
    rotation = np.stack([x_axis, _cross(z_axis, x_axis), z_axis])
    canonical_T_obj = np.eye(4)
    canonical_T_obj[:3, :3] = rotation
    canonical_T_obj[:3, 3] = -rotation @ eye_obj
    focal = FILL * size * float(np.sqrt(distance**2 - radius**2)) / radius
    return CanonicalFrame(canonical_T_obj, focal, size)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    # np.cross takes ten times as long for two vectors, and this runs several times per frame.
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
