"""What is known of a pose before a search: from which side, how turned, how far, and perhaps where in the image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acp_lab.geometry.arrays import BoolArray, FloatArray
from acp_lab.geometry.pose import transform


@dataclass(frozen=True, eq=False)
class PosePrior:
    """A search is limited to what is near a pose.

    Attributes:
        cam_T_obj: (4, 4) mm.
        within_deg: largest turn from it, in the image plane and out of it.
        depth_ratio: largest ratio of the depths, either way; 1 or more.
        around_px: margin around where the part appears at the pose; None for the whole image.
    """

    cam_T_obj: FloatArray
    within_deg: float
    depth_ratio: float
    around_px: float | None = None

    def depth_mm(self, centre_obj: FloatArray) -> tuple[float, float]:
        """Nearest and farthest depth of a part's centre (3,) mm."""
        depth = max(float(transform(self.cam_T_obj, centre_obj)[2]), 1.0)
        return depth / self.depth_ratio, depth * self.depth_ratio

    def allows(self, rotations: FloatArray, centre_obj: FloatArray, turns: FloatArray, slack_deg: float) -> BoolArray:
        """(n,): which rotations (n, 3, 3), object to a camera that looks at the centre, are near enough.

        turns: (s, 4, 4) the part's symmetries.
        """
        ray = transform(self.cam_T_obj, centre_obj)
        seen = rotation_from_axis(ray / max(float(np.linalg.norm(ray)), 1e-9)).T @ self.cam_T_obj[:3, :3]
        # Of the angle between two rotations; the nearest of the equal ones counts.
        traces = rotations.reshape(-1, 9) @ (seen @ turns[:, :3, :3]).reshape(-1, 9).T
        cosine = 0.5 * (traces.max(1) - 1.0)
        return np.asarray(cosine >= np.cos(np.radians(min(self.within_deg + slack_deg, 180.0))) - 1e-9)


def rotation_from_axis(directions: FloatArray) -> FloatArray:
    """(..., 3, 3): the shortest turn from the optical axis to unit directions (..., 3) in front of the camera."""
    x, y, z = directions[..., 0], directions[..., 1], directions[..., 2]
    cross = np.zeros((*directions.shape, 3))
    cross[..., 0, 2], cross[..., 2, 0] = x, -x
    cross[..., 1, 2], cross[..., 2, 1] = y, -y
    turn: FloatArray = np.eye(3) + cross + cross @ cross / np.maximum(1.0 + z, 1e-9)[..., None, None]
    return turn
