"""Confidence intervals for a share of frames over a few sequences.

Frames of one sequence are not independent. Sequences are therefore drawn with replacement, and within each of them
blocks of consecutive frames: a hierarchical block bootstrap. Blocks run on from the last frame to the first, so that
every frame is drawn equally often.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from acp_lab.errors import AcpLabError
from acp_lab.geometry.arrays import FloatArray

BLOCK_FRAMES = 10


@dataclass(frozen=True)
class Interval:
    """A mean over sequences with its 95% bootstrap interval."""

    mean: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.mean:.2f} [{self.low:.2f}, {self.high:.2f}]"


def bootstrap_mean(sequences: Sequence[FloatArray], draws: int = 2000, seed: int = 0) -> Interval:
    """Mean over sequences of the mean over frames.

    Args:
        sequences: one (n,) array per sequence, such as 1.0 where a frame was within 2%.

    Raises:
        AcpLabError: there is no sequence, or one without frames.
    """
    if not sequences or min(map(len, sequences)) == 0:
        raise AcpLabError("bootstrap: no sequence, or one without frames: give sequences with frames")
    rng = np.random.default_rng(seed)
    means = np.empty((draws, len(sequences)))
    for column, frames in enumerate(sequences):
        length = min(BLOCK_FRAMES, len(frames))
        blocks = -(-len(frames) // length)
        starts = rng.integers(0, len(frames), (draws, blocks))
        # Without the wrap few blocks would reach the ends, and frames in the middle would count more.
        rows = (starts[:, :, None] + np.arange(length)).reshape(draws, -1)[:, : len(frames)] % len(frames)
        means[:, column] = frames[rows].mean(1)
    picked = rng.integers(0, len(sequences), (draws, len(sequences)))
    drawn = np.take_along_axis(means, picked, 1).mean(1)
    low, high = np.quantile(drawn, [0.025, 0.975])
    return Interval(float(np.mean([frames.mean() for frames in sequences])), float(low), float(high))
