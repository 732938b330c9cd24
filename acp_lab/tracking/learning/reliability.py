"""How steadily each edge sample was found so far: a weight per sample and role.

A sample whose image edge jumps about, or is missing again and again (a reflection, an occluder, a pattern
behind it), tells less than one that was always found where the solved pose expected it. Outline and inner
crease are kept apart, as in `contour_offsets`: the same edge behaves differently in the two roles.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from acp_lab.compiled import kernel
from acp_lab.geometry.arrays import BoolArray, FloatArray, IntArray, plain


@dataclass(frozen=True)
class ReliabilityConfig:
    """How steadiness counts.

    Attributes:
        scatter_px: root mean square residual at which a sample has half weight.
        initial_px: what is assumed of a sample not seen before.
        miss_px: what a missing image edge counts as; no residual counts as more.
        rate: share of a new frame in the running mean.
    """

    kind: ClassVar[str] = "on"
    scatter_px: float = 0.4
    initial_px: float = 0.3
    miss_px: float = 1.0
    rate: float = 0.2


class SampleReliability:
    """Running mean square residual of every edge sample, as an inner crease and as an outline."""

    def __init__(self, sample_count: int, config: ReliabilityConfig) -> None:
        self.config = config
        self._mean_square = np.full((sample_count, 2), float(config.initial_px) ** 2)

    def weights(self, ids: IntArray, outline: BoolArray) -> FloatArray:
        """(n,) in (0, 1] for samples `ids` (n,) with `outline` (n,) bool."""
        square = self.config.scatter_px**2
        return square / (square + self._mean_square[ids, outline.astype(np.intp)])

    def learn(self, ids: IntArray, outline: BoolArray, residuals_px: FloatArray) -> None:
        """Take in the residuals (n,) px of a solved frame, NaN where no image edge was found."""
        _learn(
            np.ascontiguousarray(ids), np.ascontiguousarray(outline), plain(residuals_px), self.config.miss_px**2,
            self.config.rate, self._mean_square,
        )  # fmt: skip


@kernel("void(i8[::1], b1[::1], f8[::1], f8, f8, f8[:, ::1])")
def _learn(
    ids: IntArray, outline: BoolArray, residuals_px: FloatArray, worst: float, rate: float, mean_square: FloatArray
) -> None:
    """Move mean_square (samples, 2) on, see `SampleReliability.learn`."""
    for n in range(len(ids)):
        role, square = int(outline[n]), residuals_px[n] * residuals_px[n]
        if not square < worst:
            square = worst
        mean_square[ids[n], role] += rate * (square - mean_square[ids[n], role])
