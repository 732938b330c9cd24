"""The matrices of `kalman`, which are too small for one call of NumPy each.

With covariance C (12, 12) of a pose step and its velocity, C_p its first six columns, P = (C_pp)^-1 the prior's
information, and Q the information of prior and image together, a frame gives::

    gain K = C_p P,    C' = C - K (C_pp - Q^-1) K^T
"""

from __future__ import annotations

import numpy as np

from acp_lab.compiled import kernel
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose_kernels import invert


@kernel("void(f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[::1], f8[::1], f8[:, ::1])")
def take_in(
    covariance: FloatArray, prior: FloatArray, both: FloatArray, off: FloatArray, velocity: FloatArray,
    updated: FloatArray,
) -> None:  # fmt: skip
    """Fill updated (12, 12) with C', and move the velocity (6,) by what a frame `off` (6,) the prediction says of it.

    covariance: C; prior: (6, 6), P; both: (6, 6), Q.
    """
    posterior, gain, narrowed = np.empty((6, 6)), np.empty((12, 6)), np.empty((12, 6))
    invert(both, posterior)
    for i in range(12):
        for k in range(6):
            gain[i, k] = 0.0
            for j in range(6):
                gain[i, k] += covariance[i, j] * prior[j, k]
    for i in range(12):
        for k in range(6):
            narrowed[i, k] = 0.0
            for j in range(6):
                narrowed[i, k] += gain[i, j] * (covariance[j, k] - posterior[j, k])
    for i in range(12):
        for k in range(i + 1):
            less = 0.0
            for j in range(6):
                less += 0.5 * (narrowed[i, j] * gain[k, j] + narrowed[k, j] * gain[i, j])
            updated[i, k] = updated[k, i] = 0.5 * (covariance[i, k] + covariance[k, i]) - less
    for i in range(6):
        for j in range(6):
            velocity[i] += gain[6 + i, j] * off[j]


@kernel("void(f8[:, ::1], f8[::1], f8[:, ::1])")
def go_on(covariance: FloatArray, variance: FloatArray, ahead: FloatArray) -> None:
    """Fill ahead (12, 12): the covariance a frame later, the pose moved on by its velocity.

    variance: (6,) of accelerations that last a frame: a quarter of it in the pose, half between pose and velocity.
    """
    for i in range(6):
        for k in range(6):
            pose, speed = covariance[i, k] + covariance[6 + i, k], covariance[i, 6 + k] + covariance[6 + i, 6 + k]
            ahead[i, k], ahead[i, 6 + k] = pose + speed, speed
            ahead[6 + i, k] = covariance[6 + i, k] + covariance[6 + i, 6 + k]
            ahead[6 + i, 6 + k] = covariance[6 + i, 6 + k]
    for i in range(6):
        ahead[i, i] += 0.25 * variance[i]
        ahead[i, 6 + i] += 0.5 * variance[i]
        ahead[6 + i, i] += 0.5 * variance[i]
        ahead[6 + i, 6 + i] += variance[i]
