"""Image edges shared out among the model edges that they may belong to."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.errors import TrackingError
from acp_lab.geometry.arrays import BoolArray, FloatArray
from acp_lab.tracking.schedule import Level
from acp_lab.tracking.targets.shared_edges import _LEAST_COSINE, EdgeSharing

COARSE, FINE = Level(8, 2.0), Level(8, 1.0)
RIGHT = np.array([1.0, 0.0])


def shares(
    x: list[float], edges_at: list[float], known: list[bool], level: Level = COARSE, sharing: EdgeSharing | None = None
) -> FloatArray:
    """(n, m) of samples side by side at x px, each of which finds the image edges at `edges_at`."""
    points = np.column_stack([np.array(x), np.arange(len(x), dtype=np.float64)])
    offsets = np.array(edges_at)[None] - points[:, :1]
    return (sharing or EdgeSharing()).share_out(
        np.ones(offsets.shape), offsets, points, np.tile(RIGHT, (len(x), 1)), np.array(known), level,
        np.zeros((len(x), 6)), None,
    )  # fmt: skip


def test_what_is_new_in_sight_has_no_say_on_the_edge_of_a_known_neighbour() -> None:
    rim, face = shares([0.0, 3.0], [0.2], [True, False], FINE)
    assert rim == 1.0
    assert face < 0.02
    assert shares([0.0, 3.0], [0.2, 2.9], [True, False], FINE)[1, 1] > 0.6, "an edge of its own is its own"


def test_a_neighbour_that_is_far_on_its_edge_or_on_the_same_edge_or_across_claims_nothing() -> None:
    def share_of_the_new(neighbour: list[float], normal: list[float]) -> float:
        points = np.array([[0.0, 0.0], neighbour])
        return float(
            EdgeSharing().share_out(
                np.ones((2, 1)), np.array([[1.0], [0.0]]), points, np.array([RIGHT, normal]), np.array([False, True]),
                COARSE, np.zeros((2, 6)), None,
            )[0, 0]
        )  # fmt: skip

    assert share_of_the_new([1.5, 2.0], [1.0, 0.0]) < 0.2
    assert share_of_the_new([1.5, 2.0], [-1.0, 0.0]) < 0.2, "a normal may point either way"
    assert share_of_the_new([1.5, 12.0], [1.0, 0.0]) == 1.0, "far along"
    assert share_of_the_new([0.5, 2.0], [1.0, 0.0]) == 1.0, "the same edge"
    assert share_of_the_new([1.5, 2.0], [0.0, 1.0]) == 1.0, "another direction"
    assert share_of_the_new([5.0, 2.0], [1.0, 0.0]) == 1.0, "another image edge"


def test_the_known_share_by_distance_at_coarse_levels_and_keep_their_edges_at_fine_ones() -> None:
    near, far = shares([0.0, 3.0], [0.5], [True, True])[:, 0]
    assert near + far == pytest.approx(1.0)
    assert near > 0.8
    np.testing.assert_array_equal(shares([0.0, 3.0], [0.5], [True, True], FINE), 1.0)


def test_newcomers_claim_nothing_of_each_other() -> None:
    np.testing.assert_array_equal(shares([0.0, 3.0], [0.5], [False, False]), 1.0)


def test_a_pose_that_is_hardly_known_tells_neighbours_apart_less() -> None:
    def share_of_the_far(variance: float) -> float:
        points, jacobian = np.array([[0.0, 0.0], [3.0, 1.0]]), np.tile(np.eye(1, 6), (2, 1))
        return float(
            EdgeSharing().share_out(
                np.ones((2, 1)), -points[:, :1], points, np.tile(RIGHT, (2, 1)), np.array([True, True]), COARSE,
                jacobian, variance * np.eye(6),
            )[1, 0]
        )  # fmt: skip

    assert share_of_the_far(0.01) < 0.01 < 0.4 < share_of_the_far(50.0) < 0.5


def test_it_is_as_written(rng: np.random.Generator) -> None:
    count, width, sharing = 60, 4, EdgeSharing()
    points, angles = rng.uniform(0.0, 40.0, (count, 2)), rng.choice([0.0, 0.3, 1.5, 3.2], count)
    normals = np.column_stack([np.cos(angles), np.sin(angles)])
    offsets, known = rng.uniform(-8.0, 8.0, (count, width)), rng.random(count) < 0.6
    scores = rng.random((count, width)) * (rng.random((count, width)) < 0.7)
    jacobian, root = rng.normal(size=(count, 6)), rng.normal(size=(6, 6))
    covariance = 0.1 * (root @ root.T + np.eye(6))
    for level in (COARSE, FINE):
        found = sharing.share_out(scores, offsets, points, normals, known, level, jacobian, covariance)
        expected = as_written(sharing, scores, offsets, points, normals, known, level, jacobian, covariance)
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=0.0)
        assert 0.05 < (found < scores).mean() < 0.95


def as_written(
    sharing: EdgeSharing, scores: FloatArray, offsets: FloatArray, points: FloatArray, normals: FloatArray,
    known: BoolArray, level: Level, jacobian: FloatArray, covariance: FloatArray,
) -> FloatArray:  # fmt: skip
    """In NumPy, pair by pair."""
    variances = sharing.spread_px**2 + ((jacobian @ covariance) * jacobian).sum(1)
    words = np.where(known, 1.0, sharing.newcomer)
    masses = words[:, None] * scores * np.exp(-0.5 * offsets**2 / variances[:, None])
    claims = np.zeros_like(masses)
    for i in range(len(points)):
        for j in np.flatnonzero(known):
            way, cosine = points[j] - points[i], normals[i] @ normals[j]
            gap, side = way @ normals[i], way @ [normals[i, 1], -normals[i, 0]]
            is_neighbour = abs(gap) >= sharing.apart_px and abs(side) <= sharing.along_px
            is_near = np.abs(way).max() <= 2.0 * level.reach_px and abs(cosine) >= _LEAST_COSINE
            may_claim = not known[i] or level.sigma_px >= sharing.known_from_sigma_px
            if i == j or not is_neighbour or not is_near or not may_claim:
                continue
            apart = gap + np.sign(cosine) * offsets[j][None, :] - offsets[i][:, None]
            claims[i] = np.maximum(claims[i], np.where(np.abs(apart) < sharing.same_px, masses[j], 0.0).max(1))
    total = masses + claims
    return np.where(claims > 0.0, scores * masses / np.where(total > 0.0, total, 1.0), scores)


def test_bad_settings_say_what_to_give() -> None:
    with pytest.raises(TrackingError, match=r"sharing\.newcomer = 0: give more than 0"):
        EdgeSharing(newcomer=0.0)
    with pytest.raises(TrackingError, match=r"sharing\.same_px = -1: give more than 0, at most 100"):
        EdgeSharing(same_px=-1.0)
