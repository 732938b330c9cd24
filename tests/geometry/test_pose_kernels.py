"""Pose steps and six equations inside compiled loops, against their NumPy twins."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.geometry.pose import make_pose, so3_exp
from acp_lab.geometry.pose_kernels import eliminate, invert, move, step_between
from acp_lab.geometry.pose_step import move_pose, pose_step_between

CENTRE = np.array([120.0, -40.0, 15.0])


@pytest.mark.parametrize("angle", [0.0, 1e-120, 1e-9, 0.01, 1.0, 3.1, np.pi])
def test_a_step_there_and_back_is_that_of_its_twin(rng: np.random.Generator, angle: float) -> None:
    for _ in range(5):
        axis = rng.normal(size=3)
        start = make_pose(so3_exp(rng.normal(size=3)), rng.normal(0.0, 200.0, 3))
        step = np.concatenate([angle * axis / np.linalg.norm(axis), rng.normal(0.0, 5.0, 3)])
        moved, back = np.empty((4, 4)), np.empty(6)
        move(start, CENTRE, step, moved)
        np.testing.assert_allclose(moved, move_pose(start, CENTRE, step), rtol=0.0, atol=1e-12 * 300.0)
        step_between(start, moved, CENTRE, back)
        expected = pose_step_between(start, moved, CENTRE)
        # At half a turn both signs of the axis are right.
        if abs(angle - np.pi) < 1e-9 and back[:3] @ expected[:3] < 0.0:
            back[:3] *= -1.0
        np.testing.assert_allclose(back, expected, rtol=0.0, atol=1e-9)


def test_six_equations_are_solved(rng: np.random.Generator) -> None:
    for _ in range(20):
        matrix, vector = rng.normal(size=(6, 6)), rng.normal(size=6)
        matrix[0, 0] = 0.0  # rows must be swapped
        expected = np.linalg.solve(matrix, vector)
        assert eliminate(matrix.copy(), vector)
        np.testing.assert_allclose(vector, expected, rtol=1e-7)


def test_an_inverse_is_that_of_numpy(rng: np.random.Generator) -> None:
    scale = np.diag([1e3, 1e3, 1e3, 1.0, 1.0, 1e-2])
    matrix = scale @ rng.standard_normal((6, 6)) @ scale
    found = np.empty((6, 6))
    invert(matrix, found)
    np.testing.assert_allclose(found, np.linalg.inv(matrix), rtol=1e-9, atol=1e-12)
    invert(np.ones((6, 6)), found)
    assert np.isnan(found).all()


def test_equations_without_a_solution_say_so(rng: np.random.Generator) -> None:
    matrix = rng.normal(size=(6, 6))
    matrix[:, 3] = 0.0
    assert not eliminate(matrix, np.ones(6))
    assert not eliminate(np.full((6, 6), np.nan), np.ones(6))


def test_no_step_leaves_a_pose_to_the_bit(rng: np.random.Generator) -> None:
    pose, moved = make_pose(so3_exp(rng.normal(size=3)), rng.normal(0.0, 300.0, 3)), np.empty((4, 4))
    move(pose, rng.normal(0.0, 500.0, 3), np.zeros(6), moved)
    np.testing.assert_array_equal(moved, pose)
