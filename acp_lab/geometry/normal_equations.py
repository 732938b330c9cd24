"""Sums over a few hundred edges for small robust fits, in compiled loops.

Unknowns have a row each, of how every edge's residual follows them. So sums go along rows, and a processor adds several
edges at a time.
"""

from __future__ import annotations

import numpy as np

from acp_lab.compiled import kernel
from acp_lab.geometry.arrays import FloatArray

_ANY_ORDER = frozenset({"contract", "reassoc"})


@kernel("void(f8[:, ::1], f8[::1], f8[::1], f8[::1])", fastmath=_ANY_ORDER)
def leave_rest(rows: FloatArray, residuals: FloatArray, step: FloatArray, rest: FloatArray) -> None:
    """Fill rest (n,): residuals (at least n,) less what a step (k,) explains; rows: (k, at least n)."""
    count = len(rest)
    for i in range(count):
        rest[i] = residuals[i]
    for k in range(len(step)):
        row, by = rows[k, :count], step[k]
        for i in range(count):
            rest[i] -= row[i] * by


@kernel("void(f8[:, ::1], f8[::1], f8[::1], f8[:, ::1], f8[::1])", fastmath=_ANY_ORDER)
def add_up_rows(
    rows: FloatArray, weights: FloatArray, pulls: FloatArray, matrix: FloatArray, vector: FloatArray
) -> None:
    """Fill matrix (k, k) and vector (k,) of the normal equations of n edges.

    rows: (k, at least n); weights: (n,); pulls: (n,) weights times residuals.
    """
    count = len(weights)
    weighted = np.empty_like(weights)
    for k in range(len(vector)):
        row, total = rows[k, :count], 0.0
        for i in range(count):
            weighted[i] = weights[i] * row[i]
            total += row[i] * pulls[i]
        vector[k] = total
        for j in range(k + 1):
            other, total = rows[j, :count], 0.0
            for i in range(count):
                total += weighted[i] * other[i]
            matrix[k, j] = matrix[j, k] = total
