"""Pictures of moving control points: one view of the paper's Fig. 1, redundant directions, drifts, descents.

Convention: px of the image; errors are ADD(-S) in percent of the part's diameter.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from acp_lab.display.colours import OBJECT_COLOURS
from acp_lab.display.look import GENERATED, POINTS, UNKNOWN, Colour
from acp_lab.display.pictures import draw_quad
from acp_lab.display.plots.sensitivity import draw_change_table
from acp_lab.geometry.arrays import FloatArray
from acp_lab.studies.redundancy import Drift
from acp_lab.studies.sensitivity import SensitivityStudy

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_LIMIT_PERCENT = 2.0


def draw_view_tables(axes: Sequence[Axes], study: SensitivityStudy, view: int, what: str) -> None:
    """Five tables of one view: the true change of the pose and what three sets make of it, the same for the points.

    what: "gradients" or "steps". Order: true pose, raw pose, balanced pose, true points, points by homography.
    """
    kind = "gradient" if what == "gradients" else "Gauss-Newton step"
    shown = (
        ("balanced pose", "truths", "true change of the pose"),
        ("pose", what, f"{kind}, pose in rad and mm"),
        ("balanced pose", what, f"{kind}, turns as mm of arc"),
        ("points, homography", "truths", "true change of the points"),
        ("points, homography", what, f"{kind}, points by homography"),
    )
    for axis, (name, values, title) in zip(axes, shown, strict=True):
        draw_change_table(axis, study[name], view, values, title)


def draw_directions(axes: Axes, control_points: FloatArray, step: FloatArray, colour: Colour = GENERATED) -> None:
    """A quad, and arrows along a step (8,) px of its points."""
    moved = control_points + step.reshape(4, 2)
    draw_quad(axes, control_points, POINTS)
    draw_quad(axes, moved, colour, numbers=False, style="--")
    for start, end in zip(control_points, moved, strict=True):
        axes.annotate("", end, start, arrowprops={"arrowstyle": "->", "color": colour, "linewidth": 2.0})


def draw_drifts(misfit_axes: Axes, error_axes: Axes, drifts: Mapping[str, Drift]) -> None:
    """Misfit and error over the frames; an error above a tenth of the diameter is drawn at the upper border."""
    for (name, one), colour in zip(drifts.items(), OBJECT_COLOURS, strict=False):
        misfit_axes.plot(one.frame_ids, one.misfits_px, color=colour, label=name)
        error_axes.plot(one.frame_ids, np.minimum(100.0 * one.errors, 10.0), color=colour, label=name)
    error_axes.axhline(_LIMIT_PERCENT, color=UNKNOWN, linestyle="--", linewidth=0.8)
    misfit_axes.set_ylabel("I beside its own pose, rms [px]")
    error_axes.set_ylabel("ADD(-S) [% of the diameter], up to 10")
    for axes in (misfit_axes, error_axes):
        axes.set_xlabel("frame")
        axes.set_ylim(bottom=0.0)
    error_axes.legend(bbox_to_anchor=(1.0, 1.0), loc="upper left")


def draw_descents(axes: Axes, descents: Mapping[str, FloatArray], steps_per_level: int) -> None:
    """ADD(-S) (k,) as share of the diameter after each step, from the start; lines where alpha gets smaller."""
    longest = 0
    for (name, errors), colour in zip(descents.items(), OBJECT_COLOURS, strict=False):
        axes.plot(100.0 * errors, "-o", color=colour, markersize=3.5, label=name)
        longest = max(longest, len(errors))
    for place in range(steps_per_level, longest - 1, steps_per_level):
        axes.axvline(place + 0.5, color=UNKNOWN, linestyle=":", linewidth=1.0)
    axes.axhline(_LIMIT_PERCENT, color=UNKNOWN, linestyle="--", linewidth=0.8)
    axes.set_xlabel("step (dotted: smaller α, new edges)")
    axes.set_ylabel("ADD(-S) [% of the diameter]")
    axes.set_ylim(bottom=0.0)
    axes.legend()
