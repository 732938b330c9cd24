"""Pictures of ways to manipulate edges."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.colors import to_rgb

from acp_lab.display.look import GENERATED, POINTS, TRUTH
from acp_lab.display.plots.manipulation import draw_growth, draw_ways
from acp_lab.generator.base import GeneratedEdges
from acp_lab.imaging.chamfer import Chamfer
from acp_lab.studies.manipulation import Manipulated, ManipulationStudy
from tests.display.blank_axes import axes_of

QUAD = np.array([[10.0, 10.0], [60.0, 12.0], [62.0, 50.0], [8.0, 48.0]])


def test_ways_of_manipulating() -> None:
    edges = GeneratedEdges(QUAD, np.tile([1.0, 0.0], (4, 1)), np.ones(4), np.arange(4))
    ways = (Manipulated("homography", False, edges, Chamfer(1.0, 2.0)), Manipulated("t(I)", True, edges, None))
    axes = axes_of(2)
    draw_ways(axes, ManipulationStudy(np.eye(4), 0.0, edges, ways), QUAD)
    assert [axis.get_title() for axis in axes] == ["homography\nChamfer 1.50 px", "t(I)\nno edges"]
    colours = [tuple(lines.get_color()[0][:3]) for lines in axes[0].collections]
    assert colours == [pytest.approx(TRUTH), pytest.approx(GENERATED)]
    assert to_rgb(axes[0].lines[0].get_color()) == pytest.approx(POINTS)
    (growth,) = axes_of()
    draw_growth(growth, np.arange(3.0), {"homography": [0.0, 1.0, 2.0]}, "turn [°]")
    np.testing.assert_allclose(growth.lines[0].get_ydata(), [0.0, 1.0, 2.0])
    assert growth.get_xlabel() == "turn [°]"
