"""The memory of what each sample looked like."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from acp_lab.geometry.arrays import FloatArray
from acp_lab.imaging.edge_search import Candidates
from acp_lab.tracking.learning.edge_memory import EdgeMemory, MemoryConfig

CONFIG = MemoryConfig()


def candidates(
    gradients: FloatArray, before: float | FloatArray = 80.0, after: float | FloatArray = 160.0
) -> Candidates:
    gradients = np.asarray(gradients, dtype=np.float64)
    ones = np.ones_like(gradients)
    return Candidates(0.0 * ones, ones, gradients, before * ones, after * ones)


def taught(gradient: float = 30.0) -> EdgeMemory:
    """A memory of ten samples that knows number 3 only."""
    memory = EdgeMemory(10, CONFIG)
    memory.learn(np.array([3]), candidates(np.array([[gradient]])), np.array([0]), np.array([0.0]))
    return memory


def test_without_a_past_everything_counts_fully() -> None:
    memory = EdgeMemory(10, CONFIG)
    np.testing.assert_array_equal(memory.factors(np.arange(4), candidates(np.ones((4, 3)))), np.ones((4, 3)))
    np.testing.assert_array_equal(taught().factors(np.array([2, 4]), candidates(np.ones((2, 3)))), np.ones((2, 3)))


def test_the_same_edge_counts_fully_and_others_less() -> None:
    seen = candidates(np.array([[30.0, 20.0, -30.0]]))
    same, weaker, turned = taught().factors(np.array([3]), seen)[0]
    assert same == pytest.approx(1.0)
    assert CONFIG.gradient_floor < weaker < 1.0
    assert turned == pytest.approx(CONFIG.gradient_floor, abs=0.01)


def test_grey_levels_at_the_sides_tell_edges_apart() -> None:
    factors = [
        taught().factors(np.array([3]), candidates(np.array([[30.0]]), before, after))[0, 0]
        for before, after in ((80.0, 160.0), (100.0, 160.0), (80.0, 140.0), (200.0, 20.0))
    ]
    assert factors[0] == pytest.approx(1.0)
    assert factors[1] == pytest.approx(factors[2])
    # One tolerance at one side is half of the squared change at both.
    assert factors[1] == pytest.approx(CONFIG.grey_floor + (1 - CONFIG.grey_floor) * np.exp(-0.25))
    assert factors[3] == pytest.approx(CONFIG.grey_floor, abs=1e-3)


@given(
    gradients=st.lists(st.floats(-120.0, 120.0), min_size=1, max_size=6),
    known=st.floats(-120.0, 120.0),
    grey=st.floats(0.0, 255.0),
)
def test_a_candidate_is_weakened_and_never_excluded(gradients: list[float], known: float, grey: float) -> None:
    factors = taught(known).factors(np.array([3]), candidates(np.array([gradients]), grey, 255.0 - grey))
    assert (factors >= CONFIG.gradient_floor * CONFIG.grey_floor - 1e-12).all()
    assert (factors <= 1.0).all()


def test_the_first_sight_is_taken_whole_and_later_ones_in_part() -> None:
    memory = taught(30.0)
    np.testing.assert_allclose(memory.means[3], [30.0, 80.0, 160.0])
    memory.learn(np.array([3]), candidates(np.array([[40.0]]), 90.0, 150.0), np.array([0]), np.array([0.5]))
    np.testing.assert_allclose(memory.means[3], np.array([30.0, 80.0, 160.0]) + CONFIG.rate * np.array([10, 10, -10]))
    assert memory.known.sum() == 1


def test_the_chosen_candidate_is_learnt_and_only_from_near() -> None:
    memory = EdgeMemory(10, CONFIG)
    seen = candidates(np.array([[1.0, 11.0], [2.0, 12.0], [3.0, 13.0], [4.0, 14.0], [5.0, 15.0]]))
    memory.learn(
        np.array([7, 0, 5, -1, 2]),
        seen,
        np.array([1, 0, 1, 0, 0]),
        np.array([-1.4, 1.6, 0.0, 0.0, np.inf]),
    )
    np.testing.assert_array_equal(np.flatnonzero(memory.known), [5, 7])
    assert memory.means[7, 0] == 11.0
    assert memory.means[5, 0] == 13.0


def test_nothing_to_learn_is_no_trouble() -> None:
    memory = EdgeMemory(10, CONFIG)
    memory.learn(np.zeros(0, np.intp), candidates(np.zeros((0, 6))), np.zeros(0, np.intp), np.zeros(0))
    assert not memory.known.any()
    assert memory.factors(np.zeros(0, np.intp), candidates(np.zeros((0, 6)))).shape == (0, 6)


# ---- the slow twin -------------------------------------------------------------------------------------------


def many(rng: np.random.Generator) -> Candidates:
    """Four candidates of each of 30 samples."""
    offsets, scores, before, after = rng.uniform(0.0, 200.0, (4, 30, 4))
    return Candidates(offsets, scores, rng.normal(0.0, 30.0, (30, 4)), before, after)


def test_factors_and_means_are_those_of_their_slow_twin(rng: np.random.Generator) -> None:
    memory, ids = EdgeMemory(40, CONFIG), rng.permutation(40)[:30]
    means, known = np.zeros((40, 3)), np.zeros(40, bool)
    for _ in range(3):
        seen, chosen = many(rng), rng.integers(0, 4, 30)
        distance = np.where(rng.random(30) < 0.2, np.nan, rng.uniform(-3.0, 3.0, 30))
        memory.learn(ids, seen, chosen, distance)
        rows = np.flatnonzero(np.abs(np.nan_to_num(distance, nan=np.inf)) < CONFIG.learn_within_px)
        picked = np.stack([values[rows, chosen[rows]] for values in (seen.gradients, seen.before, seen.after)], 1)
        rate = np.where(known[ids[rows]], CONFIG.rate, 1.0)[:, None]
        means[ids[rows]] += rate * (picked - means[ids[rows]])
        known[ids[rows]] = True
    np.testing.assert_allclose(memory.means, means, rtol=1e-12)
    np.testing.assert_array_equal(memory.known, known)
    seen = many(rng)
    gradient, before, after = means[ids].T[..., None]
    relative = (seen.gradients - gradient) / (np.abs(gradient) + 1.0) / CONFIG.gradient_tolerance
    change = 0.5 * ((seen.before - before) ** 2 + (seen.after - after) ** 2) / CONFIG.grey_tolerance**2
    by_gradient = CONFIG.gradient_floor + (1.0 - CONFIG.gradient_floor) * np.exp(-0.5 * relative**2)
    by_grey = CONFIG.grey_floor + (1.0 - CONFIG.grey_floor) * np.exp(-0.5 * change)
    expected = np.where(known[ids, None], by_gradient * by_grey, 1.0)
    np.testing.assert_allclose(memory.factors(ids, seen), expected, rtol=1e-12)


def test_unknown_samples_are_not_learnt() -> None:
    memory = EdgeMemory(3, CONFIG)
    memory.learn(np.array([-1, 1]), candidates(np.full((2, 1), 9.0)), np.zeros(2, int), np.zeros(2))
    np.testing.assert_array_equal(memory.known, [False, True, False])
