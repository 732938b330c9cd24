"""The six panels show what the study computed."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from acp_lab.display.plots.pose_parameters import draw_pose_errors, draw_pose_parameters
from acp_lab.studies.pose_parameters import NAMES, PoseParameters


def test_six_panels_with_the_truth_and_each_run() -> None:
    true = np.arange(18.0).reshape(3, 6)
    runs = {name: PoseParameters(np.array([0, 1, 5]), true + off, true) for name, off in (("a", 0.5), ("b", -1.0))}
    panels = Figure().subplots(2, 3).ravel()
    draw_pose_parameters(panels, runs)
    for number, (panel, name) in enumerate(zip(panels, NAMES, strict=True)):
        assert panel.get_title() == name
        drawn = [line.get_ydata().tolist() for line in panel.lines]
        column = true[:, number]
        assert drawn == [column.tolist(), (column + 0.5).tolist(), (column - 1.0).tolist()]
        assert panel.lines[1].get_xdata().tolist() == [0, 1, 5]
    assert [text.get_text() for text in panels[0].get_legend().get_texts()] == ["truth", "a", "b"]
    panels = Figure().subplots(2, 3).ravel()
    draw_pose_errors(panels, runs)
    for panel in panels:
        assert [float(line.get_ydata()[0]) for line in panel.lines] == [0.0, 0.5, -1.0]
