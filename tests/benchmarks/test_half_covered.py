"""Which box of a picture is covered, and what is made of the frames that follow."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.half_covered import COVERED, FREE, SEEN, HalfCovered, _row, board

BOX = (10, 20, 110, 60)


def test_a_board_covers_a_share_from_each_side() -> None:
    assert [board(BOX, 0.5, side) for side in range(4)] == [
        (10, 20, 60, 60), (10, 20, 110, 40), (60, 20, 110, 60), (10, 40, 110, 60),
    ]  # fmt: skip
    assert board(BOX, 0.25, 2) == (85, 20, 110, 60)
    assert board(None, 0.5, 0) is None


def run(wrong_until: int, error: float = 0.2, tracking: bool = True) -> HalfCovered:
    """Right before the cover, then wrong until a frame, right again from there on."""
    errors = np.full(SEEN + COVERED + FREE, 0.01)
    errors[SEEN:wrong_until] = error
    return HalfCovered(errors, (tracking,) * len(errors), (5.0,) * COVERED)


def test_a_part_is_back_when_it_is_right_soon_after_the_cover() -> None:
    free = SEEN + COVERED
    assert run(free).is_back
    assert run(free + 9).is_back
    assert not run(free + 10).is_back
    assert not run(free, tracking=False).is_back


def test_a_row_tells_of_covered_frames_of_later_ones_and_of_the_longest_false_row() -> None:
    row = _row([run(SEEN), run(SEEN + COVERED + FREE, error=0.4)])
    assert row["runs"] == 2
    assert row["@5"] == row["tracking"] - 0.5 == row["astray"] == row["back"] == pytest.approx(0.5)
    assert row["false"] == COVERED + FREE
    assert row["ms"] == pytest.approx(5.0)
    assert _row([run(SEEN + COVERED + FREE, error=0.4, tracking=False)])["false"] == 0
