"""The error that displays show."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.display.accuracy import AddPercent
from tests.display.made_run import box, true_pose


def test_add_in_percent_of_the_diameter() -> None:
    part = box()
    moved = true_pose(0)
    moved[0, 3] += 0.02 * part.diameter
    error = AddPercent(part)
    assert error(moved, true_pose(0)) == pytest.approx(2.0)
    assert np.isnan(error(moved, None))
