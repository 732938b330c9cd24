"""Pictures of ambiguous pairs: two opposite poses, one outer contour (paper Fig. 7b).

Convention: axes of images count pixels, the centre of the top-left one is (0, 0).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from acp_lab.cad.edges import EdgeSamples
from acp_lab.cad.part import Part
from acp_lab.cad.raycast import RayCaster
from acp_lab.control_points.motion_pairs import stroke_ends, visible_rows
from acp_lab.display.colours import BLUE, VERMILLION
from acp_lab.geometry.camera import Camera
from acp_lab.studies.ambiguity import Ambiguities, AmbiguousPair
from acp_lab.studies.distinction import shaded_picture
from acp_lab.studies.silhouettes import outer_contour

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

POSE_COLOURS = (BLUE, VERMILLION)
"""The first and the second pose of a pair."""


def ambiguity_figure(part: Part, edges: EdgeSamples, caster: RayCaster, found: Ambiguities, pairs: int = 3) -> Figure:
    """A row per pair: both contours, the edges of either pose, and both pictures."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    shown = found.pairs[:pairs]
    figure = Figure(figsize=(11.0, 0.3 + 2.9 * max(len(shown), 1)), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    for axes, pair in zip(figure.subplots(max(len(shown), 1), 4, squeeze=False), shown, strict=False):
        draw_pair(axes[:2], part, edges, caster, found.camera, pair)
        for axis, pose, colour in zip(axes[2:], (pair.first_T_obj, pair.second_T_obj), POSE_COLOURS, strict=True):
            axis.imshow(shaded_picture(part, caster, found.camera, pose), cmap="gray", vmin=0, vmax=255)
            _frame(axis, found.camera)
            axis.set_title("first pose" if colour == POSE_COLOURS[0] else "second pose", fontsize=9, color=colour)
    figure.suptitle(f"{part.name}: opposite poses, one outer contour (distances in % of the diameter)", fontsize=10)
    return figure


def draw_pair(
    axes: np.ndarray, part: Part, edges: EdgeSamples, caster: RayCaster, camera: Camera, pair: AmbiguousPair
) -> None:
    """On two axes: the outer contours of both poses over each other, and all their visible edges."""
    from matplotlib.collections import LineCollection

    for order, (pose, colour) in enumerate(zip((pair.first_T_obj, pair.second_T_obj), POSE_COLOURS, strict=True)):
        contour = outer_contour(part, caster, camera, pose)
        closed = np.vstack([contour, contour[:1]])
        style = "-" if order == 0 else "--"
        axes[0].plot(closed[:, 0], closed[:, 1], style, color=colour, linewidth=1.4)
        strokes = stroke_ends(edges, visible_rows(part, edges, caster, pose), camera, pose)
        axes[1].add_collection(LineCollection(list(strokes), colors=[colour], linewidths=1.0, alpha=0.8))
    for axis, share, what in (
        (axes[0], pair.outline_share, "contours"),
        (axes[1], pair.edges_share, "visible edges"),
    ):
        _frame(axis, camera)
        axis.set_title(f"{what}: {100.0 * share:.2f}% apart", fontsize=9)
    axes[0].set_ylabel(f"{pair.turn_deg:.0f} degrees apart", fontsize=9)


def _frame(axis: Axes, camera: Camera) -> None:
    axis.set_xlim(-0.5, camera.width - 0.5)
    axis.set_ylim(camera.height - 0.5, -0.5)
    axis.set_aspect("equal")
    axis.set_xticks([])
    axis.set_yticks([])
