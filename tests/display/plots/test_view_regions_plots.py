"""Pictures of view regions and of what a homography leaves unexplained."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.colors import to_rgb

from acp_lab.control_points.view_regions import sphere_directions
from acp_lab.display.plots.view_regions import (
    REGION_COLOURS,
    draw_box,
    draw_moved,
    draw_regions,
    draw_residuals,
    draw_tilts,
)
from tests.display.blank_axes import axes_of
from tests.made_parts import bracket

QUAD = np.array([[10.0, 10.0], [60.0, 12.0], [62.0, 50.0], [8.0, 48.0]])


def test_regions_have_their_colours_and_only_the_near_side_is_drawn() -> None:
    (axes,) = axes_of(projection="3d")
    axes.view_init(elev=90.0, azim=0.0)
    directions = sphere_directions(300)
    draw_regions(axes, bracket(), directions)
    drawn = {line.get_label(): line for line in axes.lines}
    assert to_rgb(drawn["+z"].get_color()) == pytest.approx(REGION_COLOURS[4])
    assert len(drawn["-z"].get_data_3d()[0]) == 0
    assert sum(len(line.get_data_3d()[0]) for line in axes.lines) == (directions[:, 2] > 0.0).sum()
    draw_box(axes, bracket())
    assert len(axes.collections[-1]._segments3d) == 12


def test_tilts_moved_points_and_residuals() -> None:
    tilt, moved, bars = axes_of(3)
    values = np.add.outer(np.arange(5.0), np.arange(5.0))
    assert draw_tilts(tilt, np.linspace(-0.5, 0.5, 5), values, np.array([[0.0, 0.0], [0.2, -0.1]])) is not None
    np.testing.assert_allclose(tilt.lines[1].get_data(), ([0.0, 0.2], [0.0, -0.1]))
    draw_moved(moved, QUAD, np.array([0.0, 1.0, 3.0, 9.0]))
    colours = moved.collections[0].get_facecolors()
    np.testing.assert_allclose(colours[2], colours[3])
    assert (colours[0] != colours[2]).any()
    draw_residuals(bars, {"edges move": (1.0, 4.0), "unexplained": (0.9, 0.2)}, ("1°", "4 mm"))
    assert [bar.get_width() for bar in bars.patches] == [1.0, 4.0, 0.9, 0.2]
