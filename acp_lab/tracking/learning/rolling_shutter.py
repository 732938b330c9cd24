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
from acp_lab.geometry.pose_kernels import eliminate, invert
from acp_lab.tracking.learning.polarity import shift_size_and_step

_LEAST_POINTS = 30
# Edges that move less than this across themselves, on average, tell next to nothing.
_LEAST_PX = 1.0
# What the evidence of all frames is of: the two shares, and the four of a picture that is deformed alike in all frames.
_KEPT = 6
# Of a frame alone: the shift of outlines to their bright side, their size, and a pose step.
_BESIDE = 8


@dataclass(frozen=True)
class ShutterConfig:
    """How the time between rows is learnt.

    Attributes:
        spread: standard deviation of the share of the time between frames that reading takes, from camera to camera.
        scatter_px: of a residual; alike: how many residuals err together.
        shared_px: by which residuals may err in frame after frame, just as a shutter would have it.
        deformed: by what share of its size a picture may be stretched or sheared alike in all frames, as where a camera
            is not calibrated well, or a CAD model not exact; what a shutter does follows the motion.
        gain: what residuals show of a shutter that is not expected is less than there is, so many times: edges are
            found where they are nearest, and offsets have followed.
        least_spread: standard deviation of the share below which old evidence makes room for new; so much always
            remains, as smears and what else follows the motion err with it.
        sure: standard deviations that a share must be from 0 to be believed, and keep: to be so still.
    """

    kind: ClassVar[str] = "on"
    spread: float = 0.5
    scatter_px: float = 0.5
    alike: float = 4.0
    shared_px: float = 0.025
    deformed: float = 0.004
    gain: float = 2.0
    least_spread: float = 0.05
    sure: float = 3.5
    keep: float = 2.0

    def __post_init__(self) -> None:
        for name in ("spread", "scatter_px", "alike", "shared_px", "deformed", "gain", "least_spread", "sure", "keep"):
            if not 0.0 < getattr(self, name) < float("inf"):
                raise TrackingError(f"learning.shutter.{name} = {getattr(self, name):g}: give a number above 0")


class RollingShutter:
    """The shutter of one camera. readout: (2,), see `geometry.rolling_shutter`; None while nothing is known of it."""

    def __init__(self, config: ShutterConfig) -> None:
        self.config = config
        self.readout: FloatArray | None = None
        self._information, self._pull = np.zeros((_KEPT, _KEPT)), np.zeros(_KEPT)
        self._shared = np.zeros(2)
        self._prior = np.diag([1.0 / config.spread**2] * 2 + [1.0] * 4)

    def is_told_by(self, motion_px: FloatArray) -> bool:
        """Whether a frame whose edges move across themselves by (n,) px from frame to frame tells anything."""
        return len(motion_px) >= _LEAST_POINTS and float(np.abs(motion_px).mean()) >= _LEAST_PX

    def learn(
        self, expected: FloatArray, size_px: FloatArray, late: FloatArray, normals: FloatArray, motion_px: FloatArray,
        residuals_px: FloatArray, gradients: FloatArray, outward: FloatArray, jacobian: FloatArray,
    ) -> None:  # fmt: skip
        """Take in a solved frame.

        Args:
            expected: (2,) the readout with which the frame was solved; size_px: (2,) of the picture.
            late: (n, 2) how much farther right and down edges lie than the part's centre, as shares of that.
            normals: (n, 2) unit, theirs; motion_px: (n,) that they move along these from frame to frame.
            residuals_px: (n,) of the solved pose with the expected readout, NaN where nothing was seen.
            gradients, outward, jacobian: see `EdgePolarity.measure`; what these explain is no shutter.
        """
        config = self.config
        if not self.is_told_by(motion_px) or np.count_nonzero(np.isfinite(residuals_px)) < _LEAST_POINTS:
            return
        # Stretched and sheared by px per px, as shares of the most that is likely.
        likely_px = config.deformed * size_px * late
        rows = np.empty((_KEPT, len(late)))
        np.multiply(late.T, motion_px, out=rows[:2])
        np.multiply(likely_px.T, normals[:, 0], out=rows[2:4])
        np.multiply(likely_px.T, normals[:, 1], out=rows[4:])
        information, pull = np.zeros((_KEPT, _KEPT)), np.zeros(_KEPT)
        edges = _take_in(
            rows, plain(residuals_px), plain(gradients), plain(outward), plain(jacobian), config.scatter_px,
            information, pull,
        )  # fmt: skip
        if edges == 0.0:
            return
        known = max(self._information[0, 0], self._information[1, 1], 1e-9)
        kept = min(1.0, config.alike / (config.least_spread**2 * known))
        self._information = kept * self._information + information
        self._pull = kept * self._pull + config.gain * pull + information[:, :2] @ expected
        # What errs together in one frame does so in all, for all that is known.
        self._shared = kept * self._shared + np.sqrt(edges * information.diagonal()[:2]) / config.scatter_px
        self.readout = self._believed()

    def _believed(self) -> FloatArray | None:
        config = self.config
        shares, variances = np.empty(2), np.empty(2)
        _one_side(self._prior + self._information / config.alike, self._pull / config.alike, shares, variances)
        shared = config.shared_px * self._shared / np.maximum(self._information.diagonal()[:2], 1e-12)
        sureness = np.abs(shares) / np.sqrt(variances + shared**2 + config.least_spread**2)
        side = int(sureness.argmax())
        is_known = self.readout is not None and self.readout[side] != 0.0
        is_believed = bool(sureness[side] >= (config.keep if is_known else config.sure))
        return np.where(np.arange(2) == side, shares, 0.0) if is_believed else None


@kernel("void(f8[:, ::1], f8[::1], f8[::1], f8[::1])")
def _one_side(precision: FloatArray, pull: FloatArray, shares: FloatArray, variances: FloatArray) -> None:
    """Fill shares (2,) in [-1, 1] and variances (2,): of each of the first two unknowns where the other is 0.

    A camera reads along one side of its sensor. precision (k, k), pull (k,): of the normal equations of all.
    """
    rest = len(pull) - 2
    matrix, covariance = np.empty((1 + rest, 1 + rest)), np.empty((1 + rest, 1 + rest))
    for side in range(2):
        for row in range(1 + rest):
            for column in range(1 + rest):
                matrix[row, column] = precision[row + 1 if row else side, column + 1 if column else side]
        invert(matrix, covariance)
        share = covariance[0, 0] * pull[side]
        for k in range(rest):
            share += covariance[0, 1 + k] * pull[2 + k]
        shares[side], variances[side] = min(max(share, -1.0), 1.0), covariance[0, 0]


@kernel("f8(f8[:, ::1], f8[::1], f8[::1], f8[::1], f8[:, ::1], f8, f8[:, ::1], f8[::1])")
def _take_in(
    kept: FloatArray, residuals_px: FloatArray, gradients: FloatArray, outward: FloatArray, jacobian: FloatArray,
    scatter_px: float, information: FloatArray, pull: FloatArray,
) -> float:  # fmt: skip
    """Fill information (k, k) and pull (k,) of the normal equations of unknowns with rows kept (k, n).

    Those of the frame alone are eliminated. Weights are robust, about a first fit; their sum is returned, 0 where none
    is possible.
    """
    most, first = len(residuals_px), len(kept)
    count = first + _BESIDE
    rows, residuals = np.empty((count, most)), np.empty(most)
    edges = shift_size_and_step(gradients, outward, residuals_px, jacobian, rows[first:], residuals)
    seen = 0
    for i in range(most):
        if np.isfinite(residuals_px[i]):
            for k in range(first):
                rows[k, seen] = kept[k, i]
            seen += 1
    matrix, vector, found = np.empty((count, count)), np.empty(count), np.zeros(count)
    rest, weights, pulls = np.empty(edges), np.empty(edges), np.empty(edges)
    for turn in range(3):
        leave_rest(rows, residuals, found, rest)
        for i in range(edges):
            weights[i] = 1.0 / (1.0 + (rest[i] / scatter_px) ** 2) ** 2
            pulls[i] = weights[i] * residuals[i]
        add_up_rows(rows, weights, pulls, matrix, vector)
        for k in range(first, count):
            matrix[k, k] += 1e-6
        if turn < 2:
            for k in range(first):
                matrix[k, k] += 1e-3  # of one frame alone they may all be the same
            found[:] = vector
            if not eliminate(matrix, found):
                return 0.0
    # Schur's complement: what is left of the first ones when the others explain what they can.
    for column in range(count - 1, first - 1, -1):
        pivot = matrix[column, column]
        if not pivot > 0.0:
            return 0.0
        for row in range(column):
            factor = matrix[row, column] / pivot
            vector[row] -= factor * vector[column]
            for k in range(column):
                matrix[row, k] -= factor * matrix[column, k]
    by = 1.0 / (scatter_px * scatter_px)
    for row in range(first):
        pull[row] = by * vector[row]
        for k in range(first):
            information[row, k] = by * matrix[row, k]
    return float(weights.sum())
