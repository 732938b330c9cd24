"""The loss e(I) on edge points: soft assignment to image edges, saturating with distance.

In paper IV-B a generated edge point whose image edge is further than alpha counts less, because that
edge is probably missing (its e(I), eq. 6). Here the weight of candidate k of point i is

    p_ik = score_ik exp(-(d_ik / sigma)^2 / 2),      w_i = sum_k p_ik / (sum_k p_ik + outlier)

so a point without a near, well-contrasted image edge drops out smoothly, and several candidates share
it. Sigma plays the part of alpha and is lowered from level to level. (Deviation: eq. 6 as printed has
a pole at distance alpha and cannot be minimised; see docs/paper-ledger.md.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acp_lab.compiled import kernel
from acp_lab.geometry.arrays import FloatArray


@dataclass(frozen=True)
class Assignment:
    """What the candidates of each edge point say together.

    Attributes:
        residuals: (n,) px still to go along the normal, the mean over candidates.
        weights: (n,) in [0, 1).
        mass: (n,) sum of p_ik over the candidates.
    """

    residuals: FloatArray
    weights: FloatArray
    mass: FloatArray


def soft_assignment(distances: FloatArray, scores: FloatArray, sigma_px: float, outlier: float) -> Assignment:
    """Residual and weight per edge point.

    Args:
        distances: (n, m) px along the normal from the edge point to its candidates.
        scores: (n, m) in [0, 1]; 0 where there is no candidate.
        sigma_px: width of the capture range.
        outlier: mass of "no image edge belongs here"; above 0.
    """
    found = np.empty((3, len(distances)))
    _assign(np.ascontiguousarray(distances), np.ascontiguousarray(scores), sigma_px, outlier, found)
    return Assignment(*found)


@kernel("void(f8[:, ::1], f8[:, ::1], f8, f8, f8[:, ::1])")
def _assign(distances: FloatArray, scores: FloatArray, sigma_px: float, outlier: float, found: FloatArray) -> None:
    """Fill found (3, n): the fields of `Assignment`."""
    for i in range(len(distances)):
        total, moment = 0.0, 0.0
        for k in range(distances.shape[1]):
            if scores[i, k] != 0.0:
                mass = scores[i, k] * np.exp(-0.5 * (distances[i, k] / sigma_px) ** 2)
                total += mass
                moment += mass * distances[i, k]
        found[0, i] = moment / max(total, 1e-12)
        found[1, i] = total / (total + outlier)
        found[2, i] = total


def robust_loss(distances: FloatArray, scores: FloatArray, sigma_px: float, outlier: float) -> float:
    """e(I) as it is reported: mean over edge points of -log((sum_k p_ik + outlier) / (1 + outlier)).

    0 for a perfect fit: of several candidates that share a point no more than 1 counts.
    """
    return mixture_loss((scores * np.exp(-0.5 * (distances / sigma_px) ** 2)).sum(1), outlier)


def negative_log_likelihood(mass: FloatArray, trust: FloatArray, outlier: float) -> float:
    """Whose expectation-maximisation step `soft_assignment` is, of the candidates' total mass (n,) and trust (n,).

    Mean over edge points of -trust log((mass + outlier) / (1 + outlier)), which falls on where the mass is above 1.
    Without points, that of an edge not found.
    """
    if len(mass) == 0:
        return mixture_loss(mass, outlier)
    return float(trust @ (np.log1p(outlier) - np.log(mass + outlier))) / len(mass)


def mixture_loss(mass: FloatArray, outlier: float) -> float:
    """`robust_loss` of the candidates' total mass (n,) per edge point; without points, that of an edge not found."""
    if len(mass) == 0:
        return float(np.log1p(outlier) - np.log(outlier))
    return float(_mean_log_share(mass, outlier))


@kernel("f8(f8[::1], f8)")
def _mean_log_share(mass: FloatArray, outlier: float) -> float:
    """Mean over n points of the negative log of their mass (n,), at most 1, with the outliers', as a share of both."""
    total = 0.0
    for each in mass:
        total += np.log1p(outlier) - np.log(min(each, 1.0) + outlier)
    return total / len(mass)
