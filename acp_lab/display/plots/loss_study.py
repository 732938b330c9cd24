"""Pictures of e(I): the losses over the distance, a landscape with the optimiser's paths, and studies of both.

Convention: distances and alpha in px; offsets in the units of their coordinates; colours by loss, from `FORM_COLOURS`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from acp_lab.display.colours import OBJECT_COLOURS, residual_colours
from acp_lab.display.look import START, UNKNOWN, WRONG, Colour
from acp_lab.display.pictures import draw_strokes
from acp_lab.generator.base import GeneratedEdges
from acp_lab.geometry.arrays import FloatArray
from acp_lab.studies.landscape import Descent, LossSlice
from acp_lab.studies.loss_study import LossStudy
from acp_lab.tracking.losses import LOSS_FORMS, LossForm, edge_loss

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FORM_COLOURS: dict[str, Colour] = dict(zip(LOSS_FORMS, (OBJECT_COLOURS[i] for i in (4, 5, 3, 0, 1)), strict=True))
_BANDS = 24


def draw_losses(value_axes: Axes, pull_axes: Axes, forms: Sequence[LossForm], alpha_px: float) -> None:
    """Loss and derivative of an edge point over its distance, each scaled to its largest value."""
    distances = np.linspace(0.0, 2.5 * alpha_px, 400)
    for form in forms:
        loss = edge_loss(form, distances, alpha_px)
        for axes, values in ((value_axes, loss.values), (pull_axes, loss.derivatives)):
            axes.plot(distances, values / np.nanmax(np.abs(values)), color=FORM_COLOURS[form], label=form)
    for axes, name in ((value_axes, "ρ(D), share of the largest"), (pull_axes, "pull ρ'(D), share of the largest")):
        _mark_alpha(axes, alpha_px)
        axes.set_xlabel("distance D to the nearest image edge [px]")
        axes.set_ylabel(name)
    value_axes.legend()


def draw_printed(axes: Axes, alpha_px: float, limit: float = 12.0) -> None:
    """Eq. 6 as printed, its two branches and its pole, cut off at +-limit."""
    colour = FORM_COLOURS["printed"]
    for low, high in ((0.0, alpha_px - 1e-3), (alpha_px + 1e-3, 2.0 * alpha_px)):
        distances = np.linspace(low, high, 600)
        values = edge_loss("printed", distances, alpha_px).values
        near = np.abs(values) < 2.0 * limit
        axes.plot(distances[near], values[near], color=colour)
    _mark_alpha(axes, alpha_px)
    axes.axhline(0.0, color=UNKNOWN, linewidth=0.6)
    axes.set_ylim(-limit, limit)
    axes.set_xlabel("distance D to the nearest image edge [px]")
    axes.set_ylabel("1 / (1 - exp(D - α))")


def draw_distances(axes: Axes, edges: GeneratedEdges, distances_px: FloatArray) -> None:
    """Edge points in the colour of their distance (n,) px: sky blue on an image edge, vermillion 3 px away or more."""
    draw_strokes(axes, edges.points, edges.tangents, residual_colours(distances_px), width=1.8)


def draw_landscape(
    axes: Axes, over: LossSlice, form: LossForm, alpha_px: float, ways: Mapping[str, Descent] | None = None
) -> None:
    """e over two coordinates, dark where it is small; a cross at its least value, a ring in the middle.

    ways: descents by the name of their solver, each drawn from its start.
    """
    values = over.values(form, alpha_px)
    finite = values[np.isfinite(values)]
    # A pole would leave nothing to see of the rest.
    low, high = np.quantile(finite, (0.02, 0.98))
    levels = np.linspace(low, max(high, low + 1e-9), _BANDS)
    axes.contourf(over.offsets_u, over.offsets_v, np.clip(values, low, high), levels, cmap="viridis", extend="both")
    row, column = np.unravel_index(np.nanargmin(values), values.shape)
    lowest = over.offsets_u[column], over.offsets_v[row]
    axes.plot(0.0, 0.0, "o", color="white", markerfacecolor="none", markersize=9.0, label="true pose")
    axes.plot(*lowest, "x", color="white", markersize=7.0, label="lowest value")
    for order, ((name, way), colour) in enumerate(zip((ways or {}).items(), (WRONG, START), strict=False)):
        places = way.offsets[:, [over.u.index, over.v.index]] / (over.u.unit_step, over.v.unit_step)
        # The first ways often begin like later ones; they lie on top.
        axes.plot(*places.T, "-o", color=colour, markersize=3.0, linewidth=1.3, label=name, zorder=5 - order)
    axes.set_xlim(over.offsets_u[0], over.offsets_u[-1])
    axes.set_ylim(over.offsets_v[-1], over.offsets_v[0])
    axes.set_xlabel(f"{over.u.name} [{over.u.unit}]")
    axes.set_ylabel(f"{over.v.name} [{over.v.unit}]")
    axes.set_title(f"{form}, α = {alpha_px:.0f} px")


def draw_erased(axes: Axes, study: LossStudy) -> None:
    """The median error of every choice over the share of edges that was taken away."""
    percent = 100.0 * np.array(study.erased)
    for order, (name, median) in enumerate(zip(study.names, study.median, strict=True)):
        colour = OBJECT_COLOURS[order % len(OBJECT_COLOURS)]
        axes.plot(percent, 100.0 * median, "-o", color=colour, markersize=4.0, label=name)
    axes.axhline(100.0 * study.limit, color=UNKNOWN, linestyle="--", linewidth=0.8)
    axes.set_xlabel("edges of the part missing in the image [%]")
    axes.set_ylabel("median ADD(-S) [% of the diameter]")
    axes.set_ylim(bottom=0.0)
    axes.legend(bbox_to_anchor=(1.0, 1.0), loc="upper left")


def draw_found_shares(axes: Axes, studies: Mapping[str, LossStudy]) -> None:
    """The share of descents that found the pose, a group of bars per choice, a colour per study."""
    count = len(studies)
    for order, (name, study) in enumerate(studies.items()):
        places = np.arange(len(study.names)) + (order - 0.5 * (count - 1)) * 0.8 / count
        colour = OBJECT_COLOURS[order % len(OBJECT_COLOURS)]
        axes.barh(places, study.found[:, 0], 0.8 / count, color=colour, label=name)
    names = next(iter(studies.values())).names
    axes.set_yticks(range(len(names)), names)
    axes.invert_yaxis()
    axes.set_xlim(0.0, 1.0)
    axes.set_xlabel("share of the descents that end within 2% of the diameter")
    axes.legend(bbox_to_anchor=(1.0, 1.0), loc="upper left", title="start is off by")


def _mark_alpha(axes: Axes, alpha_px: float) -> None:
    axes.axvline(alpha_px, color=UNKNOWN, linestyle="--", linewidth=0.9)
    place = {"xycoords": ("data", "axes fraction"), "xytext": (4, 0), "textcoords": "offset points"}
    axes.annotate("α", (alpha_px, 0.97), va="top", **place)  # type: ignore[arg-type]
