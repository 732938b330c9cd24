"""Gauss-Newton on the pose, damped in control-point pixels."""

from __future__ import annotations

import numpy as np


def gauss_newton_step(
    jacobian: np.ndarray,
    residuals: np.ndarray,
    weights: np.ndarray,
    control_jacobian: np.ndarray,
    damping: float,
) -> np.ndarray:
    """The pose step (6,) that minimises  sum w (r - J s)^2 / sum w + damping |J_cp s|^2.

    Args:
        jacobian: (n, 6).
        residuals: (n,) px still to go along the normals.
        weights: (n,) not negative.
        control_jacobian: (8, 6) of the image control points.
        damping: mu, per squared px of control-point motion.

    Returns:
        (6,); zeros where nothing has weight or the system is singular.
    """
    total = float(weights.sum())
    if not total > 0.0:
        return np.zeros(6)
    weighted = jacobian * weights[:, None]
    hessian = weighted.T @ jacobian / total + damping * (control_jacobian.T @ control_jacobian)
    try:
        return np.linalg.solve(hessian, weighted.T @ residuals / total)
    except np.linalg.LinAlgError:  # nothing tells some direction, and there is no damping
        return np.zeros(6)
