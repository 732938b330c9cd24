"""How exact is a pose, given that it is right? Its covariance, for those who fuse, grasp or measure with it.

The solve's own covariance, from residuals that are taken as independent, is far too small: neighbouring edge samples
err together. Four terms were fitted to errors on tuning parts (`benchmarks/uncertainty.py`, docs/benchmark.md): a
multiple of the solve's own; outlines that lie beside the CAD's by the same length everywhere, which looks like another
distance, dz / z = length / radius; turns that move the part's rim by a share of a px; and shifts by one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from acp_lab.compiled import kernel
from acp_lab.errors import TrackingError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose_kernels import invert


@dataclass(frozen=True)
class PoseUncertainty:
    """Configuration: the terms of the covariance.

    Attributes:
        image: multiple of the solve's own covariance.
        outline_mm: standard deviation of how far outlines lie beside the CAD's, all of them alike.
        turn_px, shift_px: standard deviation of the rim's motion by turns, and of the part's by shifts.
    """

    kind: ClassVar[str] = "calibrated"
    image: float = 2.8
    outline_mm: float = 0.077
    turn_px: float = 0.38
    shift_px: float = 0.1

    def __post_init__(self) -> None:
        for name in ("image", "outline_mm", "turn_px", "shift_px"):
            if not 0.0 <= getattr(self, name) < float("inf"):
                raise TrackingError(f"uncertainty.{name} = {getattr(self, name):g}: give 0 or more")

    def covariance(
        self, information: FloatArray, centre_cam: FloatArray, camera: Camera, radius_mm: float
    ) -> FloatArray:
        """(6, 6) of a pose step (rad, mm) about the part's centre, in camera axes.

        Args:
            information: (6, 6) by the image alone, see `Solution.information`.
            centre_cam: (3,) mm, the part's centre.
            radius_mm: half the part's diameter.
        """
        mm_per_px, covariance = float(centre_cam[2]) / camera.fx, np.empty((6, 6))
        _add_terms(
            np.array(information, np.float64), self.image, self.outline_mm**2, centre_cam / radius_mm,
            (self.turn_px * mm_per_px / radius_mm) ** 2, (self.shift_px * mm_per_px) ** 2, covariance,
        )  # fmt: skip
        return covariance


@kernel("void(f8[:, ::1], f8, f8, f8[::1], f8, f8, f8[:, ::1])")
def _add_terms(
    information: FloatArray, image: float, outline: float, towards: FloatArray, turn: float, shift: float,
    covariance: FloatArray,
) -> None:  # fmt: skip
    """Fill covariance (6, 6), see `PoseUncertainty.covariance`; the information (6, 6) is used up.

    image: multiple of the solve's own; outline, turn, shift: variances, the first along towards (3,).
    """
    for i in range(6):
        # A direction that the image says nothing of is as uncertain as can be, not infinitely so.
        information[i, i] += 1e-9 * information[i, i] + 1e-9
    own = np.empty((6, 6))
    invert(information, own)
    for i in range(6):
        for k in range(6):
            own[i, k] *= image
            if i >= 3 and k >= 3:
                own[i, k] += outline * towards[i - 3] * towards[k - 3]
        own[i, i] += turn if i < 3 else shift
    for i in range(6):
        for k in range(6):
            covariance[i, k] = 0.5 * (own[i, k] + own[k, i])


def spread(covariance: FloatArray) -> tuple[float, float]:
    """Standard deviations (deg, mm) of a covariance (6, 6): of the turn and of the shift that are least known."""
    turn, shift = (np.linalg.eigvalsh(block)[-1] for block in (covariance[:3, :3], covariance[3:, 3:]))
    return float(np.degrees(np.sqrt(max(turn, 0.0)))), float(np.sqrt(max(shift, 0.0)))
