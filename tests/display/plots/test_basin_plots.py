"""Pictures of basins of convergence."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from acp_lab.display.plots.basin import basin_figure, draw_basin
from acp_lab.studies.basin import Basin


def made_basin(name: str = "fake") -> Basin:
    errors = np.full((3, 2, 4), 0.5)
    errors[0] = 0.001
    errors[1, 0, :2] = 0.001
    return Basin(name, np.array([0.0, 2.0, 5.0]), np.array([0.0, 4.0]), errors, 0.02)


def test_a_basin_map_shows_the_shares() -> None:
    axes = Figure().subplots()
    draw_basin(axes, made_basin())
    shown = np.asarray(axes.images[0].get_array())
    np.testing.assert_allclose(shown, [[1.0, 1.0], [0.5, 0.0], [0.0, 0.0]])
    assert [text.get_text() for text in axes.texts] == ["100", "100", "50", "0", "0", "0"]


def test_basins_stand_beside_each_other() -> None:
    figure = basin_figure([made_basin("one"), made_basin("two")])
    figure.canvas.draw()
    assert len(figure.axes) == 3
    np.testing.assert_allclose(figure.axes[2].lines[0].get_ydata(), [1.0, 0.25, 0.0])
