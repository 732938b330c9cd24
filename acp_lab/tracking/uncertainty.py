"""How exact is a pose, given that the part is there? Its covariance, for those who fuse, grasp or measure with it.

The solve's own covariance takes the edge points' errors as independent, and is far too small: what puts one edge beside
the CAD's puts others there too. So the pose is told together with two unknowns, by how much the edges of the outline
are broken and by how much the creases within it (`edge_breaks`), of which little is known beforehand. A part whose
inner edges hold its distance stays exact; a bare plate, whose rim alone tells it, does not. What neighbours have in
common beyond that is a multiple of the rest, and a shift by a share of a px.

The four terms were fitted to errors on tuning parts and on random ones (`benchmarks/uncertainty.py`,
docs/benchmark.md).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from acp_lab.cad.part import Part
from acp_lab.compiled import kernel
from acp_lab.errors import TrackingError
from acp_lab.geometry.arrays import FloatArray, plain
from acp_lab.geometry.pose_kernels import invert


@dataclass(frozen=True)
class PoseUncertainty:
    """Configuration: the terms of the covariance. mm are of parts of usual size, see `part_size`.

    Attributes:
        image: multiple of the variance that the solve alone would give.
        outline_mm, crease_mm: standard deviation of how far the edges of the outline, and the creases within it, are
            broken, beside what is expected of each; of creases as good as nothing is known.
        shift_px: standard deviation of a shift of the part.
    """

    kind: ClassVar[str] = "calibrated"
    in_mm: ClassVar[Mapping[str, int]] = {"outline_mm": 1, "crease_mm": 1}
    image: float = 2.9
    outline_mm: float = 0.18
    crease_mm: float = 5.0
    shift_px: float = 0.12

    def __post_init__(self) -> None:
        if not 1e-6 <= self.image <= 1e6:
            raise TrackingError(f"uncertainty.image = {self.image:g}: give 1e-6 to 1e6")
        for name in ("outline_mm", "crease_mm", "shift_px"):
            if not 0.0 <= getattr(self, name) <= 1e9:
                raise TrackingError(f"uncertainty.{name} = {getattr(self, name):g}: give 0 to 1e9")

    def covariance(self, information: FloatArray, mm_per_px: float) -> FloatArray:
        """(6, 6) of a pose step (rad, mm) about the part's centre, in camera axes.

        Args:
            information: (8, 8) by the image alone, see `Solution.information`.
            mm_per_px: at the part's distance.
        """
        covariance = np.empty((6, 6))
        shift_mm = self.shift_px * mm_per_px
        breaks_mm = np.array([self.outline_mm, self.crease_mm], np.float64)
        _of_pose(np.array(information, np.float64), float(self.image), breaks_mm, shift_mm, covariance)
        return covariance


@kernel("void(f8[:, ::1], f8, f8[::1], f8, f8[:, ::1])")
def _of_pose(
    information: FloatArray, image: float, breaks_mm: FloatArray, shift_mm: float, covariance: FloatArray
) -> None:
    """Fill covariance (6, 6), see `PoseUncertainty.covariance`; the information (8, 8) is used up."""
    count = len(information)
    for i in range(count):
        # A direction that the image says nothing of is as uncertain as can be, not infinitely so.
        information[i, i] += 1e-9 * information[i, i] + 1e-9
    for i in range(6, count):
        # What is known of a break beforehand; the multiple of the image's variance is not to widen it.
        information[i, i] += image / max(breaks_mm[i - 6] ** 2, 1e-12)
    both = np.empty((count, count))
    invert(information, both)
    for i in range(6):
        for k in range(6):
            covariance[i, k] = 0.5 * image * (both[i, k] + both[k, i])
        if i >= 3:
            covariance[i, i] += shift_mm * shift_mm


def spread(covariance: FloatArray) -> tuple[float, float]:
    """Standard deviations (deg, mm) of a covariance (6, 6): of the turn and of the shift that are least known."""
    turn, shift = (np.linalg.eigvalsh(block)[-1] for block in (covariance[:3, :3], covariance[3:, 3:]))
    return float(np.degrees(np.sqrt(max(turn, 0.0)))), float(np.sqrt(max(shift, 0.0)))


class ExpectedError:
    """The ADD that a covariance lets one expect of a part.

    Of a part that a turn leaves as it is, what its turns about that axis add is left out, as ADD-S does.
    """

    def __init__(self, part: Part) -> None:
        arms = part.vertices - part.box_centre
        self._mean, self._square = plain(arms.mean(0)), plain(arms.T @ arms / len(arms))
        self._free = np.empty((len(part.symmetries.continuous), 6))
        for free, (axis, offset) in zip(self._free, part.symmetries.continuous, strict=True):
            free[:3] = axis
            free[3:] = np.cross(np.subtract(offset, part.box_centre), free[:3])

    def rms_mm(self, covariance: FloatArray, cam_T_obj: FloatArray) -> float:
        """Root of the mean squared distance of the part's vertices at a pose (4, 4) with a covariance (6, 6)."""
        return float(_rms(plain(covariance), plain(cam_T_obj), self._mean, self._square, self._free))


@kernel("f8(f8[:, ::1], f8[:, ::1], f8[::1], f8[:, ::1], f8[:, ::1])")
def _rms(
    covariance: FloatArray, pose: FloatArray, mean: FloatArray, square: FloatArray, free: FloatArray
) -> float:  # fmt: skip
    """See `ExpectedError.rms_mm`.

    mean (3,), square (3, 3): of the vertices about the centre and of their outer products; free: (k, 6) steps in the
    object's axes that leave the part as it is.
    """
    # In the camera's axes: a turn w and a shift v move a vertex at r by w x r + v.
    turned, at, spread, cost = np.zeros((3, 3)), np.zeros(3), np.zeros((3, 3)), np.zeros((6, 6))
    for i in range(3):
        for k in range(3):
            at[i] += pose[i, k] * mean[k]
            for j in range(3):
                turned[i, k] += pose[i, j] * square[j, k]
    for i in range(3):
        for k in range(3):
            for j in range(3):
                spread[i, k] += turned[i, j] * pose[k, j]
    trace = spread[0, 0] + spread[1, 1] + spread[2, 2]
    for i in range(3):
        one, other = (i + 1) % 3, (i + 2) % 3
        cost[i, i], cost[3 + i, 3 + i] = trace, 1.0
        cost[i, 3 + one], cost[i, 3 + other] = -at[other], at[one]
        cost[3 + one, i], cost[3 + other, i] = -at[other], at[one]
        for k in range(3):
            cost[i, k] -= spread[i, k]
    step, pull = np.empty(6), np.empty(6)
    for row in range(len(free)):
        for i in range(3):
            step[i], step[3 + i] = 0.0, 0.0
            for k in range(3):
                step[i] += pose[i, k] * free[row, k]
                step[3 + i] += pose[i, k] * free[row, 3 + k]
        along = 0.0
        for i in range(6):
            pull[i] = 0.0
            for k in range(6):
                pull[i] += cost[i, k] * step[k]
            along += step[i] * pull[i]
        for i in range(6):
            for k in range(6):
                cost[i, k] -= pull[i] * pull[k] / max(along, 1e-12)
    return np.sqrt(max((cost * covariance).sum(), 0.0))
