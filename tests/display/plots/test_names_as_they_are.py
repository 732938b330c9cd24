"""Names of methods, files and sequences that look like formulas."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from acp_lab.bench.protocol import SequenceKey, Variant
from acp_lab.bench.report import Report
from acp_lab.display.plots.accuracy import draw_errors, draw_recall
from acp_lab.display.plots.bench import bench_figure, figure_svg
from acp_lab.display.plots.pose_parameters import draw_pose_errors, draw_pose_parameters
from acp_lab.display.plots.summary import Curves, draw_curves
from acp_lab.evaluation.metrics import FrameErrors
from acp_lab.studies.pose_parameters import PoseParameters
from tests.bench.made_runs import made_run
from tests.display.blank_axes import axes_of

NAMES = ("costs $5 and $6", r"$\frac$")
"""Words that would be a formula, and a formula that is none: this one would be refused."""


def shown(figure: Figure) -> str:
    """All that is written in a figure, drawn; matplotlib raises ValueError for a formula that is none."""
    return re.sub("<!--.*?-->", "", figure_svg(figure))  # comments hold formulas as they were typed


def errors() -> FrameErrors:
    return FrameErrors((1, 2), np.array([0.01, 0.02]), np.zeros(2), np.zeros(2), np.zeros(2))


def parameters() -> PoseParameters:
    return PoseParameters((1, 2), np.zeros((2, 6)), np.ones((2, 6)))


def curves(name: str) -> Curves:
    return Curves(name, [1, 2], [1.0, 2.0], [0.5, 0.5], [3.0, 4.0])


DRAWN: dict[str, Callable[[Any, str], object]] = {
    "errors": lambda axes, name: (draw_errors(axes[0], {name: errors()}), axes[0].legend()),
    "recall": lambda axes, name: draw_recall(axes[0], {name: errors()}),
    "parameters": lambda axes, name: draw_pose_parameters(axes, {name: parameters()}),
    "off": lambda axes, name: draw_pose_errors(axes, {name: parameters()}),
    "summary": lambda axes, name: draw_curves(axes[:3], [curves(name), curves("another")]),
}


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("what", DRAWN)
def test_a_plot_shows_a_name_as_it_is(what: str, name: str) -> None:
    axes = axes_of(6)
    DRAWN[what](axes, name)
    assert name in shown(axes[0].figure)


@pytest.mark.parametrize("name", NAMES)
def test_a_bench_shows_the_name_of_an_outside_tracker_as_it_is(name: str) -> None:
    key = SequenceKey(name, 1, 1)
    offs = [Variant(), Variant(2), Variant(noise_deg=2.0)]
    runs = [made_run([0.01, 0.02], method, key, how) for method in (name, "other") for how in offs]
    report = Report.of([replace(run, prepare_s=3.0) for run in runs], "")
    text = shown(bench_figure(report.runs, report.rows, report.basins))
    assert text.count(name) == 3  # beside its point, its bar, and in the legend
