"""e(I) in all its readings: what a generated edge point pays for its distance to the nearest image edge.

Paper IV-B wants a mean distance in which edge points without an image edge near by count less, since
reflections hide edges. Its formula (eq. 6),

    e(I) = sum 1 / (1 - exp(D - alpha)),

cannot be meant as printed: it has a pole at D = alpha, where it jumps from +infinity to -infinity. So here are the
formula, the readings of it that one may think of, and two robust losses that do what the text says. Each is a pure
function of the distances D (px, not negative) and of alpha (px), and hands back value and derivative.

Solvers take least squares, re-weighted: w(D) = e'(D) / D makes  w D^2 / 2  have the loss's own gradient.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from acp_lab.geometry.arrays import FloatArray

LossForm = Literal["printed", "logistic", "saturating", "geman-mcclure", "tukey"]

# Nearer than this, a point is on its edge; the logistic's gradient does not vanish there and would weigh without end.
_ON_EDGE_PX = 0.25
_TAU_IN_ALPHA = 0.25
_FAR = 30.0


@dataclass(frozen=True)
class LossValues:
    """values: (n,) what each edge point pays; derivatives: (n,) by its distance D, per px."""

    values: FloatArray
    derivatives: FloatArray

    def least_squares_weights(self, distances: FloatArray) -> FloatArray:
        """(n,) weights w with w D = e'(D): one step of re-weighted least squares goes down this loss."""
        return self.derivatives / np.maximum(distances, _ON_EDGE_PX)


def printed(distances: FloatArray, alpha_px: float) -> LossValues:
    """1 / (1 - exp(D - alpha)): eq. 6 as printed, to be looked at, not to be minimised.

    At alpha = 15 px it is +10.5 at D = 14.9 and -9.5 at D = 15.1, and the pole lies between. Below alpha it grows
    with D, as it should, by next to nothing: 3e-7 per px at D = 0. Above alpha it is negative and grows towards 0, so
    the least value of all is the one just above the pole, and an optimiser that ever gets there stays.
    """
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        growth = np.exp(np.minimum(distances - alpha_px, 300.0))
        values = 1.0 / (1.0 - growth)
        return LossValues(values, growth * values * values)


def logistic(distances: FloatArray, alpha_px: float) -> LossValues:
    """1 / (1 + exp(-(D - alpha))): the same with the signs that make it bounded, from 0 on the edge to 1 far away.

    With its slope of 1 per px it is a soft count of the points beyond alpha. Near the edge it is flat (3e-7 per px at
    D = 0 for alpha = 15 px), so it finds the way but cannot fine-tune.
    """
    values = _sigmoid(distances - alpha_px)
    return LossValues(values, values * (1.0 - values))


def saturating(distances: FloatArray, alpha_px: float) -> LossValues:
    """Least squares whose weight fades at alpha: e'(D) = D / (1 + exp((D - alpha) / tau)), tau = alpha / 4.

    What the text around eq. 6 says: near points count with their distance, points beyond alpha with "a lower weight".
    The value is the integral of e' from 0, in closed form with the dilogarithm; it levels out at about alpha^2 / 2.
    """
    from scipy.special import spence

    tau = _TAU_IN_ALPHA * alpha_px
    # Beyond 30 tau nothing is added any more, and exp would overflow.
    near = np.minimum(distances, alpha_px + _FAR * tau)
    scaled = (near - alpha_px) / tau

    def area_of_rest(d: FloatArray, u: FloatArray) -> FloatArray:
        return d * tau * np.logaddexp(0.0, u) + tau * tau * spence(1.0 + np.exp(u))

    start = area_of_rest(np.zeros(1), np.full(1, -alpha_px / tau))
    values = 0.5 * near * near - (area_of_rest(near, scaled) - start)
    return LossValues(values, distances * _sigmoid((alpha_px - distances) / tau))


def geman_mcclure(distances: FloatArray, alpha_px: float) -> LossValues:
    """alpha^2 / 2 * D^2 / (D^2 + alpha^2): quadratic on the edge, never above alpha^2 / 2 (Geman and McClure 1987)."""
    square, scale = distances * distances, alpha_px * alpha_px
    share = scale / (square + scale)
    return LossValues(0.5 * square * share, distances * share * share)


def tukey(distances: FloatArray, alpha_px: float) -> LossValues:
    """alpha^2 / 6 * (1 - (1 - (D / alpha)^2)^3) up to alpha, constant beyond (Tukey's biweight).

    Points beyond alpha have no say at all.
    """
    inside = np.maximum(1.0 - (distances / alpha_px) ** 2, 0.0)
    return LossValues(alpha_px**2 / 6.0 * (1.0 - inside**3), distances * inside * inside)


_LOSSES: dict[str, Callable[[FloatArray, float], LossValues]] = {
    "printed": printed,
    "logistic": logistic,
    "saturating": saturating,
    "geman-mcclure": geman_mcclure,
    "tukey": tukey,
}
LOSS_FORMS: tuple[str, ...] = get_args(LossForm)


def edge_loss(form: LossForm, distances: FloatArray, alpha_px: float) -> LossValues:
    """The loss named `form` of distances (n,) px; alpha_px above 0."""
    return _LOSSES[form](distances, alpha_px)


def reference_bce(generated: FloatArray, target: FloatArray) -> LossValues:
    """The authors' public code instead compares images: binary cross entropy of a generated and a captured edge image.

    It needs no distances, and sees no edge that is more than a stroke's width away.

    Args:
        generated: (...) belief in [0, 1] per pixel.
        target: (...) 1 on edges, 0 elsewhere.

    Returns:
        Value per pixel, and its derivative by the generated belief.
    """
    belief = np.clip(generated, 1e-6, 1.0 - 1e-6)
    values = -(target * np.log(belief) + (1.0 - target) * np.log(1.0 - belief))
    return LossValues(values, (belief - target) / (belief * (1.0 - belief)))


def _sigmoid(x: FloatArray) -> FloatArray:
    # Through tanh, which does not overflow.
    return 0.5 * (1.0 + np.tanh(0.5 * x))
