"""A picture of the CAD model alone, turned as one likes, whose corners can be pointed at."""

from __future__ import annotations

from typing import Any

import numpy as np

from acp_lab.cad.corners import corner_points, visible_points
from acp_lab.cad.part import Part
from acp_lab.cad.ray_shading import ray_shade
from acp_lab.cad.raycast import make_caster
from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.display.widgets.point_canvas import PointCanvas
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import make_pose, so3_exp, transform

SIZE_PX = 360
DISTANCE_IN_RADII = 5.0
FILL = 0.44
REACH_PX = 16.0
"""A click this near to a corner means it."""


class CadView(PointCanvas):
    """The part from a distance of five radii, in the middle of a square picture; traits as in `PointCanvas`.

    pose: (4, 4) cam_T_obj of the view, camera: its pinhole camera. corners_obj: (n, 3) mm, what can be picked.
    """

    def __init__(self, part: Part, rotation: FloatArray, **traits: Any) -> None:
        """rotation: (3, 3), object to camera axes."""
        self.part = part
        self.corners_obj = corner_points(part)
        self._caster = make_caster(part)
        focal = FILL * SIZE_PX * np.sqrt(DISTANCE_IN_RADII**2 - 1.0)
        middle = 0.5 * (SIZE_PX - 1)
        self.camera = Camera(SIZE_PX, SIZE_PX, float(focal), float(focal), middle, middle)
        super().__init__(None, **{"height_px": 340, **traits})
        self.look(rotation)

    def look(self, rotation: FloatArray) -> None:
        """Turn the view; rotation (3, 3), object to camera axes."""
        distance = np.array([0.0, 0.0, DISTANCE_IN_RADII * self.part.radius])
        self.pose = make_pose(rotation, distance - rotation @ self.part.box_centre)
        self.show(ray_shade(self.part, self._caster, self.camera, self.pose))

    def turn(self, turn_deg: tuple[float, float, float]) -> None:
        """Turn the view about the camera's axes."""
        self.look(so3_exp(np.radians(turn_deg)) @ self.pose[:3, :3])

    def project(self, points_obj: FloatArray) -> FloatArray:
        """Pixels (n, 2) of object points (n, 3)."""
        return self.camera.project(transform(self.pose, points_obj))

    def seen_corners(self) -> np.ndarray:
        """Rows of `corners_obj` that this view shows."""
        slack_mm = 0.005 * self.part.diameter
        return np.flatnonzero(visible_points(self._caster, self.corners_obj, eye_position(self.pose), slack_mm))

    def corner_at(self, pixel: FloatArray) -> int | None:
        """The row of the corner shown nearest to a pixel (2,); None when none is near."""
        rows = self.seen_corners()
        if len(rows) == 0:
            return None
        distance = np.linalg.norm(self.project(self.corners_obj[rows]) - pixel, axis=1)
        return int(rows[distance.argmin()]) if distance.min() <= REACH_PX else None
