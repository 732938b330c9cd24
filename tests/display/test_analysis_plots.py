"""Pictures of ambiguous pairs and of basins."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from acp_lab.cad.edges import sample_edges
from acp_lab.cad.raycast import make_caster
from acp_lab.display.plots.ambiguity import ambiguity_figure
from acp_lab.display.plots.basin import basin_figure, draw_basin
from acp_lab.geometry.camera import Camera
from acp_lab.studies.ambiguity import Ambiguities, AmbiguousPair
from acp_lab.studies.basin import Basin
from tests.made_parts import bracket, looking_at


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


def test_a_pair_is_drawn_with_both_contours_and_both_pictures() -> None:
    part = bracket()
    poses = [
        looking_at(part, direction, 200.0) for direction in (np.array([0.2, 0.1, 1.0]), np.array([0.2, 0.1, -1.0]))
    ]
    found = Ambiguities(Camera(96, 96, 250.0, 250.0, 47.5, 47.5), (AmbiguousPair(*poses, 170.0, 0.01, 0.04),))
    figure = ambiguity_figure(part, sample_edges(part), make_caster(part), found)
    figure.canvas.draw()
    contours, edges, first, second = figure.axes
    assert len(contours.lines) == 2
    assert len(edges.collections) == 2
    assert "1.00%" in contours.get_title()
    assert "4.00%" in edges.get_title()
    assert not np.array_equal(first.images[0].get_array(), second.images[0].get_array())
