"""What is allowed and what was reached, a panel per sequence."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.display.plots.pose_bound import BoundCurves, bound_figure


def curves(name: str) -> BoundCurves:
    ids, reached = np.array([2, 4, 6]), np.array([0.01, 0.02, 0.03])
    return BoundCurves(name, ids, reached, np.full((2, 3), 0.04), np.full(3, 0.002), np.full(3, 0.015), np.full(3, 0.1))


@pytest.mark.parametrize(("count", "panels"), [(0, 0), (1, 1), (5, 5)])
def test_every_sequence_has_a_panel_with_all_its_curves_in_percent(count: int, panels: int) -> None:
    figure = bound_figure([curves(f"costs $5 and ${i}") for i in range(count)], limit=0.02)
    shown = [axes for axes in figure.axes if axes.axison]
    assert len(shown) == panels
    for axes in shown:
        drawn = {str(line.get_label()): np.asarray(line.get_ydata()) for line in axes.lines}
        np.testing.assert_allclose(drawn["reached from the true start"], [1.0, 2.0, 3.0])
        np.testing.assert_allclose(drawn["reached from starts that are off"], 4.0)
        np.testing.assert_allclose(drawn["allowed, offsets of the first frame"], 0.2)
        np.testing.assert_allclose(drawn["allowed, offsets unknown"], 1.5)
        np.testing.assert_allclose(drawn["shown by the frame alone"], 10.0)
        assert any(np.allclose(line.get_ydata(), 2.0) for line in axes.lines if len(line.get_ydata()) == 2)
    figure.canvas.draw()
