"""What the edges of each frame allow, beside what was reached: a panel per sequence.

Convention: ADD in % of the part's diameter, on a logarithmic scale.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from acp_lab.display.look import GENERATED, IMAGE, POINTS, TRUTH, UNKNOWN, WRONG, as_it_is
from acp_lab.geometry.arrays import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLUMNS = 4
_RANGE = (0.05, 40.0)


@dataclass(frozen=True, eq=False)
class BoundCurves:
    """Errors of n frames of a sequence, as shares of the diameter.

    Attributes:
        frame_ids: (n,).
        from_truth: (n,) reached from the true first pose; from_off: (seeds, n) from poses that are off.
        known, unknown: (n,) the least that a frame allows, with shared offsets measured in the first frame, and not.
        shown: (n,) of the pose that the edges of each frame alone show.
    """

    name: str
    frame_ids: np.ndarray
    from_truth: FloatArray
    from_off: FloatArray
    known: FloatArray
    unknown: FloatArray
    shown: FloatArray


def bound_figure(sequences: Sequence[BoundCurves], limit: float = 0.02) -> Figure:
    """A panel per sequence. limit: share of the diameter that is drawn across."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    rows = max(1, -(-len(sequences) // _COLUMNS))
    figure = Figure(figsize=(13.0, 0.7 + 2.1 * rows), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(rows, _COLUMNS, squeeze=False, sharey=True).ravel()
    for axes, curves in zip(panels, sequences, strict=False):
        draw_bound(axes, curves, limit)
    for axes in panels[len(sequences) :]:
        axes.set_axis_off()
    if len(sequences):
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), fontsize=9)
        for axes in panels[::_COLUMNS]:
            axes.set_ylabel("ADD [% of diameter]", fontsize=8)
    return figure


def draw_bound(axes: Axes, curves: BoundCurves, limit: float = 0.02) -> None:
    """One sequence."""
    ids = curves.frame_ids
    for number, errors in enumerate(curves.from_off):
        label = "reached from starts that are off" if number == 0 else "_"
        axes.plot(ids, 100.0 * errors, color=UNKNOWN, linewidth=0.8, label=label)
    axes.plot(ids, 100.0 * curves.from_truth, color=POINTS, linewidth=1.6, label="reached from the true start")
    axes.plot(ids, 100.0 * curves.unknown, color=GENERATED, linestyle="--", label="allowed, offsets unknown")
    axes.plot(ids, 100.0 * curves.known, color=TRUTH, linestyle="--", label="allowed, offsets of the first frame")
    axes.plot(ids, 100.0 * curves.shown, ".", color=IMAGE, markersize=4.0, label="shown by the frame alone")
    axes.axhline(100.0 * limit, color=WRONG, linewidth=0.8)
    axes.set_yscale("log")
    axes.set_ylim(*_RANGE)
    axes.set_title(as_it_is(curves.name), fontsize=9)
    axes.tick_params(labelsize=8)
