"""Which frames the benchmark of frames left out leaves."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.left_out_frames import APART, GAP, LEFT_OUT, SHARE, kept


@pytest.mark.parametrize("name", LEFT_OUT)
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_first_two_are_always_there(name: str, seed: int) -> None:
    assert kept(name, 30, np.random.default_rng(seed))[:2] == [0, 1]


def test_what_each_leaves() -> None:
    rng = np.random.default_rng(0)
    assert kept("none", 5, rng) == [0, 1, 2, 3, 4]
    assert kept("one of three", 9, rng) == [0, 1, 3, 4, 6, 7]
    assert len(kept("30%", 10_000, rng)) == pytest.approx(10_000 * (1.0 - SHARE), rel=0.05)


def test_gaps_are_as_long_and_as_far_apart_as_it_says() -> None:
    steps = np.diff(kept("gaps", 10_000, np.random.default_rng(0)))
    gaps = np.flatnonzero(steps > 1)
    assert set(steps[gaps] - 1) == set(range(GAP[0], GAP[1] + 1))
    assert set(np.diff(gaps)) == set(range(APART[0], APART[1] + 1))
