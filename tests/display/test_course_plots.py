"""The pictures of the notebooks: what is drawn where, in which colour, from made-up studies."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from acp_lab.control_points.view_regions import sphere_directions
from acp_lab.display.look import GENERATED, POINTS, TRUTH
from acp_lab.display.plots.loss_study import draw_erased, draw_found, draw_landscape, draw_losses, draw_printed
from acp_lab.display.plots.manipulation import draw_growth, draw_ways
from acp_lab.display.plots.redundancy import draw_descents, draw_directions, draw_drifts
from acp_lab.display.plots.view_regions import (
    REGION_COLOURS,
    draw_box,
    draw_moved,
    draw_regions,
    draw_residuals,
    draw_tilts,
)
from acp_lab.generator.base import GeneratedEdges
from acp_lab.imaging.chamfer import Chamfer
from acp_lab.studies.landscape import POSE_COORDINATES, Descent, LossSlice
from acp_lab.studies.loss_study import LossStudy
from acp_lab.studies.manipulation import Manipulated, ManipulationStudy
from acp_lab.studies.redundancy import Drift
from tests.made_parts import bracket

QUAD = np.array([[10.0, 10.0], [60.0, 12.0], [62.0, 50.0], [8.0, 48.0]])


def axes_of(count: int = 1, projection: str | None = None):  # type: ignore[no-untyped-def]
    figure = Figure()
    return [figure.add_subplot(1, count, i + 1, projection=projection) for i in range(count)]


def test_losses_end_at_their_largest_value_and_mark_alpha() -> None:
    value, pull = axes_of(2)
    draw_losses(value, pull, ("tukey", "geman-mcclure"), 8.0)
    curves = [line.get_ydata() for line in value.lines if line.get_label() in ("tukey", "geman-mcclure")]
    assert [max(curve) for curve in curves] == pytest.approx([1.0, 1.0])
    assert any(list(line.get_xdata()) == [8.0, 8.0] for line in pull.lines)


def test_the_printed_form_has_two_branches() -> None:
    (axes,) = axes_of()
    draw_printed(axes, 8.0)
    below, above = axes.lines[:2]
    assert min(below.get_ydata()) >= 1.0 - 1e-3
    assert max(above.get_ydata()) < 0.0
    assert max(below.get_xdata()) < 8.0 < min(above.get_xdata())


def test_landscape_marks_the_lowest_value_and_the_ways() -> None:
    u, v = POSE_COORDINATES[3], POSE_COORDINATES[1]
    offsets = np.linspace(-4.0, 4.0, 9)
    distances = np.hypot(offsets[None] - 2.0, offsets[:, None] + 1.0)[..., None]
    over = LossSlice(u, v, offsets, offsets, distances, np.ones(1))
    way = np.zeros((2, 6))
    way[0, u.index], way[0, v.index] = 3.0, 2.0 * v.unit_step
    (axes,) = axes_of()
    draw_landscape(axes, over, "geman-mcclure", 5.0, {"fixed": Descent(way, np.zeros(2))})
    lines = {line.get_label(): np.column_stack(line.get_data()) for line in axes.lines}
    np.testing.assert_allclose(lines["lowest value"], [[2.0, -1.0]])
    np.testing.assert_allclose(lines["fixed"], [[3.0, 2.0], [0.0, 0.0]])
    assert axes.get_xlabel() == "shift along x [mm]"


def test_studies_of_losses() -> None:
    errors = np.array([[[0.01, 0.03], [0.04, 0.06]], [[0.05, 0.05], [0.5, 0.7]]])
    study = LossStudy(("tight", "wide"), (0.0, 0.4), errors, 0.02)
    curves, bars = axes_of(2)
    draw_erased(curves, study)
    np.testing.assert_allclose(curves.lines[0].get_data(), ([0.0, 40.0], [2.0, 5.0]))
    draw_found(bars, {"near": study, "far": study})
    assert [bar.get_width() for bar in bars.patches] == pytest.approx([0.5, 0.0, 0.5, 0.0])
    assert [label.get_text() for label in bars.get_yticklabels()] == ["tight", "wide"]


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
