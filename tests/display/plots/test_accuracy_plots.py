"""Pictures of errors, recall and tables of methods."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.display.plots.accuracy import draw_depth_errors, draw_errors, draw_recall, draw_table
from acp_lab.evaluation.metrics import FrameErrors, area_under_curve
from acp_lab.evaluation.paper_tables import MethodRow, Table
from acp_lab.studies.shared_errors import SharedErrors
from tests.display.blank_axes import axes_of


def errors(*shares: float) -> FrameErrors:
    """Frames with these ADD, shares of the diameter."""
    zeros = np.zeros(len(shares))
    return FrameErrors(tuple(range(len(shares))), np.array(shares), zeros, zeros, zeros)


def test_errors_are_in_percent_and_the_lost_stay_on_the_axes() -> None:
    (axes,) = axes_of()
    draw_errors(axes, {"one": errors(0.01, 0.2, np.inf)})
    np.testing.assert_allclose(axes.lines[0].get_ydata(), [1.0, 20.0, 60.0])


def test_the_area_drawn_is_the_one_of_the_scores() -> None:
    (axes,) = axes_of()
    run = errors(0.01, 0.03, 0.06, 0.4)
    draw_recall(axes, {"one": run})
    assert axes.lines[0].get_ydata()[-1] == pytest.approx(0.75)
    assert axes.lines[0].get_label() == f"one: AUC {area_under_curve(run.distance, 0.1):.2f}"


def test_depth_errors_of_two_trackers_by_frame() -> None:
    (axes,) = axes_of()
    zeros, first_mm, second_mm = np.zeros(3), np.zeros((3, 3)), np.zeros((3, 3))
    first_mm[:, 2], second_mm[:, 2] = (1.0, 2.0, -1.0), (0.5, 0.0, 0.0)
    study = SharedErrors(np.array([4, 5, 7]), zeros, zeros, zeros, first_mm, second_mm, np.zeros((3, 3)))
    draw_depth_errors(axes, study, ("one", "other"))
    assert [line.get_label() for line in axes.lines[:2]] == ["one", "other"]
    np.testing.assert_array_equal(axes.lines[0].get_xdata(), [4, 5, 7])
    np.testing.assert_allclose(axes.lines[0].get_ydata(), [1.0, 2.0, -1.0])


def test_a_table_has_a_row_per_method_and_two_dots_each() -> None:
    (axes,) = axes_of()
    rows = (MethodRow("one", (0.2, 0.4), (0.6, 0.8)), MethodRow("two", (0.1, 0.1), (0.2, 0.2)))
    draw_table(axes, Table("made", ("a", "b"), rows), "title")
    assert [label.get_text() for label in axes.get_yticklabels()] == ["one", "two"]
    np.testing.assert_allclose(axes.lines[0].get_xdata(), [0.3, 0.7])
    np.testing.assert_allclose(axes.lines[3].get_xdata(), [0.1, 0.2])
