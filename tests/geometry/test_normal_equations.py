"""Sums over many edges for small fits, beside NumPy's."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.geometry.normal_equations import add_up_rows, leave_rest


@pytest.mark.parametrize("count", [0, 1, 7, 200])
def test_sums_are_those_of_a_weighted_least_squares(rng: np.random.Generator, count: int) -> None:
    rows, residuals, weights = rng.normal(size=(6, 256)), rng.normal(size=256), rng.random(count)
    matrix, vector = np.full((6, 6), np.nan), np.full(6, np.nan)
    add_up_rows(rows, weights, weights * residuals[:count], matrix, vector)
    used = rows[:, :count]
    np.testing.assert_allclose(matrix, (used * weights) @ used.T, rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(vector, used @ (weights * residuals[:count]), rtol=1e-11, atol=1e-12)
    np.testing.assert_array_equal(matrix, matrix.T)


def test_what_a_step_explains_is_taken_off(rng: np.random.Generator) -> None:
    rows, residuals, step, rest = rng.normal(size=(8, 50)), rng.normal(size=50), rng.normal(size=8), np.empty(40)
    leave_rest(rows, residuals, step, rest)
    np.testing.assert_allclose(rest, residuals[:40] - step @ rows[:, :40], rtol=1e-11, atol=1e-12)


def test_the_solution_leaves_nothing_that_another_step_would_explain(rng: np.random.Generator) -> None:
    rows, residuals, weights, rest = rng.normal(size=(6, 80)), rng.normal(size=80), rng.random(80), np.empty(80)
    matrix, vector = np.empty((6, 6)), np.empty(6)
    add_up_rows(rows, weights, weights * residuals, matrix, vector)
    leave_rest(rows, residuals, np.linalg.solve(matrix, vector), rest)
    np.testing.assert_allclose(rows @ (weights * rest), 0.0, atol=1e-10)
