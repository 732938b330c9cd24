"""Curves for the browser, and the cursor on them."""

from __future__ import annotations

import numpy as np

from acp_lab.display.colours import BLUE
from acp_lab.display.widgets.curve_plot import Curve, CurvePlot, Mark


def plot() -> CurvePlot:
    return CurvePlot([0, 2, 5], [Curve(np.array([1.0, np.nan, 3.0]), BLUE, "ADD [%]")], [Mark(2.0, "ADD [%]", "2%")])


def test_values_go_as_bytes_with_their_gaps() -> None:
    state = plot().get_state()
    assert np.frombuffer(state["x"], np.float32).tolist() == [0.0, 2.0, 5.0]
    (sent,) = state["curves"]
    values = np.frombuffer(sent["data"], np.float32)
    assert np.isnan(values[1])
    assert values[[0, 2]].tolist() == [1.0, 3.0]
    assert state["marks"] == [{"value": 2.0, "row": "ADD [%]", "label": "2%"}]


def test_the_cursor_stays_on_the_curve() -> None:
    made = plot()
    made.set_state({"cursor": 2})
    assert made.cursor == 2
    made.cursor = 17
    assert made.cursor == 2
    made.cursor = -4
    assert made.cursor == 0
    assert CurvePlot([], [], cursor=3).cursor == 0
