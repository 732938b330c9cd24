"""Pictures of accuracy: errors over the frames, recall over the limit, depth errors, tables of methods as dots.

Convention: ADD(-S) in percent of the diameter; shares of frames in [0, 1].
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from acp_lab.display.colours import OBJECT_COLOURS
from acp_lab.display.look import UNKNOWN, as_it_is
from acp_lab.evaluation.metrics import LOST_SHARE, FrameErrors
from acp_lab.evaluation.paper_tables import Table
from acp_lab.studies.shared_errors import SharedErrors

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LARGEST_SHOWN_PERCENT = 60.0


def draw_errors(axes: Axes, runs: Mapping[str, FrameErrors]) -> None:
    """ADD(-S) of each frame, a curve per run, on a logarithmic scale; the limits that scores use as lines."""
    for (name, errors), colour in zip(runs.items(), OBJECT_COLOURS, strict=False):
        percent = np.minimum(100.0 * errors.distance, LARGEST_SHOWN_PERCENT)
        axes.semilogy(errors.frame_ids, percent, color=colour, linewidth=1.5, label=as_it_is(name))
    for limit in (2.0, 5.0, 10.0, 100.0 * LOST_SHARE):
        axes.axhline(limit, color=UNKNOWN, linestyle="--", linewidth=0.8)
    axes.set_yticks([0.5, 1, 2, 5, 10, 30, 60], ["0.5", "1", "2", "5", "10", "30: lost", "60 or more"])
    axes.set_ylim(None, 1.1 * LARGEST_SHOWN_PERCENT)
    axes.minorticks_off()
    axes.set_xlabel("image id")
    axes.set_ylabel("ADD(-S) [% of diameter]")
    axes.legend()


def draw_recall(axes: Axes, runs: Mapping[str, FrameErrors], limit_percent: float = 10.0) -> None:
    """Share of frames below each limit; the area under such a curve, over its width, is its AUC."""
    limits = np.linspace(0.0, limit_percent, 401)
    for (name, errors), colour in zip(runs.items(), OBJECT_COLOURS, strict=False):
        share = (100.0 * errors.distance[:, None] < limits).mean(0)
        axes.plot(limits, share, color=colour, linewidth=1.5, label=f"{as_it_is(name)}: AUC {share.mean():.2f}")
        axes.fill_between(limits, share, color=colour, alpha=0.08, linewidth=0.0)
    for limit in (2.0, 5.0):
        axes.axvline(limit, color=UNKNOWN, linestyle="--", linewidth=0.8)
    axes.set_xlim(0.0, limit_percent)
    axes.set_ylim(0.0, 1.03)
    axes.set_xlabel("limit of ADD(-S) [% of diameter]")
    axes.set_ylabel("share of frames below the limit")
    axes.legend(loc="center right")


def draw_depth_errors(axes: Axes, study: SharedErrors, names: tuple[str, str]) -> None:
    """How far two trackers find the part behind its true place, in each frame; names: theirs."""
    for name, errors_mm, colour in zip(names, (study.first_mm, study.second_mm), OBJECT_COLOURS, strict=False):
        axes.plot(study.frame_ids, errors_mm[:, 2], color=colour, linewidth=1.5, label=as_it_is(name))
    axes.axhline(0.0, color=UNKNOWN, linestyle="--", linewidth=0.8)
    axes.set_xlabel("image id")
    axes.set_ylabel("too far away by [mm]")
    axes.legend()


def draw_table(axes: Axes, table: Table, title: str) -> None:
    """A table as dots: means over its groups, filled ones within 2% of the diameter, hollow ones within 5%."""
    names = [row.name for row in table.rows]
    for place, row in enumerate(table.rows):
        colour = OBJECT_COLOURS[0] if place == 0 else UNKNOWN
        axes.plot([row.mean_2, row.mean_5], [place, place], "-", color=colour, linewidth=1.0, zorder=1)
        # A hollow dot around a full one that hides it otherwise.
        axes.plot(row.mean_5, place, "o", color=colour, markersize=10.0, markerfacecolor="white", markeredgewidth=1.6)
        axes.plot(row.mean_2, place, "o", color=colour, markersize=6.0)
    axes.plot([], [], "o", color=UNKNOWN, markersize=6.0, label="within 2%")
    axes.plot(
        [], [], "o", color=UNKNOWN, markersize=10.0, markerfacecolor="white", markeredgewidth=1.6, label="within 5%"
    )
    axes.set_yticks(range(len(names)), names)
    axes.invert_yaxis()
    axes.set_xlim(-0.03, 1.03)
    axes.grid(axis="x")
    axes.set_xlabel("share of frames")
    axes.set_title(title)
