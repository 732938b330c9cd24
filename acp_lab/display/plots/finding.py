"""Pictures of how a part is found: edges by direction, templates, what a scan scores, what the evidence adds up to.

Convention: px of the image at hand; directions of edges in colours that go round once in half a turn.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from acp_lab.detection.evidence import WEIGHTS, Evidence
from acp_lab.display.colours import OBJECT_COLOURS
from acp_lab.display.look import START, TRUTH, UNKNOWN, WRONG
from acp_lab.display.pictures import draw_dots, draw_strokes, show_image
from acp_lab.geometry.arrays import ByteImage, FloatArray, IntArray
from acp_lab.studies.finding import SpreadScores, TemplateView

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FEATURE_NAMES = (
    "constant",
    "outline seen",
    "inner edges seen",
    "over chance",
    "explained",
    "colours differ",
    "log length",
    "log size",
)
"""Of `Evidence.features`, in their order."""
_FEATURE_PX = 5.0


def direction_colours(bins: IntArray, count: int) -> FloatArray:
    """(n, 3) RGB of directions (n,) out of `count`: neighbours look alike, the last one is next to the first."""
    from matplotlib import colormaps

    colours: FloatArray = np.asarray(colormaps["hsv"](np.asarray(bins) / count))[:, :3]
    return 0.85 * colours


def draw_edge_directions(axes: Axes, edges: ByteImage) -> None:
    """Edges (bins, h, w), each pixel in the colour of its direction, on white; a key of strokes in a corner."""
    count, height, width = edges.shape
    layer, row, column = np.nonzero(edges)
    picture = np.ones((height, width, 3))
    picture[row, column] = direction_colours(layer, count)
    show_image(axes, picture)
    angles = np.pi * np.arange(count) / count
    strokes = np.stack([np.cos(angles), np.sin(angles)], 1)
    places = np.stack([(0.04 + 0.05 * np.arange(count)) * width, np.full(count, 0.05 * height)], 1)
    key = direction_colours(np.arange(count), count)
    draw_strokes(axes, places, strokes, key, width=3.0, length_px=0.035 * width)


def draw_contrast(axes: Axes, image: ByteImage, points: FloatArray, brighter: FloatArray) -> None:
    """Outline points (n, 2) on the image: where the part is brighter than its ground, and where it is darker."""
    show_image(axes, image, around=points)
    for colour, rows, name in ((START, brighter > 0.0, "part brighter"), (WRONG, brighter <= 0.0, "part darker")):
        draw_dots(axes, points[rows], colour, f"{name}: {rows.mean():.0%}", size=3.0)
    axes.legend(loc="upper right")


def draw_template(axes: Axes, seen: TemplateView, bins: int) -> None:
    """A template's features over the image, as strokes in the colours of their directions."""
    points = seen.centre + seen.offsets
    show_image(axes, seen.image, around=points, margin_px=6.0)
    angles = np.pi * seen.bins / bins
    strokes = np.stack([np.cos(angles), np.sin(angles)], 1)
    draw_strokes(axes, points, strokes, direction_colours(seen.bins, bins), width=2.4, length_px=_FEATURE_PX)


def draw_scores(axes: Axes, scored: SpreadScores, seen: TemplateView) -> None:
    """What a template scores with its centre at each pixel; a ring where the part is."""
    show_image(axes, np.maximum(scored.scores, 0.0), cmap="magma")
    axes.plot(*seen.centre, "o", color=TRUTH, markerfacecolor="none", markersize=14.0, markeredgewidth=1.5)
    axes.set_title(f"edges reach {scored.reach_px:g} px")


def draw_turns(axes: Axes, turns_deg: FloatArray, curves: Mapping[str, FloatArray]) -> None:
    """Agreement of edges over the part's turn in the image, by the name of the distance."""
    for colour, (name, values) in zip((UNKNOWN, OBJECT_COLOURS[0]), curves.items(), strict=False):
        axes.plot(turns_deg, values, color=colour, label=name)
    axes.set_xlabel("turn from the true pose [deg]")
    axes.set_ylabel("mean agreement of the edges [0 to 1]")
    axes.set_ylim(0.0, 1.0)
    axes.grid(visible=True)
    axes.legend()


def draw_evidence(axes: Axes, judged: Mapping[str, Evidence]) -> None:
    """What each feature adds to the log-odds, a group of bars per feature, a colour per pose; the sum in the legend."""
    rows = np.arange(len(FEATURE_NAMES))
    thick = 0.8 / max(len(judged), 1)
    for number, (name, evidence) in enumerate(judged.items()):
        label = f"{name}: log-odds {evidence.log_odds:.1f}"
        at = rows + (number - 0.5 * (len(judged) - 1)) * thick
        axes.barh(
            at, evidence.features * WEIGHTS, thick, color=OBJECT_COLOURS[number % len(OBJECT_COLOURS)], label=label
        )
    axes.axvline(0.0, color=UNKNOWN, linewidth=0.8)
    axes.set_yticks(rows, FEATURE_NAMES)
    axes.invert_yaxis()
    axes.set_xlabel("added to the log-odds")
    axes.legend(bbox_to_anchor=(1.0, 1.0), loc="upper left")
