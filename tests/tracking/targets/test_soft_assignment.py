"""The loss on edge points and the soft assignment, against plain loops and finite differences."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from acp_lab.geometry.arrays import FloatArray
from acp_lab.tracking.targets.soft_assignment import robust_loss, soft_assignment


def made(seed: int, n: int = 12, m: int = 4, strongest: float = 0.25) -> tuple[FloatArray, FloatArray]:
    """Distances and scores, some of them 0."""
    rng = np.random.default_rng(seed)
    scores = rng.uniform(0.0, strongest, (n, m)) * (rng.uniform(size=(n, m)) > 0.3)
    return rng.uniform(-8.0, 8.0, (n, m)), scores


def one_by_one(distances: FloatArray, scores: FloatArray, sigma: float, outlier: float) -> tuple[list[float], ...]:
    """Residual, weight and loss of each edge point, as the module's docstring writes them."""
    residuals, weights, losses = [], [], []
    for row in range(len(distances)):
        masses = [
            score * math.exp(-0.5 * (distance / sigma) ** 2)
            for score, distance in zip(scores[row], distances[row], strict=True)
        ]
        total = sum(masses)
        residuals.append(sum(p * d for p, d in zip(masses, distances[row], strict=True)) / total if total else 0.0)
        weights.append(total / (total + outlier))
        losses.append(-math.log((min(total, 1.0) + outlier) / (1.0 + outlier)))
    return residuals, weights, losses


@given(seed=st.integers(0, 10_000), sigma=st.floats(0.5, 10.0), outlier=st.floats(0.05, 2.0))
def test_both_agree_with_a_plain_loop(seed: int, sigma: float, outlier: float) -> None:
    distances, scores = made(seed, strongest=1.0)
    residuals, weights, losses = one_by_one(distances, scores, sigma, outlier)
    found = soft_assignment(distances, scores, sigma, outlier)
    np.testing.assert_allclose(found.weights, weights, rtol=1e-9, atol=1e-12)
    # Where next to nothing is in reach the residual is of no weight, and its digits are of no interest.
    some = np.array(weights) > 1e-6
    np.testing.assert_allclose(found.residuals[some], np.array(residuals)[some], rtol=1e-6)
    assert robust_loss(distances, scores, sigma, outlier) == pytest.approx(float(np.mean(losses)), abs=1e-12)


@given(seed=st.integers(0, 10_000), sigma=st.floats(1.0, 8.0), outlier=st.floats(0.1, 2.0))
def test_the_residual_is_the_direction_in_which_the_loss_falls(seed: int, sigma: float, outlier: float) -> None:
    """Moving point i by u along its normal changes its distances to d - u: d loss / d u = - w r / (n sigma^2)."""
    distances, scores = made(seed)
    found = soft_assignment(distances, scores, sigma, outlier)
    step = 1e-5
    for i in range(len(distances)):
        shift = np.zeros((len(distances), 1))
        shift[i] = step
        slope = robust_loss(distances - shift, scores, sigma, outlier) - robust_loss(
            distances + shift, scores, sigma, outlier
        )
        expected = -found.weights[i] * found.residuals[i] / (len(distances) * sigma**2)
        assert slope / (2.0 * step) == pytest.approx(expected, rel=1e-4, abs=1e-8)


def test_one_strong_candidate_is_what_is_still_to_go() -> None:
    found = soft_assignment(np.array([[1.5, 40.0]]), np.array([[1.0, 1.0]]), 2.0, 0.5)
    assert found.residuals[0] == pytest.approx(1.5)
    assert 0.5 < found.weights[0] < 1.0


def test_far_and_missing_edges_lose_their_weight() -> None:
    distances, scores = np.array([[0.0], [4.0], [100.0], [0.0]]), np.array([[1.0], [1.0], [1.0], [0.0]])
    found = soft_assignment(distances, scores, 2.0, 0.5)
    assert (np.diff(found.weights[:3]) < 0.0).all()
    assert found.weights[2] == pytest.approx(0.0, abs=1e-12)
    assert found.weights[3] == 0.0
    assert found.residuals[3] == 0.0


@given(seed=st.integers(0, 10_000), outlier=st.floats(0.1, 2.0))
def test_the_loss_lies_between_a_perfect_fit_and_none(seed: int, outlier: float) -> None:
    distances, scores = made(seed, strongest=1.0)
    nothing = math.log((1.0 + outlier) / outlier)
    assert 0.0 <= robust_loss(distances, scores, 2.0, outlier) <= nothing + 1e-12
    assert robust_loss(0.0 * distances[:, :1], np.ones((len(distances), 1)), 2.0, outlier) == pytest.approx(0.0)
    assert robust_loss(distances, 0.0 * scores, 2.0, outlier) == pytest.approx(nothing)


@pytest.mark.parametrize("shape", [(0, 4), (5, 0), (0, 0)])
def test_nothing_to_assign_gives_no_nan(shape: tuple[int, int]) -> None:
    found = soft_assignment(np.zeros(shape), np.zeros(shape), 2.0, 0.5)
    np.testing.assert_array_equal(found.weights, np.zeros(shape[0]))
    np.testing.assert_array_equal(found.residuals, np.zeros(shape[0]))
    assert robust_loss(np.zeros(shape), np.zeros(shape), 2.0, 0.5) == pytest.approx(math.log(3.0))
