"""The benchmark of parts that are alike in one picture."""

from __future__ import annotations

import numpy as np

from benchmarks.each_part import Searched, _of_frames, _of_parts

TWO_OF_THREE = Searched(
    np.array([1.0, 0.8, 0.3]),
    np.array([[True, False, False], [False, False, False], [False, True, False], [False, False, True]]),
    np.array([True, True, True, False]),
    1.0,
)
NOTHING = Searched(np.array([0.97]), np.zeros((0, 1), bool), np.zeros(0, bool), 3.0)


def test_parts_are_found_where_an_accepted_hypothesis_is_right() -> None:
    assert _of_parts([TWO_OF_THREE, NOTHING], 0.95) == {"parts": 2, "found": 0.5, "among": 0.5}
    assert _of_parts([TWO_OF_THREE], 0.2) == {"parts": 3, "found": 2 / 3, "among": 1.0}


def test_frames_tell_of_their_best_and_of_all_that_was_accepted() -> None:
    row = _of_frames([TWO_OF_THREE, NOTHING])
    assert row == {"frames": 2, "accepted": 3, "right": 2 / 3, "first": 0.5, "some": 0.5, "time": 2.0}
