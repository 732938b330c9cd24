"""argmin e (paper eq. 7) over eight coordinates or six: Gauss-Newton, Levenberg-Marquardt, Adam.

e is a sum of measures of the frame, each over edge points, and of quadratic priors. With J the motion of a point
along its direction by the variables, r the residual (px still to go), w a weight and p the measure's precision
(information of an edge point of full weight, per squared px), one step s minimises::

    sum over measures of  p sum w (r - J s)^2 / N   +   sum over priors of  v |r_p - J_p s|^2,      N = sum of p w

so that damping, which is relative to what an edge point says, needs no scale, while priors with an information of
their own divide it by N. Gauss-Newton and Levenberg-Marquardt add Marquardt's multiple of the diagonal, which is
blind to units: pixels, radians and millimetres are treated alike (the unit problem of paper Fig. 1). Adam follows the
same gradient, one rate for every variable. Solvers know nothing of images.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np

from acp_lab.compiled import kernel
from acp_lab.errors import GeometryError, TrackingError
from acp_lab.generator.base import GeneratedEdges
from acp_lab.geometry.arrays import FloatArray
from acp_lab.tracking.frame_view import Estimate
from acp_lab.tracking.motions import Beside, Motion, Rows

_TINY = 1e-9
_LM_UP, _LM_DOWN, _LM_TRIES = 8.0, 0.3, 4
MOST_STEPS = 1000
"""Per level; more is a slip of the pen."""


class Measurement(Protocol):
    """What the frame says about n edge points.

    Attributes:
        residuals: (n,) px still to go along `directions` (n, 2).
        weights: (n,) of the least squares, not negative.
        loss: e, the mean over the edge points.
    """

    @property
    def residuals(self) -> FloatArray: ...
    @property
    def directions(self) -> FloatArray: ...
    @property
    def weights(self) -> FloatArray: ...
    @property
    def loss(self) -> float: ...


@dataclass(frozen=True)
class WeightedMeasure:
    """A measure of edge points, and its precision: information of a point of full weight, per squared px."""

    measure: Callable[[GeneratedEdges], Measurement]
    precision: float = 1.0

    def information(self, edges: GeneratedEdges, rows_along: Rows) -> Information:
        """What it says of the variables, for edge points that move by `rows_along` (see `motions.Rows`)."""
        seen = self.measure(edges)
        rows, residuals, weights = (
            np.ascontiguousarray(values, np.float64)
            for values in (rows_along(seen.directions), seen.residuals, seen.weights)
        )
        count = rows.shape[1]
        matrix, vector = np.zeros((count, count)), np.zeros(count)
        total = _add_up(rows, residuals, weights, self.precision, matrix, vector)
        return Information(matrix, vector, total)


@dataclass(frozen=True)
class Information:
    """What a frame says of the variables at one linearisation.

    Attributes:
        matrix: (k, k) sum of p w J^T J; vector: (k,) sum of p w J^T r.
        total: sum of p w, per squared px.
    """

    matrix: FloatArray
    vector: FloatArray
    total: float

    def __add__(self, other: Information) -> Information:
        return Information(self.matrix + other.matrix, self.vector + other.vector, self.total + other.total)


class Prior(Protocol):
    """A quadratic prior on the variables."""

    def equations(self, at: Estimate, total: float) -> NormalEquations:
        """Its share of the normal equations at an estimate; total: of the frame's `Information`."""
        ...

    def loss(self, at: Estimate, total: float) -> float:
        """Half of its weighted squared residual at an estimate, relative to that total as its equations are."""
        ...


@dataclass(frozen=True)
class Problem:
    """What is minimised on one level. scale: of each variable per px, for solvers with one rate."""

    motion: Motion
    measures: Sequence[WeightedMeasure]
    priors: Sequence[Prior] = ()
    scale: FloatArray | float = 1.0

    def loss(self, at: Estimate) -> float:
        """e at an estimate, priors included; infinite where it is degenerate.

        The mean over the measures by their precision, as if every edge point had full weight: robust weights change
        from estimate to estimate, and e is to be compared between these.
        """
        precision = sum(measure.precision for measure in self.measures)
        try:
            edges = self.motion.edges(at)
            prior = sum(prior.loss(at, max(precision * len(edges), _TINY)) for prior in self.priors)
        except GeometryError:
            return float("inf")
        return sum(m.precision * m.measure(edges).loss for m in self.measures) / precision + prior

    def information(self, at: Estimate, beside: Beside | None = None) -> Information:
        """What the frame says at an estimate, without priors; GeometryError where it is degenerate.

        beside: of unknowns beside the variables, which come after these.
        """
        edges, of_variables = self.motion.linearised(at)

        def rows_along(directions: FloatArray) -> FloatArray:
            rows = of_variables(directions)
            return rows if beside is None else np.hstack([rows, beside(edges, directions)])

        first, *others = [measure.information(edges, rows_along) for measure in self.measures]
        return sum(others, first)

    def normal_equations(self, at: Estimate) -> NormalEquations:
        """Those of one linearisation; GeometryError where the estimate is degenerate."""
        seen = self.information(at)
        total = max(seen.total, _TINY)
        image = NormalEquations(seen.matrix / total, seen.vector / total)
        return sum((prior.equations(at, total) for prior in self.priors), image)


@dataclass(frozen=True)
class NormalEquations:
    """H s = d of one linearisation: hessian (k, k), and downhill (k,), which is minus the gradient of e."""

    hessian: FloatArray
    downhill: FloatArray

    def __add__(self, other: NormalEquations) -> NormalEquations:
        return NormalEquations(self.hessian + other.hessian, self.downhill + other.downhill)

    def step(self, damping: float) -> FloatArray:
        """The step (k,), damped by a multiple of the diagonal; zeros where a direction is unobserved and undamped."""
        hessian = self.hessian
        if damping > 0.0:
            diagonal = np.diagonal(hessian)
            hessian = hessian + np.diag(damping * diagonal + _TINY * diagonal.max(initial=1.0))
        try:
            return np.asarray(np.linalg.solve(hessian, self.downhill), np.float64)
        except np.linalg.LinAlgError:
            return np.zeros(len(self.downhill))


@dataclass(frozen=True)
class GaussNewton:
    """Configuration.

    Attributes:
        steps: on one level, at most.
        damping: Marquardt's multiple of the diagonal, 0 for none.
        last_px: a step that moves the part's rim by less is a level's last; 0 for always all steps.
    """

    kind: ClassVar[str] = "gauss-newton"
    steps: int = 4
    damping: float = 1e-3
    last_px: float = 0.0

    def __post_init__(self) -> None:
        _check(self.steps, self.damping)
        if not self.last_px >= 0.0:
            raise TrackingError(f"solver.last_px = {self.last_px:g}: give px, 0 or more")

    def minimise(self, problem: Problem, start: Estimate) -> tuple[Estimate, ...]:
        """See `minimise`."""
        return _descend(problem, start, self.steps, lambda equations, _: equations.step(self.damping), self.last_px)


@dataclass(frozen=True)
class LevenbergMarquardt:
    """steps: on one level; damping: Marquardt's multiple of the diagonal at first, lowered and raised by success."""

    kind: ClassVar[str] = "levenberg-marquardt"
    steps: int = 4
    damping: float = 1e-3

    def __post_init__(self) -> None:
        _check(self.steps, self.damping)

    def minimise(self, problem: Problem, start: Estimate) -> tuple[Estimate, ...]:
        """See `minimise`."""
        at, damping, loss = start, self.damping, problem.loss(start)
        iterates = []
        for _ in range(self.steps):
            try:
                equations = problem.normal_equations(at)
            except GeometryError:
                break
            for _ in range(_LM_TRIES):
                tried = problem.motion.moved(at, equations.step(damping))
                tried_loss = problem.loss(tried)
                if tried_loss < loss:
                    at, loss, damping = tried, tried_loss, max(damping * _LM_DOWN, 1e-8)
                    break
                damping *= _LM_UP
            else:
                break  # no shorter step helps: this is the minimum
            iterates.append(at)
        return tuple(iterates)


@dataclass(frozen=True)
class Adam:
    """steps: on one level; rate: px of the control points at first, falling as a cosine to a tenth over the steps.

    Adam (Kingma and Ba 2015) with its usual constants.
    """

    kind: ClassVar[str] = "adam"
    steps: int = 4
    rate: float = 0.5

    def __post_init__(self) -> None:
        _check(self.steps, 0.0)
        if not self.rate > 0.0:
            raise TrackingError(f"solver.rate = {self.rate:g}: give px above 0")

    def minimise(self, problem: Problem, start: Estimate) -> tuple[Estimate, ...]:
        """See `minimise`."""
        mean: FloatArray | float = 0.0
        square: FloatArray | float = 0.0

        def rule(equations: NormalEquations, number: int) -> FloatArray:
            nonlocal mean, square
            downhill = equations.downhill * problem.scale
            rate = self.rate * (0.55 + 0.45 * np.cos(np.pi * number / self.steps))
            mean, square = 0.9 * mean + 0.1 * downhill, 0.999 * square + 0.001 * downhill**2
            unbiased, spread = mean / (1.0 - 0.9 ** (number + 1)), square / (1.0 - 0.999 ** (number + 1))
            step: FloatArray = problem.scale * rate * unbiased / (np.sqrt(spread) + 1e-12)
            return step

        return _descend(problem, start, self.steps, rule)


Solver = GaussNewton | LevenbergMarquardt | Adam


@kernel("f8(f8[:, ::1], f8[::1], f8[::1], f8, f8[:, ::1], f8[::1])")
def _add_up(
    rows: FloatArray,
    residuals: FloatArray,
    weights: FloatArray,
    precision: float,
    matrix: FloatArray,
    vector: FloatArray,
) -> float:
    """Fill the zeros of matrix (k, k) and vector (k,) of an `Information`; returns its total.

    Points whose motion is not known (behind the camera, no clear ridge) say nothing.
    """
    total, count = 0.0, rows.shape[1]
    for i in range(len(rows)):
        if weights[i] == 0.0 or not np.isfinite(residuals[i] + rows[i].sum()):
            continue
        weight = precision * weights[i]
        total += weight
        for j in range(count):
            weighted = weight * rows[i, j]
            vector[j] += weighted * residuals[i]
            for k in range(j + 1):
                matrix[j, k] += weighted * rows[i, k]
    for j in range(count):
        for k in range(j):
            matrix[k, j] = matrix[j, k]
    return total


def minimise(problem: Problem, start: Estimate, solver: Solver) -> tuple[Estimate, ...]:
    """The iterates of one level after its start, the last one being the result; none where no step was possible.

    A step into a degenerate estimate, or to behind the camera, ends the level at the iterate before.
    """
    return solver.minimise(problem, start)


def _descend(
    problem: Problem,
    start: Estimate,
    steps: int,
    rule: Callable[[NormalEquations, int], FloatArray],
    last_px: float = 0.0,
) -> tuple[Estimate, ...]:
    """Step by the rule, without asking whether e fell, until a step moves less than `last_px`."""
    at, iterates = start, list[Estimate]()
    for number in range(steps):
        try:
            step = rule(problem.normal_equations(at), number)
            moved = problem.motion.moved(at, step)
        except GeometryError:  # I became degenerate: the step that led there does not count
            return tuple(iterates[:-1])
        if not moved.is_possible:
            break
        at = moved
        iterates.append(at)
        if np.abs(step / problem.scale).max() < last_px:
            break
    try:
        _ = at.cam_T_obj  # kept by the estimate: whoever comes next asks for it too
    except GeometryError:
        return tuple(iterates[:-1])
    return tuple(iterates)


def _check(steps: int, damping: float) -> None:
    if not 1 <= steps <= MOST_STEPS:
        raise TrackingError(f"solver.steps = {steps}: give 1 to {MOST_STEPS}")
    if not damping >= 0.0:
        raise TrackingError(f"solver.damping = {damping:g}: give 0 or more")
