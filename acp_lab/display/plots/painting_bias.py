"""Painted edges against the true ones: errors that go together along the part."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from acp_lab.display.look import UNKNOWN
from acp_lab.display.pictures import draw_edges
from acp_lab.generator.base import GeneratedEdges
from acp_lab.studies.painting_bias import PaintingBias

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_LARGEST_PX = 1.0


def draw_painting_bias(axes: Axes, bias: PaintingBias, towards: GeneratedEdges | None = None) -> None:
    """Painted points by how far they are off, seen from the middle of the part: red outwards, blue inwards.

    towards: other edges, such as the true ones, drawn beneath.
    """
    if towards is not None:
        draw_edges(axes, towards, UNKNOWN, width=0.8)
    points = bias.edges.points
    from_middle = points - points.mean(0)
    outwards = np.sign((from_middle * bias.edges.normals).sum(1)) * bias.off_px
    dots = axes.scatter(
        points[:, 0], points[:, 1], c=outwards, cmap="coolwarm", vmin=-_LARGEST_PX, vmax=_LARGEST_PX, s=9, zorder=3
    )
    axes.set_aspect("equal")
    if not axes.yaxis_inverted():
        axes.invert_yaxis()
    axes.figure.colorbar(dots, ax=axes, label="off, outwards [px]")
    axes.set_title(
        f"{bias.mean_off_px:.2f} px off,\nthe pose it shows is {100 * bias.add_share:.2f}% of the diameter off"
    )
