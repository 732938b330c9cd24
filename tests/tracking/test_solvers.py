"""The three solvers on edges whose best fit is known."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.errors import GeometryError
from acp_lab.generator.base import GeneratedEdges
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.homography import apply_homography, homography_from_points
from acp_lab.tracking.motions import HomographyMotion
from acp_lab.tracking.solvers import Measurement, SolverConfig, SolverName, minimise

START = np.array([[20.0, 20.0], [120.0, 25.0], [115.0, 110.0], [18.0, 105.0]])
GOAL = START + np.array([[2.0, 1.0], [-1.5, 2.0], [1.0, -2.0], [0.5, 1.5]])


@pytest.fixture
def edges(rng: np.random.Generator) -> GeneratedEdges:
    points = rng.uniform(10.0, 130.0, (150, 2))
    angle = rng.uniform(0.0, np.pi, 150)
    return GeneratedEdges(points, np.column_stack([np.cos(angle), np.sin(angle)]), np.ones(150), np.full(150, -1))


class KnownFit:
    """Each edge point knows where it ends, and half of the two components of the way is told to the solver."""

    def __init__(self, edges: GeneratedEdges, goal: FloatArray = GOAL) -> None:
        self._ends = apply_homography(homography_from_points(START, goal), edges.points)

    def __call__(self, edges: GeneratedEdges) -> Measurement:
        residuals = ((self._ends - edges.points) * edges.normals).sum(1)
        ones = np.ones(len(edges))
        return Measurement(residuals, edges.normals, ones, 0.5 * residuals**2, ones)


CONFIGS = {
    "gauss-newton": SolverConfig("gauss-newton", steps=8),
    "levenberg-marquardt": SolverConfig("levenberg-marquardt", steps=12),
    "adam": SolverConfig("adam", steps=300, rate=0.3),
}


@pytest.mark.parametrize("name", CONFIGS)
def test_each_solver_finds_the_known_fit(name: SolverName, edges: GeneratedEdges) -> None:
    iterates = minimise(HomographyMotion(edges, START), KnownFit(edges), START, CONFIGS[name])
    np.testing.assert_allclose(iterates[-1].variables, GOAL, atol=0.05)
    assert iterates[-1].loss < 0.01 * KnownFit(edges)(edges).loss


def test_levenberg_marquardt_never_goes_up(edges: GeneratedEdges) -> None:
    far = START + np.array([[30.0, -20.0], [-25.0, 30.0], [20.0, 20.0], [-20.0, -30.0]])
    iterates = minimise(
        HomographyMotion(edges, START), KnownFit(edges, far), START, SolverConfig("levenberg-marquardt", 10)
    )
    assert (np.diff([i.loss for i in iterates]) <= 0.0).all()


def test_a_prior_pulls_where_edges_say_nothing(edges: GeneratedEdges) -> None:
    class Nothing(KnownFit):
        def __call__(self, edges: GeneratedEdges) -> Measurement:
            seen = super().__call__(edges)
            return Measurement(seen.residuals, seen.directions, 0.0 * seen.weights, seen.losses, seen.shares)

    class Towards:
        weight = 1.0
        jacobian = np.eye(8)[:2]

        def residual(self, variables: FloatArray) -> FloatArray:
            return np.array([25.0, 15.0]) - variables[0]

    for name in ("gauss-newton", "levenberg-marquardt"):
        config = SolverConfig(name, steps=6)  # type: ignore[arg-type]
        found = minimise(HomographyMotion(edges, START), Nothing(edges), START, config, Towards())[-1].variables
        np.testing.assert_allclose(found[0], [25.0, 15.0], atol=0.05)
        np.testing.assert_allclose(found[1:], START[1:], atol=1e-6)


def test_nothing_to_go_by_moves_nothing(edges: GeneratedEdges) -> None:
    def blind(seen: GeneratedEdges) -> Measurement:
        none = np.zeros(len(seen))
        return Measurement(none, seen.normals, none, none, none)

    for config in CONFIGS.values():
        iterates = minimise(HomographyMotion(edges, START), blind, START, SolverConfig(config.name, 3))
        np.testing.assert_allclose(iterates[-1].variables, START, atol=1e-6)


def test_a_step_into_a_degenerate_quad_ends_the_level(edges: GeneratedEdges) -> None:
    class Folding(HomographyMotion):
        calls = 0

        def edges(self, variables: FloatArray) -> GeneratedEdges:
            self.calls += 1
            if self.calls > 2:
                raise GeometryError("three in line")
            return super().edges(variables)

        def linearised(self, variables: FloatArray) -> tuple[GeneratedEdges, FloatArray]:
            return self.edges(variables), super().linearised(variables)[1]

    for config in CONFIGS.values():
        iterates = minimise(Folding(edges, START), KnownFit(edges), START, config)
        assert np.isfinite(iterates[-1].variables).all()


def test_points_of_unknown_motion_say_nothing(edges: GeneratedEdges) -> None:
    class Partly(HomographyMotion):
        def linearised(self, variables: FloatArray) -> tuple[GeneratedEdges, FloatArray]:
            edges, jacobian = super().linearised(variables)
            jacobian[::3] = np.nan
            return edges, jacobian

    found = minimise(Partly(edges, START), KnownFit(edges), START, CONFIGS["gauss-newton"])[-1].variables
    np.testing.assert_allclose(found, GOAL, atol=0.05)
