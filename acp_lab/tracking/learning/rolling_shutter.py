"""In which direction a camera reads its pictures and how long it takes, told by how what moves is deformed.

Phones, webcams and most cheap cameras read a picture row by row (`geometry.rolling_shutter`), and none tells how fast.
The pose explains no shear that comes and goes with the motion: what it leaves of the residuals of moving edges shows
the time between rows. Where a picture was turned, as a phone's held upright, rows are columns, or run upwards: the time
is learnt across the picture and down it.
(Not in the paper; see docs/paper-ledger.md.)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from acp_lab.compiled import kernel
from acp_lab.errors import TrackingError
from acp_lab.geometry.arrays import FloatArray, plain
from acp_lab.geometry.normal_equations import add_up_rows, leave_rest
from acp_lab.geometry.pose_kernels import eliminate

_LEAST_POINTS = 30
# Beside the two shares: the shift of outlines to their bright side, their size, and a pose step.
_BESIDE = 8


@dataclass(frozen=True)
class ShutterConfig:
    """How the time between rows is learnt.

    Attributes:
        spread: standard deviation of the share of the time between frames that reading takes, from camera to camera.
        scatter_px: of a residual; alike: how many residuals err together.
        shared_px: by which residuals may err in frame after frame, just as a shutter would have it.
        gain: what residuals show of a shutter that is not expected is less than there is, so many times: edges are
            found where they are nearest, and offsets have followed.
        least_spread: standard deviation of the share below which old evidence makes room for new.
        sure: standard deviations that a share must be from 0 to be believed.
    """

    kind: ClassVar[str] = "on"
    spread: float = 0.5
    scatter_px: float = 0.5
    alike: float = 4.0
    shared_px: float = 0.025
    gain: float = 2.0
    least_spread: float = 0.05
    sure: float = 3.5

    def __post_init__(self) -> None:
        for name in ("spread", "scatter_px", "alike", "shared_px", "gain", "least_spread", "sure"):
            if not 0.0 < getattr(self, name) < float("inf"):
                raise TrackingError(f"learning.shutter.{name} = {getattr(self, name):g}: give a number above 0")


class RollingShutter:
    """The shutter of one camera. readout: (2,), see `geometry.rolling_shutter`; None while nothing is known of it."""

    def __init__(self, config: ShutterConfig) -> None:
        self.config = config
        self.readout: FloatArray | None = None
        self._information, self._pull, self._shared = np.zeros((2, 2)), np.zeros(2), np.zeros(2)

    def learn(
        self, expected: FloatArray, late: FloatArray, motion_px: FloatArray, residuals_px: FloatArray,
        gradients: FloatArray, outward: FloatArray, jacobian: FloatArray,
    ) -> None:  # fmt: skip
        """Take in a solved frame.

        Args:
            expected: (2,) the readout with which the frame was solved.
            late: (n, 2) how much farther right and down edges lie than the part's centre, as shares of the picture.
            motion_px: (n,) that they move along their normals from frame to frame.
            residuals_px: (n,) of the solved pose with the expected readout, NaN where nothing was seen.
            gradients, outward, jacobian: see `EdgePolarity.measure`; what these explain is no shutter.
        """
        config = self.config
        if np.count_nonzero(np.isfinite(residuals_px)) < _LEAST_POINTS:
            return
        information, pull = np.zeros((2, 2)), np.zeros(2)
        edges = _take_in(
            plain(late), plain(motion_px), plain(residuals_px), plain(gradients), plain(outward), plain(jacobian),
            config.scatter_px, information, pull,
        )  # fmt: skip
        if edges == 0.0:
            return
        kept = min(1.0, config.alike / (config.least_spread**2 * max(self._information.max(), 1e-9)))
        self._information = kept * self._information + information
        self._pull = kept * self._pull + information @ expected + config.gain * pull
        # What errs together in one frame, px times px per edge, if it does so in all.
        self._shared = kept * self._shared + np.sqrt(edges * np.diag(information)) / config.scatter_px
        self._believe()

    def _believe(self) -> None:
        config, information = self.config, np.diag(self._information)
        # Rows or columns: a camera reads along one side of its sensor.
        precision = information / config.alike + 1.0 / config.spread**2
        found = np.clip(self._pull / (config.alike * precision), -1.0, 1.0)
        shared = config.shared_px * self._shared / np.maximum(information, 1e-12)
        sureness = np.abs(found) / np.sqrt(1.0 / precision + shared**2)
        side = int(sureness.argmax())
        self.readout = found * (np.arange(2) == side) if sureness[side] > config.sure else None


@kernel(
    "f8(f8[:, ::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[:, ::1], f8, f8[:, ::1], f8[::1])",
)
def _take_in(
    late: FloatArray, motion_px: FloatArray, residuals_px: FloatArray, gradients: FloatArray, outward: FloatArray,
    jacobian: FloatArray, scatter_px: float, information: FloatArray, pull: FloatArray,
) -> float:  # fmt: skip
    """Fill information (2, 2) and pull (2,) of the normal equations of the shares alone, the others eliminated.

    Weights are robust, about a first fit; their sum is returned, 0 where nothing can be fitted.
    """
    most, edges, count = len(residuals_px), 0, 2 + 8
    rows, residuals = np.empty((count, most)), np.empty(most)
    scale = np.full(6, 1e-12)
    for i in range(most):
        if np.isfinite(residuals_px[i]):
            residuals[edges] = residuals_px[i]
            rows[0, edges], rows[1, edges] = motion_px[i] * late[i, 0], motion_px[i] * late[i, 1]
            rows[2, edges], rows[3, edges] = np.sign(gradients[i]) * abs(outward[i]), outward[i]
            for k in range(6):
                rows[4 + k, edges] = jacobian[i, k]
                scale[k] = max(scale[k], abs(jacobian[i, k]))
            edges += 1
    for k in range(6):
        for i in range(edges):
            rows[4 + k, i] /= scale[k]  # rad and mm alike
    matrix, vector, found = np.empty((count, count)), np.empty(count), np.zeros(count)
    rest, weights, pulls = np.empty(edges), np.empty(edges), np.empty(edges)
    for turn in range(3):
        leave_rest(rows, residuals, found, rest)
        for i in range(edges):
            weights[i] = 1.0 / (1.0 + (rest[i] / scatter_px) ** 2) ** 2
            pulls[i] = weights[i] * residuals[i]
        add_up_rows(rows, weights, pulls, matrix, vector)
        for k in range(2, count):
            matrix[k, k] += 1e-6
        if turn < 2:
            for k in range(2):
                matrix[k, k] += 1e-6
            found[:] = vector
            if not eliminate(matrix, found):
                return 0.0
    # Schur's complement: what is left of the shares once the others explain what they can.
    for column in range(count - 1, 1, -1):
        pivot = matrix[column, column]
        if not pivot > 0.0:
            return 0.0
        for row in range(column):
            factor = matrix[row, column] / pivot
            vector[row] -= factor * vector[column]
            for k in range(column):
                matrix[row, k] -= factor * matrix[column, k]
    by = 1.0 / (scatter_px * scatter_px)
    for row in range(2):
        pull[row] = by * vector[row]
        for k in range(2):
            information[row, k] = by * matrix[row, k]
    return float(weights.sum())
