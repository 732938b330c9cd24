"""Pictures of view regions, of the plane of W, and of e_3d over it.

Convention: 3D drawings in the object frame, mm; the plane's offset and tilts in units of half the box (see
`control_points.plane_points`).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from acp_lab.cad.part import Part
from acp_lab.control_points.view_regions import REGION_NAMES, region_scores
from acp_lab.display.colours import OBJECT_COLOURS, residual_colours
from acp_lab.display.look import POINTS, UNKNOWN, WRONG, Colour
from acp_lab.display.scene_3d import draw_lines
from acp_lab.geometry.arrays import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from mpl_toolkits.mplot3d import Axes3D

REGION_COLOURS = OBJECT_COLOURS
"""One per view region, in their order."""


def draw_regions(axes: Axes3D, part: Part, directions_obj: FloatArray) -> None:
    """Directions of view (n, 3) as dots on a sphere around the part, each in the colour of its region.

    Only those on the reader's side, or the far side would shine through.
    """
    half_size = 0.5 * part.box_size
    turn, rise = np.radians([axes.azim, axes.elev])
    reader = np.array([np.cos(turn) * np.cos(rise), np.sin(turn) * np.cos(rise), np.sin(rise)])
    near = directions_obj[directions_obj @ reader > 0.0]
    regions = region_scores(near, half_size).argmax(1)
    eyes_obj = part.box_centre + 1.8 * part.radius * near
    for region, name in enumerate(REGION_NAMES):
        axes.plot(*eyes_obj[regions == region].T, "o", color=REGION_COLOURS[region], markersize=2.5, label=name)
    corners = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8).T * half_size
    length = 2.3 * part.radius / np.linalg.norm(corners, axis=1, keepdims=True)
    rays = np.stack([np.broadcast_to(part.box_centre, corners.shape), part.box_centre + length * corners], axis=1)
    draw_lines(axes, rays, UNKNOWN, "through the box's corners", 1.4)
    axes.set_aspect("equal")


def draw_box(axes: Axes3D, part: Part, colour: Colour = UNKNOWN) -> None:
    """The twelve sides of the bounding box."""
    low, high = part.box_min, part.box_max
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    sides = [(a, b) for i, a in enumerate(corners) for b in corners[:i] if np.abs(a - b).sum() == 1]
    draw_lines(axes, low + np.array(sides) * (high - low), colour, "", 0.8)


def draw_tilts(axes: Axes, tilts: FloatArray, values: FloatArray, way: FloatArray | None = None) -> Any:
    """e_3d (t, t) over two tilts (t,), rows along the second one; what `contourf` returns, for a colour bar.

    way: (k, 2) tilts that an optimiser went through, first to last.
    """
    drawn = axes.contourf(tilts, tilts, values, 20, cmap="viridis")
    axes.plot(0.0, 0.0, "o", color="white", markerfacecolor="none", markersize=9.0, label="middle section")
    if way is not None:
        axes.plot(*way.T, "-o", color=WRONG, markersize=2.5, linewidth=1.2, label="Adam")
    axes.set_xlabel("tilt along u [half boxes]")
    axes.set_ylabel("tilt along v [half boxes]")
    axes.set_aspect("equal")
    axes.legend(facecolor="0.3", labelcolor="white")
    return drawn


def draw_moved(axes: Axes, points: FloatArray, off_px: FloatArray) -> None:
    """Edge points (n, 2) px in the colour of their distance (n,) px to the true edges, vermillion from 3 px on."""
    axes.scatter(points[:, 0], points[:, 1], s=5.0, c=residual_colours(off_px), linewidths=0.0)


def draw_residuals(axes: Axes, residuals: Mapping[str, tuple[float, ...]], motions: tuple[str, ...]) -> None:
    """Bars per motion, a colour per set of control points: px that the homography leaves unexplained."""
    height = 0.8 / len(residuals)
    for order, ((name, values), colour) in enumerate(zip(residuals.items(), (UNKNOWN, *_SETS), strict=False)):
        places = np.arange(len(motions)) + (order - 0.5 * (len(residuals) - 1)) * height
        axes.barh(places, values, height, color=colour, label=name)
    axes.set_yticks(range(len(motions)), motions)
    axes.invert_yaxis()
    axes.set_xlabel("px along the edges' normals")
    axes.legend()


_SETS: tuple[Colour, ...] = (OBJECT_COLOURS[1], POINTS)
