"""Medians and percentiles for who asks often: NumPy takes many times as long over some dozens of numbers, and sorts."""

from __future__ import annotations

import numpy as np

from acp_lab.compiled import kernel
from acp_lab.geometry.arrays import FloatArray, IntArray


@kernel("f8(f8[::1])")
def median(values: FloatArray) -> float:
    """Of (n,), as `numpy.median`: the mean of the two in the middle of an even number; NaN of none, or where one is."""
    count = len(values)
    if count == 0:
        return np.nan
    ordered = np.sort(values)
    # NaN comes last.
    if np.isnan(ordered[count - 1]):
        return np.nan
    return float(ordered[count // 2]) if count % 2 else (ordered[count // 2 - 1] + ordered[count // 2]) / 2.0


def counted_percentiles(counts: IntArray, ranks: FloatArray) -> FloatArray:
    """(r,) those of ranks (r,), 0 to 100, of whole numbers from 0 of which each is there counts (k,) times.

    As `numpy.percentile` gives them, without sorting.
    """
    last = counts.sum() - 1
    places = ranks / 100.0 * last
    below = np.floor(places)
    up_to = np.cumsum(counts)
    low, high = (np.searchsorted(up_to, np.minimum(below + k, last), side="right") for k in (0, 1))
    found: FloatArray = low + (places - below) * (high - low)
    return found
