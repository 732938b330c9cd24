"""Pictures of redundant directions, of drifts along them and of descents."""

from __future__ import annotations

import numpy as np

from acp_lab.display.plots.redundancy import draw_descents, draw_directions, draw_drifts
from acp_lab.studies.redundancy import Drift
from tests.display.blank_axes import axes_of

QUAD = np.array([[10.0, 10.0], [60.0, 12.0], [62.0, 50.0], [8.0, 48.0]])


def test_directions_and_drifts_and_descents() -> None:
    quad, misfit, error, descent = axes_of(4)
    draw_directions(quad, QUAD, np.arange(8.0))
    np.testing.assert_allclose(np.column_stack(quad.lines[1].get_data())[:4], QUAD + np.arange(8.0).reshape(4, 2))
    one = Drift(np.arange(3), np.array([0.0, 2.0, 4.0]), np.array([0.01, 0.05, 0.8]))
    draw_drifts(misfit, error, {"carried": one})
    np.testing.assert_allclose(misfit.lines[0].get_ydata(), [0.0, 2.0, 4.0])
    np.testing.assert_allclose(error.lines[0].get_ydata(), [1.0, 5.0, 10.0])
    draw_descents(descent, {"pose": np.full(13, 0.03)}, 4)
    dotted = [line.get_xdata()[0] for line in descent.lines if line.get_linestyle() == ":"]
    assert dotted == [4.5, 8.5]
