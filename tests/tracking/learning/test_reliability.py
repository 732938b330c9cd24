"""The memory of how steadily each sample was found."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.tracking.learning.reliability import ReliabilityConfig, SampleReliability


def test_steady_samples_gain_weight_and_jumping_or_missing_ones_lose_it() -> None:
    memory = SampleReliability(6, ReliabilityConfig())
    ids, outline = np.arange(4), np.ones(4, bool)
    start = memory.weights(ids, outline)
    assert len(set(start)) == 1
    for frame in range(20):
        jump = 0.8 if frame % 2 else -0.8
        memory.learn(ids, outline, np.array([0.02, jump, np.nan, 50.0]))
    steady, jumping, missing, far = memory.weights(ids, outline)
    assert steady > start[0] > jumping > missing > 0.0
    assert far == pytest.approx(missing)
    np.testing.assert_array_equal(memory.weights(np.array([5]), np.array([True])), start[:1])


def test_the_two_roles_of_an_edge_are_kept_apart() -> None:
    memory = SampleReliability(3, ReliabilityConfig())
    before = memory.weights(np.array([1]), np.array([False]))
    memory.learn(np.array([1]), np.array([True]), np.array([np.nan]))
    np.testing.assert_array_equal(memory.weights(np.array([1]), np.array([False])), before)
    assert memory.weights(np.array([1]), np.array([True])) < before


def test_the_scatter_at_half_weight_is_what_it_says() -> None:
    config = ReliabilityConfig(scatter_px=0.4, rate=1.0)
    memory = SampleReliability(1, config)
    memory.learn(np.array([0]), np.array([False]), np.array([-0.4]))
    assert memory.weights(np.array([0]), np.array([False]))[0] == pytest.approx(0.5)


def test_the_running_mean_is_that_of_its_slow_twin(rng: np.random.Generator) -> None:
    config = ReliabilityConfig()
    memory, ids, outline = SampleReliability(50, config), rng.permutation(50)[:30], rng.random(30) < 0.5
    mean = np.full((50, 2), config.initial_px**2)
    for _ in range(3):
        residuals = np.where(rng.random(30) < 0.2, np.nan, rng.normal(0.0, 1.0, 30))
        memory.learn(ids, outline, residuals)
        square = np.minimum(np.nan_to_num(residuals**2, nan=np.inf), config.miss_px**2)
        mean[ids, outline.astype(int)] += config.rate * (square - mean[ids, outline.astype(int)])
    scatter = config.scatter_px**2
    expected = scatter / (scatter + mean[ids, outline.astype(int)])
    np.testing.assert_allclose(memory.weights(ids, outline), expected, rtol=1e-12)
