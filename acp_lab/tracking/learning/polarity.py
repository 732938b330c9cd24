"""Image outlines lie to the dark or to the bright side of where they belong, all of them alike.

Where a rounded rim turns away from the light it is darker than the face beside it; a bright ground shines past a
blurred outline; a camera encodes light by a curve that nobody knows. Each shifts the place of steepest grey towards one
side of the edge, and where the part is brighter than its ground on one side of the image and darker on the other, it is
drawn sideways or away. Where both polarities are in the image the shift can be told from a motion of the part.
(Not in the paper, which takes edges as they are; see docs/paper-ledger.md.)
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


@dataclass(frozen=True)
class PolarityConfig:
    """How the shift is learnt.

    Attributes:
        spread_px: standard deviation of the shift, from sequence to sequence.
        scatter_px: of a residual; alike: how many residuals err together.
        rate: share of what a frame shows that is taken over.
        largest_px: no shift is taken as larger.
    """

    kind: ClassVar[str] = "on"
    spread_px: float = 0.3
    scatter_px: float = 0.5
    alike: float = 10.0
    rate: float = 0.15
    largest_px: float = 1.5

    def __post_init__(self) -> None:
        for name in ("spread_px", "scatter_px", "alike", "largest_px"):
            if not 0.0 < getattr(self, name) < float("inf"):
                raise TrackingError(f"learning.polarity.{name} = {getattr(self, name):g}: give a number above 0")
        if not 0.0 <= self.rate <= 1.0:
            raise TrackingError(f"learning.polarity.rate = {self.rate:g}: give 0 to 1")


class EdgePolarity:
    """The shift of one tracked part's outlines. shift_px: towards where it is brighter."""

    def __init__(self, config: PolarityConfig) -> None:
        self.config = config
        self.forget()

    def forget(self) -> None:
        """No shift is known."""
        self.shift_px = 0.0

    def measure(
        self, gradients: FloatArray, outward: FloatArray, residuals_px: FloatArray, jacobian: FloatArray, rate: float
    ) -> float:
        """Take over a share of what a solved frame shows; by how much the shift moved, px.

        Args:
            gradients: (n,) of the chosen candidates, along the normals.
            outward: (n,) 1 for outlines whose normal leads off the part, -1 where it leads onto it, 0 for other edges.
            residuals_px: (n,) beside the expected shift, NaN where nothing was seen.
            jacobian: (n, 6) of the motion along the normals by a pose step. What a step explains is no shift, nor what
                a part that is larger or smaller than its CAD model explains.
            rate: that share, for a shift that the frame shows beyond doubt.
        """
        config, before = self.config, self.shift_px
        if np.count_nonzero(np.isfinite(residuals_px)) < _LEAST_POINTS:
            return 0.0
        doubt = config.alike * (config.scatter_px / config.spread_px) ** 2
        found = _fit_shift(
            plain(gradients), plain(outward), plain(residuals_px), plain(jacobian), doubt, config.scatter_px, before
        )
        self.shift_px = min(max(before + rate * found, -config.largest_px), config.largest_px)
        return self.shift_px - before


@kernel("i8(f8[::1], f8[::1], f8[::1], f8[:, ::1], f8[:, ::1], f8[::1])")
def shift_size_and_step(
    gradients: FloatArray, outward: FloatArray, residuals_px: FloatArray, jacobian: FloatArray, rows: FloatArray,
    residuals: FloatArray,
) -> int:  # fmt: skip
    """Fill rows (8, n) and residuals (n,) with what is finite of n residuals; returns how many that is.

    A row is of how residuals follow an unknown: the shift, the size, and the six of a pose step, rad and mm alike in
    that each is a share of the largest. The others: see `EdgePolarity.measure`.
    """
    edges, scale = 0, np.full(6, 1e-12)
    for i in range(len(residuals_px)):
        if np.isfinite(residuals_px[i]):
            residuals[edges] = residuals_px[i]
            rows[0, edges], rows[1, edges] = np.sign(gradients[i]) * abs(outward[i]), outward[i]
            for k in range(6):
                rows[2 + k, edges] = jacobian[i, k]
                scale[k] = max(scale[k], abs(jacobian[i, k]))
            edges += 1
    for k in range(6):
        for i in range(edges):
            rows[2 + k, i] /= scale[k]
    return edges


@kernel("f8(f8[::1], f8[::1], f8[::1], f8[:, ::1], f8, f8, f8)")
def _fit_shift(
    gradients: FloatArray, outward: FloatArray, residuals_px: FloatArray, jacobian: FloatArray, doubt: float,
    scatter_px: float, before: float,
) -> float:  # fmt: skip
    """The shift beside `before`, px, of a robust fit of shift, size and pose step, see `EdgePolarity.measure`.

    doubt: information of the prior that there is no shift at all; 0 where nothing can be fitted.
    """
    rows, residuals = np.empty((8, len(residuals_px))), np.empty(len(residuals_px))
    edges = shift_size_and_step(gradients, outward, residuals_px, jacobian, rows, residuals)
    found, matrix = np.zeros(8), np.empty((8, 8))
    rest, weights, pulls = np.empty(edges), np.empty(edges), np.empty(edges)
    for _ in range(2):  # the second time around what the first one found
        leave_rest(rows, residuals, found, rest)
        for i in range(edges):
            weights[i] = 1.0 / (1.0 + (rest[i] / scatter_px) ** 2) ** 2
            pulls[i] = weights[i] * residuals[i]
        add_up_rows(rows, weights, pulls, matrix, found)
        matrix[0, 0] += doubt
        found[0] -= doubt * before  # without evidence there is no shift
        for k in range(1, 8):
            matrix[k, k] += 1e-6
        if not eliminate(matrix, found):
            return 0.0
    return float(found[0])
