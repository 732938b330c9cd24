"""Chamfer distances: both directions, exact against brute force."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from acp_lab.errors import GeometryError
from acp_lab.imaging import Chamfer, chamfer, nearest_distances


@given(st.integers(1, 30), st.integers(1, 30), st.sampled_from([2, 3]), st.integers(0, 10_000))
def test_against_brute_force(count_a: int, count_b: int, dimensions: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(0, 100, (count_a, dimensions)), rng.uniform(0, 100, (count_b, dimensions))
    table = np.linalg.norm(a[:, None] - b[None], axis=2)
    found = chamfer(a, b)
    assert found.a_to_b == pytest.approx(table.min(axis=1).mean())
    assert found.b_to_a == pytest.approx(table.min(axis=0).mean())
    assert found.symmetric == pytest.approx((table.min(axis=1).mean() + table.min(axis=0).mean()) / 2)
    assert chamfer(b, a) == Chamfer(found.b_to_a, found.a_to_b)


def test_the_directions_tell_invented_from_missed() -> None:
    true = np.column_stack([np.arange(100.0), np.zeros(100)])
    half = chamfer(true[:50], true)
    assert half.a_to_b == 0.0
    assert half.b_to_a > 10.0
    assert str(half) == "6.38 (there 0, back 12.8)"


def test_a_set_lies_on_itself() -> None:
    points = np.random.default_rng(0).normal(size=(20, 2))
    assert chamfer(points, points[::-1]).symmetric == 0.0
    assert (nearest_distances(points, points) == 0.0).all()


@pytest.mark.parametrize(
    ("bad", "word"),
    [
        (np.empty((0, 2)), "one or more"),
        (np.zeros(4), "one or more"),
        (np.full((3, 2), np.nan), "not finite"),
        (np.zeros((3, 3)), "in one frame"),
    ],
)
def test_sets_without_a_distance_are_refused(bad: np.ndarray, word: str) -> None:
    good = np.zeros((3, 2))
    for a, b in ((good, bad), (bad, good)):
        with pytest.raises(GeometryError, match=word):
            chamfer(a, b)
