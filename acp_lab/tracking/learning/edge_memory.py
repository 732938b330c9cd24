"""What each 3D edge sample looked like: a memory that tells its image edge from a neighbour's.

A metal part's reflections move, but from one frame to the next an edge mostly keeps its contrast, its
sign and the grey levels at its two sides. A candidate that agrees with what the sample showed before
counts fully, one that contradicts it is weakened; which weak ones are left out is for the search to say.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from acp_lab.compiled import kernel
from acp_lab.geometry.arrays import BoolArray, FloatArray, IntArray, plain
from acp_lab.imaging.edge_search import Candidates


@dataclass(frozen=True)
class MemoryConfig:
    """How strongly the past counts.

    Attributes:
        rate: share of the new frame in the running means.
        gradient_tolerance: relative change of gradient at which the factor has fallen to its 1-sigma.
        gradient_floor: smallest factor of a candidate whose gradient contradicts the memory.
        grey_tolerance: change of grey level, 0..255, of one standard deviation.
        grey_floor: smallest factor of a candidate whose sides contradict the memory.
        learn_within_px: a sample learns only from an image edge that close to its solved position.
    """

    kind: ClassVar[str] = "on"
    rate: float = 0.4
    gradient_tolerance: float = 0.5
    gradient_floor: float = 0.1
    grey_tolerance: float = 20.0
    grey_floor: float = 0.2
    learn_within_px: float = 1.5


class EdgeMemory:
    """Running means of gradient and side grey levels per 3D edge sample.

    The sides are those of the sample's normal; the caller keeps normals oriented alike from frame to frame.
    """

    def __init__(self, sample_count: int, config: MemoryConfig) -> None:
        self.config = config
        self.known = np.zeros(sample_count, bool)
        self.means = np.zeros((sample_count, 3))

    def factors(self, sample_ids: IntArray, candidates: Candidates) -> FloatArray:
        """(n, m) in (0, 1]: how well each candidate agrees with its sample's past; 1 where there is none of either."""
        config, found = self.config, np.empty_like(candidates.scores)
        _factors(
            np.ascontiguousarray(sample_ids), self.known, self.means, candidates.scores, candidates.gradients,
            candidates.before, candidates.after, config.gradient_tolerance, config.gradient_floor,
            config.grey_tolerance, config.grey_floor, found,
        )  # fmt: skip
        return found

    def learn(self, sample_ids: IntArray, candidates: Candidates, chosen: IntArray, distance_px: FloatArray) -> None:
        """Take in the candidates that the solved pose chose.

        Args:
            sample_ids: (n,).
            chosen: (n,) column of the chosen candidate.
            distance_px: (n,) distance of that candidate from the sample's solved position, NaN where there is none.
        """
        _learn(
            np.ascontiguousarray(sample_ids), candidates.gradients, candidates.before, candidates.after,
            np.ascontiguousarray(chosen), plain(distance_px), self.config.learn_within_px, self.config.rate,
            self.known, self.means,
        )  # fmt: skip


@kernel(
    "void(i8[::1], b1[::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], f8, f8, f8, f8, f8[:, ::1])",
    fastmath=frozenset({"contract"}),
)
def _factors(
    ids: IntArray, known: BoolArray, means: FloatArray, scores: FloatArray, gradients: FloatArray, before: FloatArray,
    after: FloatArray, gradient_tolerance: float, gradient_floor: float, grey_tolerance: float, grey_floor: float,
    found: FloatArray,
) -> None:  # fmt: skip
    """Fill found (n, m), see `EdgeMemory.factors`."""
    for i in range(len(ids)):
        sample = ids[i]
        if not known[sample]:
            found[i] = 1.0
            continue
        gradient = means[sample, 0]
        for k in range(found.shape[1]):
            if scores[i, k] == 0.0:
                found[i, k] = 1.0
                continue
            relative = (gradients[i, k] - gradient) / (abs(gradient) + 1.0) / gradient_tolerance
            by_gradient = gradient_floor + (1.0 - gradient_floor) * np.exp(-0.5 * relative * relative)
            one, other = before[i, k] - means[sample, 1], after[i, k] - means[sample, 2]
            change = 0.5 * (one * one + other * other) / (grey_tolerance * grey_tolerance)
            found[i, k] = by_gradient * (grey_floor + (1.0 - grey_floor) * np.exp(-0.5 * change))


@kernel("void(i8[::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], i8[::1], f8[::1], f8, f8, b1[::1], f8[:, ::1])")
def _learn(
    ids: IntArray, gradients: FloatArray, before: FloatArray, after: FloatArray, chosen: IntArray,
    distance_px: FloatArray, within_px: float, rate: float, known: BoolArray, means: FloatArray,
) -> None:  # fmt: skip
    """Move known and means on, see `EdgeMemory.learn`."""
    for n in range(len(ids)):
        i, k = ids[n], chosen[n]
        if i < 0 or not abs(distance_px[n]) < within_px:
            continue
        share = rate if known[i] else 1.0
        means[i, 0] += share * (gradients[n, k] - means[i, 0])
        means[i, 1] += share * (before[n, k] - means[i, 1])
        means[i, 2] += share * (after[n, k] - means[i, 2])
        known[i] = True
