"""Confidence intervals for a share of frames over a few sequences.

Frames of one sequence are not independent, and neither are runs on it from several starts, which see the same frames.
Sequences are therefore drawn with replacement, and within each of them its runs, and blocks of consecutive frames that
are the same for all its runs: a hierarchical block bootstrap. Blocks run on from the last frame to the first, so that
every frame is drawn equally often.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

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
    """Mean over sequences of the mean over runs and frames.

    Args:
        sequences: one (n,) array per sequence, such as 1.0 where a frame was within 2%; (runs, n) of a sequence with
            several runs, such as from other starts.

    Raises:
        AcpLabError: there is no sequence, or one without frames.
    """
    if not sequences or min(frames.size for frames in sequences) == 0:
        raise AcpLabError("bootstrap: no sequence, or one without frames: give sequences with frames")
    rng = np.random.default_rng(seed)
    means = np.stack([_drawn_means(np.atleast_2d(frames), draws, rng) for frames in sequences], axis=1)
    picked = rng.integers(0, len(sequences), (draws, len(sequences)))
    # A sequence that is drawn twice has its runs and blocks drawn twice: each place takes those of another draw.
    others = (np.arange(draws)[:, None] + np.arange(len(sequences))) % draws
    drawn = means[others, picked].mean(1)
    low, high = np.quantile(drawn, [0.025, 0.975])
    return Interval(float(np.mean([frames.mean() for frames in sequences])), float(low), float(high))


def _drawn_means(runs: FloatArray, draws: int, rng: np.random.Generator) -> FloatArray:
    """(draws,) means over the runs (r, n) of a sequence: as many runs are drawn, and blocks of as many frames."""
    number, count = runs.shape
    length = min(BLOCK_FRAMES, count)
    blocks = -(-count // length)
    starts = rng.integers(0, count, (draws, blocks))
    times = rng.multinomial(number, np.full(number, 1.0 / number), draws)
    whole = _block_sums(runs, length)
    last = _block_sums(runs, count - (blocks - 1) * length)  # cut, so that as many frames are drawn as there are
    sums = [of[starts[:, :-1]].sum(1) + end[starts[:, -1]] for of, end in zip(whole, last, strict=True)]
    return np.asarray((times * np.stack(sums, axis=1)).sum(1) / runs.size)


def _block_sums(runs: FloatArray, length: int) -> FloatArray:
    """(r, n) sums of so many frames from each on; without the wrap frames in the middle would count more."""
    around = np.concatenate([runs, runs[:, : length - 1]], axis=1)
    return np.asarray(sliding_window_view(around, length, axis=1).sum(-1))
