"""Bootstrap intervals where the answer is known."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.errors import AcpLabError
from acp_lab.evaluation.bootstrap import bootstrap_mean


def test_certainty_has_no_width() -> None:
    interval = bootstrap_mean([np.ones(30), np.ones(25)])
    assert (interval.mean, interval.low, interval.high) == (1.0, 1.0, 1.0)


def test_sequences_count_alike_whatever_their_length() -> None:
    assert bootstrap_mean([np.ones(10), np.zeros(90)]).mean == 0.5


def test_few_unlike_sequences_leave_much_open(rng: np.random.Generator) -> None:
    few = bootstrap_mean([np.ones(40), np.zeros(40), np.ones(40)])
    many = bootstrap_mean([np.full(40, float(k % 3 != 1)) for k in range(60)])
    assert few.low < 0.1
    assert few.high > 0.9
    assert many.high - many.low < 0.3
    assert many.low < 2 / 3 < many.high


def test_blocks_are_wider_than_independent_frames_would_be() -> None:
    # Twenty frames right, twenty wrong: drawn one by one the mean hardly varies, in blocks it does.
    halves = bootstrap_mean([np.repeat([1.0, 0.0], 20)] * 4)
    mixed = bootstrap_mean([np.tile([1.0, 0.0], 20)] * 4)
    assert halves.high - halves.low > 3.0 * (mixed.high - mixed.low)


@pytest.mark.parametrize(("count", "first", "end"), [(29, 9, 20), (29, 12, 17), (19, 7, 12), (29, 0, 3), (29, 26, 29)])
def test_all_frames_count_alike(count: int, first: int, end: int) -> None:
    """Failures in the middle are no worse than failures at an end."""
    frames = np.ones(count)
    frames[first:end] = 0.0
    interval = bootstrap_mean([frames])
    assert interval.low <= interval.mean <= interval.high
    shifted = bootstrap_mean([np.roll(frames, count // 2)])
    assert interval.low == pytest.approx(shifted.low, abs=0.05)
    assert interval.high == pytest.approx(shifted.high, abs=0.05)


def test_the_mean_that_is_drawn_is_the_mean() -> None:
    """Over many sequences the interval is narrow, and lies around it."""
    frames = np.ones(29)
    frames[9:20] = 0.0
    interval = bootstrap_mean([frames] * 400)
    assert interval.high - interval.low < 0.1
    assert 0.5 * (interval.low + interval.high) == pytest.approx(interval.mean, abs=0.01)


def test_a_sequence_drawn_twice_has_its_blocks_drawn_twice() -> None:
    """Of sequences that are alike it does not matter which are drawn: each of n adds blocks of its own."""
    frames = np.tile(np.repeat([1.0, 0.0], 20), 10)
    one, many = (bootstrap_mean([frames] * count, 20_000) for count in (1, 16))
    assert many.high - many.low == pytest.approx((one.high - one.low) / 4.0, rel=0.1)


def test_runs_of_a_sequence_are_drawn() -> None:
    """Half the starts come to the part and half do not: which were drawn decides, however many frames there are."""
    runs = np.repeat([[1.0], [0.0]] * 3, 50, axis=1)
    interval = bootstrap_mean([runs])
    assert interval.mean == 0.5
    assert interval.low == pytest.approx(1 / 6)  # of six coins at most one shows it in 11% of the draws, none in 1.6%
    assert interval.high == pytest.approx(5 / 6)


def test_runs_of_a_sequence_see_the_same_frames() -> None:
    """A hundred runs that are alike say no more of the frames than one does."""
    frames = np.repeat([1.0, 0.0], 20)
    one, many = bootstrap_mean([frames]), bootstrap_mean([np.tile(frames, (100, 1))])
    assert (many.low, many.high) == pytest.approx((one.low, one.high), abs=0.05)


def test_of_one_run_the_interval_is_that_of_its_blocks() -> None:
    frames = np.repeat([1.0, 0.0, 1.0], [7, 9, 13])
    assert bootstrap_mean([frames, frames[:11]]) == bootstrap_mean([frames[None], frames[None, :11]])
    rows = (np.random.default_rng(0).integers(0, 29, (2000, 3))[:, :, None] + np.arange(10)).reshape(2000, -1) % 29
    low, high = np.quantile(frames[rows[:, :29]].mean(1), [0.025, 0.975])
    found = bootstrap_mean([frames])
    assert (found.low, found.high) == pytest.approx((low, high))


def test_the_same_seed_gives_the_same_interval(rng: np.random.Generator) -> None:
    frames = [rng.uniform(size=33) < 0.6 for _ in range(5)]
    values = [np.asarray(f, float) for f in frames]
    assert bootstrap_mean(values, seed=3) == bootstrap_mean(values, seed=3)


def test_without_frames_there_is_no_interval() -> None:
    for sequences in ([], [np.zeros(0)], [np.zeros((2, 0))]):
        with pytest.raises(AcpLabError, match="give sequences with frames"):
            bootstrap_mean(sequences)
