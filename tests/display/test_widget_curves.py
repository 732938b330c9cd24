"""Curves for the browser, and the cursor on them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from acp_lab.display.colours import BLUE
from acp_lab.display.widgets.curve_plot import Curve, CurvePlot, Mark
from tests.display.node_page import in_node


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


_PLOT = """
const empty = { curves: [], marks: [], limits: [0, 1], cursor: 0, title: "", x_label: "image id" };
"""


def test_a_plot_without_points_is_drawn_in_the_browser(tmp_path: Path) -> None:
    """It hung the page: a live window begins with one."""
    trial = """
    const model = new Model({ ...empty, x: bytes() });
    const el = page();
    const destroy = widget.render({ model, el });
    const ticks = () => el.of("acp-tick acp-tick-x").map((node) => node.textContent);
    const without = ticks();
    model.change("x", bytes(0, 10));
    const one = { data: bytes(0.2, 0.4), colour: "red", row: "quality", label: "" };
    model.change("curves", [one]);
    const ids = ticks();
    model.change("x", bytes(Infinity, NaN));
    const endless = ticks();
    destroy();
    tell({ without, ids, endless, listeners: model.listeners });
    """
    told = in_node(tmp_path, CurvePlot._esm, _PLOT + trial)
    assert told["without"] == ["0.0", "0.5", "1.0", "image id"]
    assert told["ids"] == ["0", "5", "10", "image id"]
    assert told["endless"] == ["image id"]
    assert told["listeners"] == 0


def test_a_value_that_was_cut_is_read_as_cut(tmp_path: Path) -> None:
    trial = """
    const curve = (most) => ({ data: bytes(20, 3), colour: "red", row: "ADD", label: "acp", most });
    const model = new Model({ ...empty, x: bytes(0, 1), curves: [curve(20), curve(null)] });
    const el = page();
    widget.render({ model, el });
    const words = () => el.of("acp-heading")[0].children.map((node) => node.textContent);
    const readings = () => words().filter((_, i) => i && i % 2 === 0);
    const first = readings();
    model.change("cursor", 1);
    tell([first, readings()]);
    """
    first, second = in_node(tmp_path, CurvePlot._esm, _PLOT + trial)
    assert first == ["acp ≥ 20.0", "acp 20.0"]
    assert second == ["acp 3.00", "acp 3.00"]


def test_a_plot_that_is_taken_away_still_tells_where_its_cursor_was(tmp_path: Path) -> None:
    trial = """
    const model = new Model({ ...empty, x: bytes(0, 10) });
    const el = page();
    const destroy = widget.render({ model, el });
    const key = { key: "End", preventDefault() {}, stopPropagation() {} };
    el.of("acp-curves")[0].listeners.keydown(key);
    const before = model.saved;
    destroy();
    nextFrame();
    tell({ before, after: model.saved, cursor: model.get("cursor") });
    """
    assert in_node(tmp_path, CurvePlot._esm, _PLOT + trial) == {"before": 0, "after": 1, "cursor": 1}


def test_long_ticks_are_written_with_an_exponent(tmp_path: Path) -> None:
    trial = """
    const model = new Model({ ...empty, limits: [], x: bytes(0, 1) });
    const el = page();
    widget.render({ model, el });
    const texts = (name) => el.of(name).map((node) => node.textContent);
    const rows = [];
    for (const high of [3.9e6, 2e-7, 5e5, 40]) {
      model.change("curves", [{ data: bytes(0, high), colour: "red", row: "e", label: "" }]);
      rows.push(texts("acp-tick"));
    }
    model.change("x", bytes(0, 2e6));
    const wide = texts("acp-tick acp-tick-x");
    model.change("x", bytes(1234560, 1234568));
    tell({ rows, wide, ids: texts("acp-tick acp-tick-x") });
    """
    told = in_node(tmp_path, CurvePlot._esm, _PLOT + trial)
    assert told["rows"] == [
        ["0", "2e6", "4e6"],
        ["0", "1e-7", "2e-7"],
        ["0", "200000", "400000"],
        ["0", "20", "40"],
    ]
    assert told["wide"] == ["0", "5e5", "1e6", "1.5e6", "2e6", "image id"]
    assert told["ids"] == ["1234560", "1234562", "1234564", "1234566", "1234568", "image id"]


def test_only_a_hand_that_pressed_the_plot_moves_its_cursor(tmp_path: Path) -> None:
    trial = """
    const model = new Model({ ...empty, x: bytes(0, 10, 20) });
    const el = page();
    widget.render({ model, el });
    const plot = el.of("acp-curves")[0];
    const at = (clientX) => ({ pointerId: 1, buttons: 1, button: 0, clientX });
    plot.listeners.pointermove(at(600)); // text is selected across it
    const passing = model.get("cursor");
    plot.listeners.pointerdown(at(300));
    plot.listeners.pointermove(at(600));
    tell([passing, model.get("cursor")]);
    """
    assert in_node(tmp_path, CurvePlot._esm, _PLOT + trial) == [0, 2]
