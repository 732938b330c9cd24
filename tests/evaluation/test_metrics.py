"""Every metric against a slow evaluation of its published definition."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from acp_lab.cad.models_info import Symmetries
from acp_lab.evaluation.metrics import (
    FrameErrors,
    add_mm,
    adds_mm,
    area_under_curve,
    frames_until_lost,
    pooled_scores,
    pose_error,
    recall,
    rotation_error_deg,
    scores,
    translation_error_mm,
)
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import make_pose, so3_exp, transform

seeds = st.integers(0, 2**32 - 1)
shares = st.lists(st.floats(0.0, 0.3), min_size=1, max_size=30)

ABOUT_Z = ((0.0, 0.0, 2.0), (3.0, -4.0, 7.0))
HALF_TURN_X = make_pose(np.diag([1.0, -1.0, -1.0]), np.array([0.0, -8.0, 14.0]))


def _pose(rng: np.random.Generator, spread: float = 1.0) -> FloatArray:
    return make_pose(
        so3_exp(spread * rng.normal(size=3)), np.array([0, 0, 500]) + 20 * spread * rng.normal(size=3)
    )


def _angle_deg(a: FloatArray, b: FloatArray) -> float:
    return math.degrees(math.acos(np.clip((np.trace(a[:3, :3].T @ b[:3, :3]) - 1) / 2, -1, 1)))


# ADD, ADD-S


@given(seeds)
def test_add_is_the_mean_distance_of_corresponding_points(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points, estimate, truth = rng.normal(0, 30, (17, 3)), _pose(rng), _pose(rng)
    distances = [np.linalg.norm(transform(estimate, p) - transform(truth, p)) for p in points]
    assert add_mm(points, estimate, truth) == pytest.approx(np.mean(distances))
    assert add_mm(points, truth, truth) == 0.0


@given(seeds)
def test_add_s_is_the_mean_distance_to_the_nearest_point(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points, estimate, truth = rng.normal(0, 30, (17, 3)), _pose(rng), _pose(rng)
    moved = transform(estimate, points)
    distances = [min(np.linalg.norm(q - transform(truth, p)) for q in moved) for p in points]
    assert adds_mm(points, estimate, truth) == pytest.approx(np.mean(distances))
    assert adds_mm(points, estimate, truth, cKDTree(points)) == pytest.approx(np.mean(distances))
    assert adds_mm(points, estimate, truth) <= add_mm(points, estimate, truth) + 1e-9


def test_add_s_of_a_symmetric_flip_is_nought() -> None:
    square = np.array([[1.0, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]])
    truth = _pose(np.random.default_rng(0))
    flipped = truth @ make_pose(so3_exp(np.array([0, 0, math.pi / 2])), np.zeros(3))
    assert adds_mm(square, flipped, truth) == pytest.approx(0, abs=1e-9)
    assert add_mm(square, flipped, truth) == pytest.approx(2)


# Rotation and translation


@given(seeds)
def test_rotation_and_translation_errors(seed: int) -> None:
    rng = np.random.default_rng(seed)
    estimate, truth = _pose(rng), _pose(rng)
    assert rotation_error_deg(estimate, truth) == pytest.approx(_angle_deg(estimate, truth), abs=1e-5)
    assert translation_error_mm(estimate, truth) == pytest.approx(
        np.linalg.norm(estimate[:3, 3] - truth[:3, 3])
    )
    assert pose_error(truth, truth, Symmetries.none()).rotation_deg == pytest.approx(0, abs=1e-6)


@given(seeds)
def test_discrete_symmetries_take_the_smallest_angle(seed: int) -> None:
    rng = np.random.default_rng(seed)
    quarter = [make_pose(so3_exp(np.array([0, 0, k * math.pi / 2])), np.array([k, 0, 0])) for k in (1, 2, 3)]
    estimate, truth = _pose(rng), _pose(rng)
    error = pose_error(estimate, truth, Symmetries(np.array(quarter)))
    truths = [truth, *(truth @ turn for turn in quarter)]
    angles = [_angle_deg(estimate, same) for same in truths]
    best = int(np.argmin(angles))
    assert error.rotation_deg == pytest.approx(angles[best], abs=1e-5)
    assert error.translation_mm == pytest.approx(np.linalg.norm(estimate[:3, 3] - truths[best][:3, 3]))


@given(seeds, st.booleans())
@settings(max_examples=40)
def test_a_continuous_symmetry_is_as_fine_as_any_discretisation(seed: int, with_flip: bool) -> None:
    rng = np.random.default_rng(seed)
    symmetries = Symmetries(np.array([HALF_TURN_X] if with_flip else []), (ABOUT_Z,))
    estimate, truth = _pose(rng), _pose(rng)
    error = pose_error(estimate, truth, symmetries)
    steps = 120
    smallest = min(_angle_deg(estimate, truth @ turn) for turn in symmetries.transforms(steps))
    assert smallest - 180.0 / steps <= error.rotation_deg <= smallest + 1e-5


@given(seeds, st.floats(-10, 10))
def test_a_turn_about_the_axis_of_symmetry_costs_nothing(seed: int, angle: float) -> None:
    rng = np.random.default_rng(seed)
    truth = _pose(rng)
    turn = so3_exp(np.array([0, 0, angle]))
    offset = np.array(ABOUT_Z[1])
    estimate = truth @ make_pose(turn, offset - turn @ offset)
    error = pose_error(estimate, truth, Symmetries(np.zeros((0, 4, 4)), (ABOUT_Z,)))
    assert error.rotation_deg == pytest.approx(0, abs=1e-5)
    assert error.translation_mm == pytest.approx(0, abs=1e-6)


# Shares and areas


def test_recall_is_strictly_below() -> None:
    errors = np.array([0.0, 1.0, 2.0, np.inf])
    assert recall(errors, 2.0) == 0.5
    assert recall(errors, np.nextafter(2.0, 3.0)) == 0.75
    assert math.isnan(recall(np.zeros(0), 1.0))


@given(shares)
def test_the_area_under_the_curve_is_exact(values: list[float]) -> None:
    errors, limit = np.array(values), 0.1
    # The curve is a staircase: sum up its rectangles between the sorted errors.
    steps = np.concatenate([[0.0], np.sort(errors[errors < limit]), [limit]])
    area = sum((right - left) * np.mean(errors <= left) for left, right in pairwise(steps))
    assert area_under_curve(errors, limit) == pytest.approx(area / limit, abs=1e-12)


def test_the_area_at_its_ends() -> None:
    assert area_under_curve(np.zeros(3), 0.1) == 1.0
    assert area_under_curve(np.array([0.1, np.inf]), 0.1) == 0.0
    assert area_under_curve(np.array([0.05]), 0.1) == pytest.approx(0.5)
    assert math.isnan(area_under_curve(np.zeros(0), 0.1))


@pytest.mark.parametrize(
    ("errors", "expected"),
    [([], 0), ([0.1, 0.3], 2), ([0.1, 0.31, 0.1], 1), ([np.inf], 0), ([0.1, 0.2, np.nan], 2)],
)
def test_frames_until_lost(errors: list[float], expected: int) -> None:
    assert frames_until_lost(np.array(errors), 0.3) == expected


# Scores


def _errors(
    distance: list[float], angle: list[float], shift: list[float], time_s: list[float]
) -> FrameErrors:
    arrays = (np.array(values, dtype=np.float64) for values in (distance, angle, shift, time_s))
    return FrameErrors(tuple(range(1, len(distance) + 1)), *arrays)


def test_scores_of_a_small_sequence() -> None:
    errors = _errors(
        [0.01, 0.03, 0.07, 0.2, np.inf],
        [1, 4, 5, 6, np.inf],
        [10, 49, 10, 10, np.inf],
        [0.1, 0.3, 0.2, 0.2, np.nan],
    )
    result = scores(errors)
    assert (result.frames, result.frames_until_lost) == (5, 4)
    assert (result.recall_2, result.recall_5, result.recall_10) == (0.2, 0.4, 0.6)
    assert result.auc_10pct == pytest.approx((0.9 + 0.7 + 0.3) / 5)
    assert result.cm5deg5 == 0.4  # 5 degrees are not below 5 degrees
    assert (result.rot_deg_median, result.trans_mm_median) == (5.0, 10.0)
    assert result.time_s_median == pytest.approx(0.2)


def test_pooling_counts_frames_not_objects() -> None:
    one = _errors([0.01] * 3, [1.0] * 3, [2.0] * 3, [0.1] * 3)
    other = _errors([0.5], [9.0], [90.0], [0.2])
    result = pooled_scores([one, other])
    assert (result.frames, result.recall_2, result.cm5deg5) == (4, 0.75, 0.75)
    assert result.frames_until_lost == 3
    assert (result.rot_deg_median, result.time_s_median) == (1.0, pytest.approx(0.1))


def test_mostly_missing_and_no_frames() -> None:
    missing = scores(
        _errors([0.01, np.inf, np.inf], [1, np.inf, np.inf], [1, np.inf, np.inf], [0.1, np.nan, np.nan])
    )
    assert missing.rot_deg_median == math.inf
    assert missing.time_s_median == 0.1
    nothing = scores(_errors([], [], [], []))
    assert (nothing.frames, nothing.frames_until_lost) == (0, 0)
    assert math.isnan(nothing.recall_2)
    assert math.isnan(nothing.rot_deg_median)
    assert math.isnan(pooled_scores([]).auc_10pct)
