"""Pictures of losses, of landscapes and of studies of both."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.display.plots.loss_study import draw_erased, draw_found_shares, draw_landscape, draw_losses, draw_printed
from acp_lab.studies.landscape import POSE_COORDINATES, Descent, LossSlice
from acp_lab.studies.loss_study import LossStudy
from tests.display.blank_axes import axes_of


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
    draw_found_shares(bars, {"near": study, "far": study})
    assert [bar.get_width() for bar in bars.patches] == pytest.approx([0.5, 0.0, 0.5, 0.0])
    assert [label.get_text() for label in bars.get_yticklabels()] == ["tight", "wide"]
