"""argmin e (paper eq. 7) over eight coordinates or six: Gauss-Newton, Levenberg-Marquardt, Adam.

e is a mean of robust losses over edge points. For the first two it is re-weighted least squares: every edge point has a
residual r (px still to go), a direction d in the image and a weight w; with J the motion of the point by the variables,

    minimise  sum w (r - d.J s)^2 / sum w  +  prior          for the step s,

damped by Marquardt's multiple of the diagonal, which is blind to units: pixels, radians and millimetres are treated
alike (the unit problem of paper Fig. 1). Adam follows the same gradient, one rate for every variable.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from acp_lab.errors import GeometryError
from acp_lab.generator.base import GeneratedEdges
from acp_lab.tracking.motions import Motion

SolverName = Literal["gauss-newton", "levenberg-marquardt", "adam"]

_TINY = 1e-9
_LM_UP, _LM_DOWN, _LM_TRIES = 8.0, 0.3, 4


@dataclass(frozen=True)
class Measurement:
    """What the frame says about n edge points.

    Attributes:
        residuals: (n,) px still to go along `directions` (n, 2).
        weights: (n,) of the least squares, not negative.
        losses: (n,) e per point; shares: (n,) how much each point counts in the mean.
    """

    residuals: np.ndarray
    directions: np.ndarray
    weights: np.ndarray
    losses: np.ndarray
    shares: np.ndarray

    @property
    def loss(self) -> float:
        """e: the mean over the edge points."""
        total = float(self.shares.sum())
        return float(self.losses @ self.shares) / total if total > 0.0 else float("inf")


Measure = Callable[[GeneratedEdges], Measurement]


class Prior(Protocol):
    """A quadratic wish about the variables, in px: weight * |residual - jacobian s|^2."""

    @property
    def weight(self) -> float:
        """Per squared px."""
        ...

    def residual(self, variables: np.ndarray) -> np.ndarray:
        """(m,) px still to go."""
        ...

    @property
    def jacobian(self) -> np.ndarray:
        """(m, k)."""
        ...


@dataclass(frozen=True)
class SolverConfig:
    """How e(I) is minimised on one level.

    Attributes:
        name: of the solver.
        steps: on one level.
        damping: Marquardt's multiple of the diagonal (the first one, for Levenberg-Marquardt).
        rate: Adam's step in px of the control points, at first; it falls to a tenth over the steps.
    """

    name: SolverName = "gauss-newton"
    steps: int = 4
    damping: float = 1e-3
    rate: float = 0.5


@dataclass(frozen=True)
class Iterate:
    """Variables after a step, and e there (before the step, for solvers that do not look again)."""

    variables: np.ndarray
    loss: float


def minimise(
    motion: Motion,
    measure: Measure,
    start: np.ndarray,
    config: SolverConfig,
    prior: Prior | None = None,
    scale: np.ndarray | None = None,
) -> tuple[Iterate, ...]:
    """The iterates of one level, the last one being the result; a step into a degenerate I ends the level.

    Args:
        start: variables, (4, 2) px or (4, 4) pose.
        scale: (k,) variables per px, for Adam; default 1, right for control points.
    """
    if config.name == "levenberg-marquardt":
        return _levenberg_marquardt(motion, measure, start, config, prior)
    rule = _GaussNewton(config) if config.name == "gauss-newton" else _Adam(config, scale)
    return _descend(motion, measure, start, config.steps, rule, prior)


@dataclass(frozen=True)
class _Normal:
    """Normal equations H s = g of one linearisation, and e there."""

    hessian: np.ndarray
    gradient: np.ndarray
    loss: float

    def step(self, damping: float) -> np.ndarray:
        diagonal = np.diagonal(self.hessian)
        damped = self.hessian + np.diag(damping * diagonal + _TINY * diagonal.max(initial=1.0))
        try:
            return np.linalg.solve(damped, self.gradient)
        except np.linalg.LinAlgError:
            return np.zeros(len(self.gradient))


def _normal_equations(motion: Motion, measure: Measure, variables: np.ndarray, prior: Prior | None) -> _Normal:
    edges, jacobian = motion.linearised(variables)
    seen = measure(edges)
    rows = np.einsum("nj,njk->nk", seen.directions, jacobian)
    # Points whose motion is not known (behind the camera, no clear ridge) say nothing.
    good = np.isfinite(rows).all(1) & np.isfinite(seen.residuals)
    rows, residuals, weights = rows[good], seen.residuals[good], seen.weights[good]
    total = max(float(weights.sum()), _TINY)
    weighted = rows * (weights / total)[:, None]
    hessian, gradient, loss = weighted.T @ rows, weighted.T @ residuals, seen.loss
    if prior is not None:
        wish, by = prior.residual(variables), prior.jacobian
        hessian, gradient = hessian + prior.weight * by.T @ by, gradient + prior.weight * by.T @ wish
        loss += 0.5 * prior.weight * float(wish @ wish)
    return _Normal(hessian, gradient, loss)


def _descend(
    motion: Motion, measure: Measure, start: np.ndarray, steps: int, rule: _GaussNewton | _Adam, prior: Prior | None
) -> tuple[Iterate, ...]:
    """Step by the rule, without asking whether e fell; stays at the start where the steps lead nowhere."""
    variables, iterates = start, []
    try:
        for _ in range(steps):
            normal = _normal_equations(motion, measure, variables, prior)
            iterates.append(Iterate(variables, normal.loss))
            variables = motion.moved(variables, rule.step(normal))
        if np.isfinite(motion.edges(variables).points).all():
            return (*iterates[1:], Iterate(variables, iterates[-1].loss))
    except GeometryError:  # I became degenerate: what came before it still counts
        pass
    return tuple(iterates) or (Iterate(start, float("inf")),)


class _GaussNewton:
    def __init__(self, config: SolverConfig) -> None:
        self._damping = config.damping

    def step(self, normal: _Normal) -> np.ndarray:
        return normal.step(self._damping)


class _Adam:
    """Adam (Kingma and Ba 2015) with its usual constants; the rate falls as a cosine, to a tenth."""

    def __init__(self, config: SolverConfig, scale: np.ndarray | None) -> None:
        self._config = config
        self._scale: np.ndarray | float = 1.0 if scale is None else scale
        self._mean: np.ndarray | float = 0.0
        self._square: np.ndarray | float = 0.0
        self._count = 0

    def step(self, normal: _Normal) -> np.ndarray:
        downhill = normal.gradient * self._scale
        rate = self._config.rate * (0.55 + 0.45 * np.cos(np.pi * self._count / self._config.steps))
        self._count += 1
        self._mean = 0.9 * self._mean + 0.1 * downhill
        self._square = 0.999 * self._square + 0.001 * downhill**2
        mean, square = self._mean / (1.0 - 0.9**self._count), self._square / (1.0 - 0.999**self._count)
        step: np.ndarray = self._scale * rate * mean / (np.sqrt(square) + 1e-12)
        return step


def _levenberg_marquardt(
    motion: Motion, measure: Measure, start: np.ndarray, config: SolverConfig, prior: Prior | None
) -> tuple[Iterate, ...]:
    def loss_at(variables: np.ndarray) -> float:
        try:
            loss = measure(motion.edges(variables)).loss
        except GeometryError:
            return float("inf")
        if prior is not None:
            wish = prior.residual(variables)
            loss += 0.5 * prior.weight * float(wish @ wish)
        return loss

    variables, damping = start, config.damping
    iterates = [Iterate(start, float("inf"))]
    for _ in range(config.steps):
        try:
            normal = _normal_equations(motion, measure, variables, prior)
        except GeometryError:
            break
        for _ in range(_LM_TRIES):
            tried = motion.moved(variables, normal.step(damping))
            loss = loss_at(tried)
            if loss < normal.loss:
                variables, damping = tried, max(damping * _LM_DOWN, 1e-8)
                break
            damping *= _LM_UP
        else:
            break  # no shorter step helps: this is the minimum
        iterates.append(Iterate(variables, loss))
    return tuple(iterates[1:]) or (Iterate(start, loss_at(start)),)
