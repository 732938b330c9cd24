"""Pictures of manipulated edges: each way over the truth, and how its error grows.

Convention: px of the image; green is the part at the pose of PnP, orange what a way makes of the points.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from acp_lab.display.colours import OBJECT_COLOURS
from acp_lab.display.look import GENERATED, TRUTH, UNKNOWN
from acp_lab.display.pictures import cut_to, draw_edges, draw_quad
from acp_lab.geometry.arrays import FloatArray
from acp_lab.studies.manipulation import Manipulated, ManipulationStudy

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw_way(axes: Axes, way: Manipulated, study: ManipulationStudy, control_points: FloatArray) -> None:
    """One way's edges over the true ones, and I (4, 2); the title tells its Chamfer distance."""
    draw_edges(axes, study.truth, TRUTH, "part at the pose of PnP", 3.0)
    draw_edges(axes, way.edges, GENERATED, "manipulated", 1.2)
    draw_quad(axes, control_points, numbers=False)
    axes.set_xticks([])
    axes.set_yticks([])
    axes.spines[:].set_visible(False)
    axes.set_aspect("equal")
    cut_to(axes, np.vstack([study.truth.points, control_points]), 20.0)
    distance = "no edges" if way.distance is None else f"Chamfer {way.distance.symmetric:.2f} px"
    axes.set_title(f"{way.name}\n{distance}")


def draw_ways(axes: Sequence[Axes], study: ManipulationStudy, control_points: FloatArray) -> None:
    """All ways of a study side by side, one on each of the axes."""
    for axis, way in zip(axes, study.ways, strict=False):
        draw_way(axis, way, study, control_points)
    axes[0].legend(loc="upper left", bbox_to_anchor=(0.0, 0.0), ncols=2)


def draw_growth(axes: Axes, amounts: FloatArray, distances_px: Mapping[str, Sequence[float]], unit: str) -> None:
    """Chamfer distance in px of each way over the amount of a motion (n,); unit: of the amounts."""
    # Homography and spline often lie on each other: the later ones are thinner.
    for order, (name, values) in enumerate(distances_px.items()):
        colour = OBJECT_COLOURS[order % len(OBJECT_COLOURS)]
        axes.plot(
            amounts, values, "-o", color=colour, markersize=3.0, linewidth=max(4.0 - 1.2 * order, 1.0), label=name
        )
    axes.axhline(1.0, color=UNKNOWN, linewidth=0.8, linestyle="--", label="1 px")
    axes.set_xlabel(unit)
    axes.set_ylabel("Chamfer distance to the truth [px]")
