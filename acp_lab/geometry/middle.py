"""The median of a few numbers, for loops that ask often: `numpy.median` takes many times as long over some dozens."""

from __future__ import annotations

import numpy as np

from acp_lab.compiled import kernel
from acp_lab.geometry.arrays import FloatArray


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
