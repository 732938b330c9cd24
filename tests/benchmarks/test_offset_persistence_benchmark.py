"""The table of how long offsets last."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.offset_persistence import rows_of


def test_sequences_without_such_frames_do_not_count() -> None:
    found = [np.array([0.2, np.nan, 0.5]), np.array([0.4, np.nan, np.nan]), np.array([0.6, np.nan, 0.1])]
    rows = rows_of(["near", "nowhere", "far"], found)
    assert list(rows) == ["near", "far"]
    assert rows["near"] == pytest.approx({"median": 0.4, "low": 0.3, "high": 0.5, "sequences": 3})
    assert rows["far"] == pytest.approx({"median": 0.3, "low": 0.2, "high": 0.4, "sequences": 2})
