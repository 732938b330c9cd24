"""Plots of a bench: accuracy curves, accuracy against time, how it falls with worse starts and larger steps, basins."""

from __future__ import annotations

import io
import logging
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from acp_lab.bench.basins import FRAME, Basin
from acp_lab.bench.protocol import Variant
from acp_lab.bench.record import Run
from acp_lab.bench.tables import ALL, Row, Varied, main_variant
from acp_lab.display.look import as_it_is

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Setting = Literal["step", "noise"]

_MOST_PERCENT = 10.0
_NEAR = 0.08  # of @5%: names of points that are nearer to each other would overlap
_LIGHTER = (
    "#aec7e8", "#ffbb78", "#98df8a", "#ff9896", "#c5b0d5", "#c49c94", "#f7b6d2", "#c7c7c7", "#dbdb8d", "#9edae5",
)  # fmt: skip


def bench_figure(runs: Sequence[Run], rows: Sequence[Row], basins: Sequence[Basin] = ()) -> Figure:
    """Six panels in one figure, of the main variant (`tables.main_variant`) where they show one; those without anything
    to show say what would fill them.
    """
    from matplotlib.figure import Figure as NewFigure

    figure = NewFigure(figsize=(15.0, 7.5), layout="constrained")
    curves, times, preparing, noises, basin, steps = figure.subplots(2, 3).ravel()
    draw_recall_curves(curves, runs)
    draw_times(times, rows)
    draw_against(noises, rows, "noise", "how far the start is off", "give --noise to see this")
    draw_preparing(preparing, rows)
    draw_basins(basin, basins, _methods(rows))
    draw_against(steps, rows, "step", "one of n frames used", "give several --steps to see this")
    if (how := main_variant(rows)) != Variant():
        figure.suptitle(f"{how}, unless an axis says otherwise")
    shown = [axes.get_legend_handles_labels() for axes in (steps, noises, curves)]
    named = {label: handle for handles, labels in shown for handle, label in zip(handles, labels, strict=True)}
    if named:
        figure.legend(list(named.values()), list(named), loc="outside lower center", ncols=min(len(named), 6))
    return figure


def figure_svg(figure: Figure) -> str:
    """A figure as the text of an <svg>, the same on every run; its letters stay letters."""
    import matplotlib as mpl

    # Where a font is missing another one is taken; nobody has to hear of each.
    logging.getLogger("matplotlib.font_manager").setLevel(logging.ERROR)
    text = io.StringIO()
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "acp_lab"}):
        figure.savefig(text, format="svg", metadata={"Date": None})
    drawn = text.getvalue()
    return drawn[drawn.index("<svg") :]


def draw_recall_curves(axes: Axes, runs: Sequence[Run], variant: Variant | None = None) -> None:
    """Share of frames within a limit of ADD(-S), over the limit; runs of a variant, whatever their seeds.

    variant: the main one by default.
    """
    runs = [run for run in runs if len(run.frame_ids)]
    how = variant or main_variant(runs)
    limits = np.linspace(0.0, _MOST_PERCENT, 101)
    for number, method in enumerate(_methods(runs)):
        own = [run.distance for run in runs if run.method == method and run.variant.group == how.group]
        if own:
            errors = 100.0 * np.concatenate(own)
            shares = [(errors < limit).mean() for limit in limits]
            axes.plot(limits, shares, label=as_it_is(method), color=_colour(number))
    axes.set(xlabel="limit of ADD(-S), % of the diameter", ylabel="share of frames", ylim=(-0.02, 1.02))
    axes.set_title(f"accuracy, {how}")
    axes.grid(alpha=0.3)


def draw_times(axes: Axes, rows: Sequence[Row]) -> None:
    """Recall at 5% against milliseconds per frame, all data together; names of near points are stacked."""
    known = [(number, row) for number, row in enumerate(_overall(rows)) if np.isfinite(row.ms_median)]
    if not known:
        _say(axes, "time: not known, or all frames are lost")
        return
    slowest = max(row.ms_median for _, row in known)
    named: list[tuple[bool, float]] = []
    for number, row in known:
        x, y = row.ms_median, row.recalls[1].mean
        axes.plot(x, y, "o", color=_colour(number))
        at_the_right = x > 0.5 * slowest  # there names run to the left, and stay on the axes
        stacked = sum(side == at_the_right and abs(other - y) < _NEAR for side, other in named)
        height = 5 + 12 * stacked * (1 if y < 0.5 else -1)
        named.append((at_the_right, y))
        axes.annotate(
            as_it_is(row.method), (x, y), (-5 if at_the_right else 5, height), color=_colour(number),
            textcoords="offset points", ha="right" if at_the_right else "left",
        )  # fmt: skip
    axes.set(xlabel="ms per frame, median", ylabel="@5%", ylim=(-0.02, 1.08), xlim=(0.0, None))
    axes.margins(x=0.2)
    axes.set_title("accuracy and time")
    axes.grid(alpha=0.3)


def draw_preparing(axes: Axes, rows: Sequence[Row]) -> None:
    """CPU seconds of preparing a part, one bar per method."""
    known = [(n, row) for n, row in enumerate(_overall(rows)) if row.prepare_s > 0.0]
    if not known:
        _say(axes, "preparation: nothing to prepare, or not counted")
        return
    names, seconds = [as_it_is(row.method) for _, row in known], [row.prepare_s for _, row in known]
    axes.barh(names, seconds, color=[_colour(n) for n, _ in known])
    axes.invert_yaxis()
    axes.set(xlabel="CPU seconds per part")
    axes.set_title("preparation")
    axes.grid(alpha=0.3, axis="x")


def draw_basins(axes: Axes, basins: Sequence[Basin], methods: Sequence[str]) -> None:
    """Share of runs that come to the part, over how far off they are started; all data, the main frame step.

    methods: in the order of their colours.
    """
    group = ALL if any(basin.group == ALL for basin in basins) else next((basin.group for basin in basins), "")
    own = [basin for basin in basins if basin.group == group]
    if not own:
        _say(axes, "basin: give --noise to see this, without --resets")
        return
    step = main_variant(own).step
    chosen = [basin for basin in own if basin.variant.step == step]
    starts = sorted({(basin.variant.noise_deg, basin.variant.noise_mm) for basin in chosen})
    for number, method in enumerate(methods):
        own = sorted((basin for basin in chosen if basin.method == method), key=lambda basin: basin.variant.group)
        if len(own) > 1:
            at = [starts.index((basin.variant.noise_deg, basin.variant.noise_mm)) for basin in own]
            middle = np.array([basin.found.mean for basin in own])
            spans = np.array([(basin.found.low, basin.found.high) for basin in own]).T
            axes.errorbar(at, middle, np.abs(spans - middle), fmt="o-", capsize=3, color=_colour(number))
    axes.set_xticks(range(len(starts)), _start_names(starts))
    axes.set(ylabel="share of runs", ylim=(-0.02, 1.02))
    axes.set_title(f"basin: within 5% in frame {FRAME}" + (f", 1 of {step} frames" if step > 1 else ""))
    axes.grid(alpha=0.3)


def draw_against(axes: Axes, rows: Sequence[Row], setting: Setting, name: str, otherwise: str) -> None:
    """Recall at 5% with its interval over one setting of the variants, the others being those of the main one.

    setting: "step"; or "noise", degrees and mm together: starts side by side, as in `draw_basins`.
    name: of the axis. otherwise: what is said where there is one value only.
    """
    group, how = _group(rows), main_variant(rows)
    chosen = [row for row in rows if row.group == group and _differs_in(row.variant, how, setting)]
    starts = sorted({(row.variant.noise_deg, row.variant.noise_mm) for row in chosen})
    steps = sorted({row.variant.step for row in chosen})
    if len(starts if setting == "noise" else steps) < 2:
        _say(axes, otherwise)
        return

    def place(row: Row) -> int:
        variant = row.variant
        return variant.step if setting == "step" else starts.index((variant.noise_deg, variant.noise_mm))

    for number, method in enumerate(_methods(rows)):
        own = sorted((row for row in chosen if row.method == method), key=place)
        if not own:
            continue
        middle = np.array([row.recalls[1].mean for row in own])
        spans = np.array([(row.recalls[1].low, row.recalls[1].high) for row in own]).T
        at, look = [place(row) for row in own], _colour(number)
        axes.errorbar(at, middle, np.abs(spans - middle), fmt="o-", capsize=3, color=look, label=as_it_is(method))
    if setting == "step":
        axes.set_xticks(steps)
    else:
        axes.set_xticks(range(len(starts)), _start_names(starts))
    axes.set(xlabel=name, ylabel="@5%", ylim=(-0.02, 1.02))
    axes.set_title(f"@5%: {name}")
    axes.grid(alpha=0.3)


def _start_names(starts: Sequence[tuple[float, float]]) -> list[str]:
    """Of starts so many degrees and mm off."""
    return [f"{degrees:g}°\n{mm:g} mm" if degrees or mm else "truth" for degrees, mm in starts]


def _say(axes: Axes, words: str) -> None:
    axes.text(0.5, 0.5, words, ha="center", va="center", transform=axes.transAxes, color="0.5")
    axes.set_axis_off()


def _colour(number: int) -> str:
    """Of a method: the ten of the style, then ten lighter ones."""
    return f"C{number % 10}" if number % 20 < 10 else _LIGHTER[number % 10]


def _methods(found: Sequence[Varied]) -> list[str]:
    """In the order of their colours: those of the main variant first, which every panel has."""
    how = main_variant(found).group
    return list(dict.fromkeys(one.method for one in sorted(found, key=lambda one: one.variant.group != how)))


def _group(rows: Sequence[Row]) -> str:
    return ALL if any(row.group == ALL for row in rows) else next((row.group for row in rows), "")


def _overall(rows: Sequence[Row]) -> list[Row]:
    """One row per method: all data, the main variant."""
    group, how = _group(rows), main_variant(rows)
    return [row for row in rows if row.group == group and row.variant.group == how.group]


def _differs_in(variant: Variant, how: Variant, setting: Setting) -> bool:
    """Whether nothing but the setting (and the seed) is other than in `how`."""
    if setting == "step":
        return variant.group == replace(how, step=variant.step).group
    return variant.group == replace(how, noise_deg=variant.noise_deg, noise_mm=variant.noise_mm).group
