"""What each 3D edge sample looked like: a memory that tells its image edge from a neighbour's.

A metal part's reflections move, but from one frame to the next an edge mostly keeps its contrast, its
sign and the grey levels at its two sides. A candidate that agrees with what the sample showed before
counts fully, one that contradicts it is weakened, never excluded.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from acp_lab.geometry.arrays import FloatArray, IntArray
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
        """(n, m) in (0, 1]: how well each candidate agrees with its sample's past; 1 where there is none."""
        if not self.known.any():
            return np.ones_like(candidates.scores)
        config = self.config
        gradient, before, after = self.means[sample_ids].T[..., None]
        relative = (candidates.gradients - gradient) / (np.abs(gradient) + 1.0)
        by_gradient = config.gradient_floor + (1.0 - config.gradient_floor) * np.exp(
            -0.5 * (relative / config.gradient_tolerance) ** 2
        )
        change_sq = 0.5 * ((candidates.before - before) ** 2 + (candidates.after - after) ** 2)
        by_grey = config.grey_floor + (1.0 - config.grey_floor) * np.exp(-0.5 * change_sq / config.grey_tolerance**2)
        return np.where(self.known[sample_ids, None], by_gradient * by_grey, 1.0)

    def learn(
        self, sample_ids: IntArray, candidates: Candidates, chosen: IntArray, distance_px: FloatArray
    ) -> None:
        """Take in the candidates that the solved pose chose.

        Args:
            sample_ids: (n,).
            chosen: (n,) column of the chosen candidate.
            distance_px: (n,) distance of that candidate from the sample's solved position.
        """
        rows = np.flatnonzero((np.abs(distance_px) < self.config.learn_within_px) & (sample_ids >= 0))
        ids, columns = sample_ids[rows], chosen[rows]
        seen = np.stack(
            [
                candidates.gradients[rows, columns],
                candidates.before[rows, columns],
                candidates.after[rows, columns],
            ],
            1,
        )
        rate = np.where(self.known[ids], self.config.rate, 1.0)[:, None]
        self.means[ids] += rate * (seen - self.means[ids])
        self.known[ids] = True
