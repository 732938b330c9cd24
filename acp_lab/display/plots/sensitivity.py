"""Pictures of a sensitivity study: the paper's Figure 1 with numbers in it.

Convention: the draw functions take axes, for notebooks; `sensitivity_figure` makes a whole figure without a display.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from acp_lab.display.colours import BLUE, GREEN, GREY, ORANGE, PURPLE
from acp_lab.display.look import INK
from acp_lab.geometry.arrays import FloatArray
from acp_lab.studies.sensitivity import ALONE, POSE_NAMES, Behaviour, SensitivityStudy

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SET_COLOURS = (BLUE, GREEN, ORANGE, PURPLE)
"""One per set of parameters, in the order of the study."""


def sensitivity_figure(study: SensitivityStudy, view: int = 0) -> Figure:
    """All of it: the colour tables of one view, then sensitivities, conditions and cosines over all views."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(14.0, 8.5), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    top, bottom = np.asarray(figure.subfigures(2, 1, height_ratios=[1.0, 1.05]))
    tables = top.subplots(1, 4, width_ratios=[6, 6, 8, 8])
    draw_change_table(tables[0], study["balanced pose"], view, "truths", "true change of the pose")
    draw_change_table(tables[1], study["balanced pose"], view, "gradients", "gradient by the pose")
    draw_change_table(tables[2], study["points, homography"], view, "truths", "true change of the points")
    draw_change_table(tables[3], study["points, homography"], view, "gradients", "gradient by the points")
    top.suptitle("six motions in one view, each row scaled to its largest entry (rotations as mm of arc)", fontsize=10)
    rows = bottom.subplots(1, 4, width_ratios=[1.5, 1.0, 1.0, 1.0])
    draw_sensitivities(rows[0], study)
    draw_conditions(rows[1], study)
    draw_cosines(rows[2], study, "gradient_cosine", "gradient")
    draw_cosines(rows[3], study, "step_cosine", "Gauss-Newton")
    return figure


def draw_change_table(axes: Axes, one: Behaviour, view: int, what: str, title: str) -> None:
    """A colour table: a row per motion of one pose parameter alone, a column per parameter of the set.

    what: "truths", "gradients" or "steps". Each row is divided by its largest entry; blue is below 0.
    """
    values = getattr(one, what)[view, :ALONE]
    values = values / np.maximum(np.abs(values).max(1, keepdims=True), 1e-300)
    axes.imshow(values, cmap="RdBu_r", vmin=-1.0, vmax=1.0, aspect="auto")
    for (row, column), value in np.ndenumerate(values):
        ink = "white" if abs(value) > 0.6 else "black"
        axes.text(column, row, f"{value:.1f}".replace("-0.0", "0.0"), ha="center", va="center", fontsize=7, color=ink)
    axes.set_xticks(range(len(one.parameters)), one.parameters, rotation=60, fontsize=8)
    axes.set_yticks(range(ALONE), POSE_NAMES, fontsize=8)
    axes.set_title(title, fontsize=9)


def draw_sensitivities(axes: Axes, study: SensitivityStudy) -> None:
    """The spread over the views of each parameter's effect on the edges, px for a typical step of it."""
    labels: list[str] = []
    for colour, name in ((GREEN, "balanced pose"), (ORANGE, "points, homography")):
        one = study[name]
        places = range(len(labels), len(labels) + len(one.parameters))
        _boxes(axes, list(one.sensitivity.T), places, [colour] * len(one.parameters))
        labels += one.parameters
    axes.set_xticks(range(len(labels)), labels, rotation=60, fontsize=8)
    axes.set_yscale("log")
    axes.set_title("px of edge motion per mm (pose) or px (points)", fontsize=9)
    axes.grid(axis="y", alpha=0.3)


def draw_conditions(axes: Axes, study: SensitivityStudy) -> None:
    """The condition of each set's Jacobian over the views, on a log scale."""
    _boxes(axes, [one.condition for one in study.sets], range(len(study.sets)), SET_COLOURS)
    _name_sets(axes, study)
    axes.set_yscale("log")
    axes.set_title("condition of the Jacobian", fontsize=9)
    axes.grid(axis="y", alpha=0.3)


def draw_cosines(axes: Axes, study: SensitivityStudy, what: str, title: str) -> None:
    """Cosine between a direction ("gradient_cosine" or "step_cosine") and the true change, mixed motions."""
    _boxes(axes, [getattr(one, what)[:, ALONE:].ravel() for one in study.sets], range(len(study.sets)), SET_COLOURS)
    _name_sets(axes, study)
    axes.axhline(0.0, color=GREY, linestyle="--", linewidth=0.8)
    axes.set_ylim(-1.05, 1.05)
    axes.set_title(f"{title}: cosine with truth", fontsize=9)
    axes.grid(axis="y", alpha=0.3)


def _boxes(axes: Axes, groups: list[FloatArray], places: range, colours: Any) -> None:
    """Boxes from quartile to quartile, whiskers from 5 to 95%."""
    drawn = axes.boxplot(groups, positions=list(places), widths=0.6, whis=(5, 95), showfliers=False, patch_artist=True)
    for box, colour in zip(drawn["boxes"], colours, strict=True):
        box.set_facecolor((*colour, 0.5))
        box.set_edgecolor(colour)
    for median in drawn["medians"]:
        median.set_color(INK)


def _name_sets(axes: Axes, study: SensitivityStudy) -> None:
    names = [one.name.replace(" ", "\n", 1) for one in study.sets]
    axes.set_xticks(range(len(names)), names, fontsize=8)
