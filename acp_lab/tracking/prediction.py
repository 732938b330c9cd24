"""Where the part will be in the next frame: it goes on as it went."""

from __future__ import annotations

import numpy as np

from acp_lab.geometry.pose import so3_exp, so3_log
from acp_lab.geometry.pose_step import centre_position


class ConstantVelocity:
    """Constant velocity of the part's centre and constant spin about it, from the last two poses.

    The centre is extrapolated rather than the object frame's origin, which may lie far outside the part.
    """

    def __init__(self, centre_obj: np.ndarray) -> None:
        self._centre_obj = centre_obj
        self._last: np.ndarray | None = None
        self._before: np.ndarray | None = None

    def restart(self, cam_T_obj: np.ndarray) -> None:
        """Forget the past; the part rests at `cam_T_obj` (4, 4)."""
        self._last, self._before = cam_T_obj, None

    def observe(self, cam_T_obj: np.ndarray) -> None:
        """Take in the pose (4, 4) of a further frame."""
        self._before, self._last = self._last, cam_T_obj

    @property
    def last(self) -> np.ndarray:
        """(4, 4) the last pose observed."""
        if self._last is None:
            raise ValueError("no pose observed yet: call restart first")
        return self._last

    @property
    def moves(self) -> bool:
        """Whether a motion is known, so that `predict` differs from `last`."""
        return self._before is not None

    def predict(self) -> np.ndarray:
        """(4, 4) pose expected in the next frame."""
        last, before = self.last, self._before
        if before is None:
            return last.copy()
        # Through the logarithm, which makes it a rotation again: as a bare product, rounding errors
        # would more than double from frame to frame.
        spin = so3_exp(so3_log(last[:3, :3] @ before[:3, :3].T))
        now = centre_position(last, self._centre_obj)
        centre = 2.0 * now - centre_position(before, self._centre_obj)
        predicted = np.eye(4)
        predicted[:3, :3] = spin @ last[:3, :3]
        predicted[:3, 3] = centre - predicted[:3, :3] @ self._centre_obj
        return predicted
