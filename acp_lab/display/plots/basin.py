"""Pictures of basins of convergence: a map per method, and one curve each for comparison."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from acp_lab.display.colours import OBJECT_COLOURS
from acp_lab.studies.basin import Basin

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def basin_figure(basins: Sequence[Basin]) -> Figure:
    """The maps of some methods beside each other, then how their shares fall with the angle."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(3.4 * (len(basins) + 1), 3.6), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(1, len(basins) + 1, squeeze=False)[0]
    for axis, basin in zip(axes, basins, strict=False):
        draw_basin(axis, basin)
    draw_basin_curves(axes[-1], basins)
    return figure


def draw_basin(axes: Axes, basin: Basin) -> None:
    """One method: a cell per disturbance, light where most trials are found; the numbers are percent."""
    share = basin.share
    axes.imshow(share, cmap="cividis", vmin=0.0, vmax=1.0, origin="lower", aspect="auto")
    for (row, column), value in np.ndenumerate(share):
        ink = "black" if value > 0.5 else "white"
        axes.text(column, row, f"{100.0 * value:.0f}", ha="center", va="center", fontsize=8, color=ink)
    axes.set_xticks(range(len(basin.shifts_mm)), [f"{shift:g}" for shift in basin.shifts_mm])
    axes.set_yticks(range(len(basin.angles_deg)), [f"{angle:g}" for angle in basin.angles_deg])
    axes.set_xlabel("shift of the start [mm]")
    axes.set_ylabel("turn of the start [degrees]")
    axes.set_title(f"{basin.name}: found [%]", fontsize=9)


def draw_basin_curves(axes: Axes, basins: Sequence[Basin]) -> None:
    """Some methods: the share found at each angle, mean over the shifts."""
    for order, basin in enumerate(basins):
        colour = OBJECT_COLOURS[order % len(OBJECT_COLOURS)]
        axes.plot(basin.angles_deg, basin.share.mean(1), "-o", color=colour, markersize=4.0, label=basin.name)
    axes.set_xlabel("turn of the start [degrees]")
    axes.set_ylabel("share found, mean over shifts")
    axes.set_ylim(-0.02, 1.02)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
