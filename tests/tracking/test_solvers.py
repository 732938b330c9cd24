"""The least-squares problem of one linearisation, and the three solvers on edges whose best fit is known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from acp_lab.errors import GeometryError, TrackingError
from acp_lab.generator.base import GeneratedEdges
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.homography import apply_homography, homography_from_points
from acp_lab.geometry.pose import transform
from acp_lab.geometry.pose_step import move_pose
from acp_lab.tracking.frame_view import Estimate, View
from acp_lab.tracking.motions import HomographyMotion, Motion, PoseVariables, RigidMotion, Rows
from acp_lab.tracking.priors import ControlPointDamping
from acp_lab.tracking.solvers import (
    MOST_STEPS,
    Adam,
    GaussNewton,
    LevenbergMarquardt,
    Measurement,
    NormalEquations,
    Problem,
    Solver,
    WeightedMeasure,
    minimise,
)
from tests.made_parts import box, looking_at

START = np.array([[20.0, 20.0], [120.0, 25.0], [115.0, 110.0], [18.0, 105.0]])
GOAL = START + np.array([[2.0, 1.0], [-1.5, 2.0], [1.0, -2.0], [0.5, 1.5]])
CAMERA = Camera(640, 512, 600.0, 620.0, 319.5, 250.25)
PART = box(shift=(500.0, -200.0, 100.0))
POSE = looking_at(PART, np.array([1.0, 0.5, 0.2]), 250.0, 0.4)
# PnP is asked of every level's last I, which must therefore have a pose; START is an image of no certain plane.
W = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]]) * 20.0 + PART.box_centre
VIEW = View(CAMERA, POSE, 4, W, PART)


def at(points: FloatArray) -> Estimate:
    return VIEW.at_points(points)


@pytest.fixture
def edges(rng: np.random.Generator) -> GeneratedEdges:
    points = rng.uniform(10.0, 130.0, (150, 2))
    angle = rng.uniform(0.0, np.pi, 150)
    return GeneratedEdges(points, np.column_stack([np.cos(angle), np.sin(angle)]), np.ones(150), np.full(150, -1))


@dataclass(frozen=True)
class Said:
    """What a measure says."""

    residuals: FloatArray
    directions: FloatArray
    weights: FloatArray
    loss: float


class KnownFit:
    """Each edge point knows where it ends, and one of the two components of the way is told to the solver."""

    def __init__(self, edges: GeneratedEdges, goal: FloatArray = GOAL) -> None:
        self._ends = apply_homography(homography_from_points(START, goal), edges.points)

    def __call__(self, edges: GeneratedEdges) -> Measurement:
        residuals = ((self._ends - edges.points) * edges.normals).sum(1)
        return Said(residuals, edges.normals, np.ones(len(edges)), float(np.mean(0.5 * residuals**2)))


def problem(motion: Motion, *measures: Callable[[GeneratedEdges], Measurement]) -> Problem:
    return Problem(motion, [WeightedMeasure(measure) for measure in measures])


SOLVERS: dict[str, Solver] = {
    "gauss-newton": GaussNewton(steps=8),
    "levenberg-marquardt": LevenbergMarquardt(steps=12),
    "adam": Adam(steps=300, rate=0.3),
}


# ---- the solvers ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SOLVERS)
def test_each_solver_finds_the_known_fit(name: str, edges: GeneratedEdges) -> None:
    made = problem(HomographyMotion(edges, START), KnownFit(edges))
    iterates = minimise(made, at(START), SOLVERS[name])
    assert len(iterates) <= SOLVERS[name].steps
    np.testing.assert_allclose(iterates[-1].control_points, GOAL, atol=0.05)
    assert made.loss(iterates[-1]) < 0.01 * made.loss(at(START))


def test_levenberg_marquardt_never_goes_up(edges: GeneratedEdges) -> None:
    far = START + np.array([[30.0, -20.0], [-25.0, 30.0], [20.0, 20.0], [-20.0, -30.0]])
    made = problem(HomographyMotion(edges, START), KnownFit(edges, far))
    iterates = minimise(made, at(START), LevenbergMarquardt(10))
    losses = [made.loss(estimate) for estimate in (at(START), *iterates)]
    assert len(losses) > 2
    assert (np.diff(losses) < 0.0).all()


def test_levenberg_marquardt_shortens_a_step_that_goes_up(edges: GeneratedEdges) -> None:
    """Residuals told three times too long: Gauss-Newton oscillates ever wider, Marquardt's damping catches it."""

    class Overshooting(KnownFit):
        def __call__(self, edges: GeneratedEdges) -> Measurement:
            seen = super().__call__(edges)
            return Said(3.0 * seen.residuals, seen.directions, seen.weights, seen.loss)

    made = problem(HomographyMotion(edges, START), Overshooting(edges))
    caught = minimise(made, at(START), LevenbergMarquardt(20, damping=1e-2))[-1]
    wild = minimise(made, at(START), GaussNewton(4, damping=0.0))[-1]
    assert made.loss(caught) < 0.1 * made.loss(at(START)) < made.loss(wild)


def test_a_solver_takes_the_steps_that_it_is_told(edges: GeneratedEdges) -> None:
    made = problem(HomographyMotion(edges, START), KnownFit(edges))
    for solver in (GaussNewton(3), GaussNewton(5), Adam(7)):
        assert len(minimise(made, at(START), solver)) == solver.steps


def test_adams_rate_is_pixels_and_falls_as_a_cosine_to_a_tenth() -> None:
    """On a slope that stays the same each step is as long as the rate."""
    points = np.linspace(20.0, 120.0, 24).reshape(12, 2)
    edges = GeneratedEdges(points, np.tile([0.0, 1.0], (12, 1)), np.ones(12), np.full(12, -1))

    class Shift:
        """All points go along with the first control point."""

        def edges(self, at: Estimate) -> GeneratedEdges:
            return edges

        def linearised(self, at: Estimate) -> tuple[GeneratedEdges, Rows]:
            return edges, lambda directions: np.outer(directions[:, 0], np.eye(8)[0])

        def moved(self, at: Estimate, step: FloatArray) -> Estimate:
            return at.view.at_points(at.control_points + step.reshape(4, 2))

    def slope(edges: GeneratedEdges) -> Measurement:
        return Said(np.full(12, 5.0), edges.normals, np.ones(12), 1.0)

    iterates = minimise(problem(Shift(), slope), at(START), Adam(20, rate=0.4))
    way = np.abs(np.diff([START[0, 0], *(estimate.control_points[0, 0] for estimate in iterates)]))
    expected = 0.4 * (0.55 + 0.45 * np.cos(np.pi * np.arange(20) / 20))
    np.testing.assert_allclose(way, expected, rtol=1e-6)
    scaled = minimise(replace(problem(Shift(), slope), scale=np.full(8, 2.0)), at(START), Adam(20, rate=0.4))
    assert scaled[0].control_points[0, 0] - START[0, 0] == pytest.approx(-2.0 * 0.4, rel=1e-6)


@pytest.mark.parametrize("name", SOLVERS)
def test_nothing_to_go_by_moves_nothing(name: str, edges: GeneratedEdges) -> None:
    def blind(seen: GeneratedEdges) -> Measurement:
        return Said(np.zeros(len(seen)), seen.normals, np.zeros(len(seen)), 0.0)

    for iterate in minimise(problem(HomographyMotion(edges, START), blind), at(START), SOLVERS[name]):
        np.testing.assert_allclose(iterate.control_points, START, atol=1e-6)


@pytest.mark.parametrize("name", SOLVERS)
def test_a_step_into_a_degenerate_quad_ends_the_level(name: str, edges: GeneratedEdges) -> None:
    class Folding(HomographyMotion):
        calls = 0

        def _tick(self) -> None:
            self.calls += 1
            if self.calls > 3:
                raise GeometryError("three in line")

        def edges(self, at: Estimate) -> GeneratedEdges:
            self._tick()
            return super().edges(at)

        def linearised(self, at: Estimate) -> tuple[GeneratedEdges, Rows]:
            self._tick()
            return super().linearised(at)

    iterates = minimise(problem(Folding(edges, START), KnownFit(edges)), at(START), SOLVERS[name])
    # The step after which nothing could be said any more does not count.
    assert len(iterates) <= 2
    assert all(np.isfinite(estimate.cam_T_obj).all() for estimate in iterates)


def test_the_loss_is_infinite_where_a_prior_is_degenerate(edges: GeneratedEdges) -> None:
    class Folding:
        def loss(self, at: Estimate, total: float) -> float:
            raise GeometryError("three in line")

    whole = problem(HomographyMotion(edges, START), KnownFit(edges))
    assert np.isfinite(whole.loss(at(START)))
    assert replace(whole, priors=(Folding(),)).loss(at(START)) == np.inf  # type: ignore[arg-type]


def test_a_step_to_behind_the_camera_ends_the_level() -> None:
    class Backwards:
        def edges(self, at: Estimate) -> GeneratedEdges:
            raise AssertionError("not asked for")

        def linearised(self, at: Estimate) -> tuple[GeneratedEdges, Rows]:
            none = np.zeros((0, 2))
            return GeneratedEdges(none, none, np.zeros(0), np.zeros(0, np.intp)), lambda _: np.zeros((0, 6))

        def moved(self, at: Estimate, step: FloatArray) -> Estimate:
            away = np.array([0.0, 0, 0, 0, 0, -200.0])
            return at.view.at_pose(move_pose(at.cam_T_obj, PART.box_centre, away))

    def blind(seen: GeneratedEdges) -> Measurement:
        return Said(np.zeros(0), seen.normals, np.zeros(0), 0.0)

    (only,) = minimise(problem(Backwards(), blind), VIEW.at_pose(POSE), GaussNewton(5))
    assert transform(only.cam_T_obj, PART.box_centre)[2] == pytest.approx(50.0)


def test_points_of_unknown_motion_say_nothing(edges: GeneratedEdges) -> None:
    class Partly(HomographyMotion):
        def linearised(self, at: Estimate) -> tuple[GeneratedEdges, Rows]:
            edges, rows_along = super().linearised(at)

            def rows(directions: FloatArray) -> FloatArray:
                found = rows_along(directions)
                found[::3] = np.nan
                return found

            return edges, rows

    made = problem(Partly(edges, START), KnownFit(edges))
    found = minimise(made, at(START), SOLVERS["gauss-newton"])[-1].control_points
    np.testing.assert_allclose(found, GOAL, atol=0.05)


# ---- the least-squares problem -------------------------------------------------------------------------------


class Linear:
    """A motion of which the rows are given."""

    def __init__(self, jacobian: FloatArray) -> None:
        self._jacobian = jacobian
        count = len(jacobian)
        self._edges = GeneratedEdges(
            np.zeros((count, 2)), np.tile([1.0, 0.0], (count, 1)), np.ones(count), np.arange(count)
        )

    def edges(self, at: Estimate) -> GeneratedEdges:
        return self._edges

    def linearised(self, at: Estimate) -> tuple[GeneratedEdges, Rows]:
        return self._edges, lambda directions: directions[:, 1:] * self._jacobian

    def moved(self, at: Estimate, step: FloatArray) -> Estimate:
        return at


@dataclass(frozen=True)
class Fixed:
    """A measure that says the same whatever it is asked."""

    residuals: FloatArray
    weights: FloatArray
    loss: float = 1.0

    def __call__(self, edges: GeneratedEdges) -> Measurement:
        return Said(self.residuals, edges.normals, self.weights, self.loss)


class Towards:
    """A quadratic prior with all its numbers given: weight * |rest - jacobian s|^2 wherever the estimate is.

    The weight is relative to what the image says.
    """

    def __init__(self, weight: float, jacobian: FloatArray, rest: FloatArray) -> None:
        self.weight, self.jacobian, self.rest = weight, jacobian, rest

    def residual(self, at: Estimate) -> FloatArray:
        return self.rest

    def equations(self, at: Estimate, total: float) -> NormalEquations:
        transposed = self.weight * self.jacobian.T
        return NormalEquations(transposed @ self.jacobian, transposed @ self.residual(at))

    def loss(self, at: Estimate, total: float) -> float:
        return 0.5 * self.weight * float((self.residual(at) ** 2).sum())


class Absolute(Towards):
    """The same with an information of its own, which the image's is held against."""

    def equations(self, at: Estimate, total: float) -> NormalEquations:
        found = super().equations(at, total)
        return NormalEquations(found.hessian / total, found.downhill / total)

    def loss(self, at: Estimate, total: float) -> float:
        return super().loss(at, total) / total


class PullFirst(Towards):
    """The first control point is drawn to a place."""

    def __init__(self, weight: float) -> None:
        super().__init__(weight, np.eye(8)[:2], np.zeros(2))

    def residual(self, at: Estimate) -> FloatArray:
        return np.array([25.0, 15.0]) - at.control_points[0]


class PullFirstSurely(Absolute, PullFirst):
    """The same, with an information of its own."""


ANY = VIEW.at_pose(POSE)


@given(seed=st.integers(0, 10_000), damping=st.sampled_from([1e-9, 1e-3, 1.0, 100.0]))
def test_the_step_is_the_damped_least_squares_solution(seed: int, damping: float) -> None:
    """By the stacked rows of the head of `solvers`, with a library's solver."""
    rng = np.random.default_rng(seed)
    jacobian, residuals = rng.standard_normal((40, 6)), rng.standard_normal(40)
    weights, control = rng.uniform(0.0, 2.0, 40), rng.standard_normal((8, 6))
    share = np.sqrt(weights / weights.sum())
    rows = np.concatenate([share[:, None] * jacobian, np.sqrt(damping) * control])
    right = np.concatenate([share * residuals, np.zeros(8)])
    expected = np.linalg.lstsq(rows, right, rcond=None)[0]
    made = replace(
        problem(Linear(jacobian), Fixed(residuals, weights)), priors=[Towards(damping, control, np.zeros(8))]
    )
    np.testing.assert_allclose(made.normal_equations(ANY).step(0.0), expected, rtol=1e-6, atol=1e-9)


@given(seed=st.integers(0, 10_000), share=st.floats(0.01, 100.0))
def test_several_measures_add_up_each_with_its_precision(seed: int, share: float) -> None:
    """By the stacked rows of the head of `solvers`: all measures over the total, priors beside them."""
    rng = np.random.default_rng(seed)
    motion = Linear(rng.standard_normal((30, 6)))
    first, second = (
        Fixed(rng.standard_normal(30), rng.uniform(0.1, 2.0, 30), loss) for loss in (rng.uniform(), rng.uniform())
    )
    prior = Towards(0.3, rng.standard_normal((8, 6)), rng.standard_normal(8))
    own = Absolute(20.0, rng.standard_normal((8, 6)), rng.standard_normal(8))
    both = Problem(motion, [WeightedMeasure(first, 2.0), WeightedMeasure(second, share)], [prior, own])
    # The precision of a measure multiplies its weights.
    weights = np.concatenate([2.0 * first.weights, share * second.weights])
    rows, right = np.tile(motion.linearised(ANY)[1](np.ones((30, 2))), (2, 1)), [first.residuals, second.residuals]
    assert both.information(ANY).total == pytest.approx(weights.sum())
    np.testing.assert_allclose(both.information(ANY).matrix, rows.T @ (weights[:, None] * rows), rtol=1e-9, atol=1e-9)
    rows = np.concatenate([rows, prior.jacobian, own.jacobian])
    residuals = np.concatenate([*right, prior.rest, own.rest])
    weights = np.concatenate([weights / weights.sum(), np.full(8, 0.3), np.full(8, 20.0 / weights.sum())])
    found = both.normal_equations(ANY)
    np.testing.assert_allclose(found.hessian, rows.T @ (weights[:, None] * rows), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.downhill, rows.T @ (weights * residuals), rtol=1e-9, atol=1e-9)
    # e is the mean, so that with one measure it is this measure's, however precise.
    expected_loss = (2.0 * first.loss + share * second.loss) / (2.0 + share)
    expected_loss += 0.5 * 0.3 * float((prior.rest**2).sum())
    expected_loss += 0.5 * 20.0 * float((own.rest**2).sum()) / (30 * (2.0 + share))
    assert both.loss(ANY) == pytest.approx(expected_loss)


def test_the_gradient_is_that_of_the_loss(edges: GeneratedEdges) -> None:
    """A step of gradient g goes down e: the derivative of e by the variables is -g, with both measures and priors."""
    measures = [WeightedMeasure(KnownFit(edges)), WeightedMeasure(KnownFit(edges, GOAL + 3.0), 0.5)]
    motion = HomographyMotion(edges, START)
    made = Problem(motion, measures, [PullFirst(0.2), PullFirstSurely(40.0)])
    gradient = made.normal_equations(at(START)).downhill
    for k in range(8):
        step = 1e-4 * np.eye(8)[k]
        slope = (made.loss(motion.moved(at(START), step)) - made.loss(motion.moved(at(START), -step))) / 2e-4
        # Normals turn with the homography, so that residuals of 2 px change by a little more than the rows say.
        assert slope == pytest.approx(-gradient[k], rel=0.05, abs=0.02)


def test_a_prior_pulls_where_edges_say_nothing(edges: GeneratedEdges) -> None:
    class Nothing(KnownFit):
        def __call__(self, edges: GeneratedEdges) -> Measurement:
            seen = super().__call__(edges)
            return Said(seen.residuals, seen.directions, 0.0 * seen.weights, 0.0)

    made = replace(problem(HomographyMotion(edges, START), Nothing(edges)), priors=[PullFirst(1.0)])
    for solver in (GaussNewton(6), LevenbergMarquardt(6)):
        found = minimise(made, at(START), solver)[-1].control_points
        np.testing.assert_allclose(found[0], [25.0, 15.0], atol=0.05)
        np.testing.assert_allclose(found[1:], START[1:], atol=1e-6)


def test_weights_count_relative_to_each_other_only() -> None:
    rng = np.random.default_rng(0)
    motion, residuals, weights = (
        Linear(rng.standard_normal((20, 6))),
        rng.standard_normal(20),
        rng.uniform(0.1, 1.0, 20),
    )
    first, second = (
        problem(motion, Fixed(residuals, c * weights)).normal_equations(ANY).step(0.1) for c in (1.0, 1e-6)
    )
    np.testing.assert_allclose(first, second)


@pytest.mark.parametrize("count", [0, 5])
@pytest.mark.parametrize("damping", [0.0, 1e-3])
def test_without_weight_there_is_no_step(count: int, damping: float) -> None:
    made = problem(Linear(np.ones((count, 6))), Fixed(np.ones(count), np.zeros(count)))
    np.testing.assert_array_equal(made.normal_equations(ANY).step(damping), np.zeros(6))
    damped = replace(made, priors=[Towards(0.1, np.ones((8, 6)) + np.eye(8, 6), np.zeros(8))])
    np.testing.assert_array_equal(damped.normal_equations(ANY).step(damping), np.zeros(6))


def test_marquardts_damping_is_a_multiple_of_the_diagonal() -> None:
    rng = np.random.default_rng(1)
    rows = rng.standard_normal((12, 6))
    equations = NormalEquations(rows.T @ rows, rng.standard_normal(6))
    hessian = equations.hessian + 0.5 * np.diag(np.diagonal(equations.hessian))
    np.testing.assert_allclose(equations.step(0.5), np.linalg.solve(hessian, equations.downhill), rtol=1e-6)


def test_few_samples_move_the_part_no_further_than_they_say() -> None:
    """Two samples cannot fix six degrees of freedom: the damping keeps the rest still, in control-point pixels."""
    edges, points_obj = projected(2, 1)

    def apart(seen: GeneratedEdges) -> Measurement:
        return Said(np.array([1.0, -1.0]), seen.normals, np.ones(2), 1.0)

    prior = ControlPointDamping(2e-3).bind(PoseVariables(), ANY)
    made = replace(problem(RigidMotion(edges, points_obj, ANY), apart), priors=[prior])
    step = made.normal_equations(ANY).step(0.0)
    assert np.abs(VIEW.control_jacobian(POSE) @ step).max() < 10.0


def projected(count: int, seed: int, pose: FloatArray = POSE) -> tuple[GeneratedEdges, FloatArray]:
    """Points of the part with any directions, and where they are."""
    rng = np.random.default_rng(seed)
    points_obj = PART.box_centre + rng.uniform(-0.5, 0.5, (count, 3)) * PART.box_size
    angles = rng.uniform(0.0, 2.0 * np.pi, count)
    tangents = np.stack([np.cos(angles), np.sin(angles)], 1)
    return GeneratedEdges(
        CAMERA.project(transform(pose, points_obj)), tangents, np.ones(count), np.arange(count)
    ), points_obj


@pytest.mark.parametrize("per_level", [False, True])
def test_repeated_steps_find_the_pose_again(per_level: bool) -> None:
    seen, points_obj = projected(60, 3)
    away = VIEW.at_pose(move_pose(POSE, PART.box_centre, np.array([0.05, -0.04, 0.03, 2.0, -1.0, 5.0])))
    drawn = replace(seen, points=CAMERA.project(transform(away.cam_T_obj, points_obj)))

    def along_normals(edges: GeneratedEdges) -> Measurement:
        residuals = ((seen.points - edges.points) * edges.normals).sum(1)
        return Said(residuals, edges.normals, np.ones(60), float((residuals**2).mean()))

    made = replace(
        problem(RigidMotion(drawn, points_obj, away, per_level), along_normals),
        priors=[ControlPointDamping(2e-6).bind(PoseVariables(), away)],
    )
    found = minimise(made, away, GaussNewton(12 if per_level else 6, damping=0.0))[-1].cam_T_obj
    np.testing.assert_allclose(
        transform(found, points_obj), transform(POSE, points_obj), atol=1e-3 if per_level else 1e-4
    )


# ---- settings ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [GaussNewton, LevenbergMarquardt, Adam])
@pytest.mark.parametrize("steps", [0, -1, MOST_STEPS + 1, 1_000_000_000])
def test_a_number_of_steps_that_is_a_slip_of_the_pen_is_refused(kind: Callable[..., Solver], steps: int) -> None:
    with pytest.raises(TrackingError, match=rf"^solver\.steps = {steps}: give 1 to {MOST_STEPS}$"):
        kind(steps=steps)


def test_settings_that_would_diverge_are_refused() -> None:
    for kind in (GaussNewton, LevenbergMarquardt):
        for damping in (-1e-3, float("nan")):
            with pytest.raises(TrackingError, match=r"^solver\.damping = .*: give 0 or more$"):
                kind(damping=damping)
    for rate in (0.0, -1.0, float("nan")):
        with pytest.raises(TrackingError, match=r"^solver\.rate = .*: give px above 0$"):
            Adam(rate=rate)
