"""A part, its control points and the camera that sees them, drawn in three dimensions.

Convention: everything is drawn in the object frame, mm; the camera is a pyramid whose tip is its centre and whose
base lies in the image plane, `image_depth_mm` in front of it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from acp_lab.cad.edges import EdgeSamples
from acp_lab.display.look import GENERATED, INK, POINTS, UNKNOWN, Colour
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import inverse, transform

if TYPE_CHECKING:
    from mpl_toolkits.mplot3d import Axes3D


def space(
    width_in: float = 6.0, height_in: float = 5.0, elevation_deg: float = 25.0, turn_deg: float = -60.0
) -> Axes3D:
    """Axes in three dimensions, in a new figure, seen from somewhere above."""
    import matplotlib.pyplot as plt
    from matplotlib.ticker import MaxNLocator

    figure = plt.figure(figsize=(width_in, height_in))
    axes: Any = figure.add_subplot(projection="3d")
    axes.view_init(elev=elevation_deg, azim=turn_deg)
    axes.set_xlabel("x of the object [mm]")
    axes.set_ylabel("y of the object [mm]")
    axes.set_zlabel("z of the object [mm]")
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_major_locator(MaxNLocator(4))
        axis.set_pane_color((1.0, 1.0, 1.0, 0.0))
    return axes


def draw_samples(
    axes: Axes3D, edges: EdgeSamples, rows: np.ndarray, colour: Colour = GENERATED, label: str = "", width: float = 1.2
) -> None:
    """The edge samples of `rows` (k,), each as a stroke as long as the samples are apart."""
    half = 0.5 * edges.spacing_mm * edges.tangents_obj[rows]
    points = edges.points_obj[rows]
    draw_lines(axes, np.stack([points - half, points + half], axis=1), colour, label, width)


def draw_lines(axes: Axes3D, lines_obj: FloatArray, colour: Colour, label: str = "", width: float = 1.0) -> None:
    """Lines (n, 2, 3) mm, each from a point to a point."""
    from mpl_toolkits.mplot3d.art3d import Line3DCollection

    axes.add_collection3d(Line3DCollection(list(lines_obj), colors=[colour], linewidths=width, label=label or None))


def draw_camera(axes: Axes3D, camera: Camera, cam_T_obj: FloatArray, image_depth_mm: float) -> FloatArray:
    """The camera as a pyramid; returns its five corners (5, 3) mm, object frame, the centre first."""
    corners_px = np.array([[0, 0], [camera.width, 0], [camera.width, camera.height], [0, camera.height]]) - 0.5
    obj_T_cam = inverse(cam_T_obj)
    base_obj = transform(obj_T_cam, image_depth_mm * camera.rays(corners_px))
    eye_obj = obj_T_cam[:3, 3]
    sides = [(eye_obj, corner) for corner in base_obj]
    rim = list(zip(base_obj, np.roll(base_obj, -1, axis=0), strict=True))
    draw_lines(axes, np.array(sides + rim), UNKNOWN, "", 0.8)
    axes.plot(*eye_obj[:, None], "o", color=INK, markersize=4.0, label="centre of the camera")
    return np.vstack([eye_obj, base_obj])


def draw_on_image_plane(
    axes: Axes3D, camera: Camera, cam_T_obj: FloatArray, pixels: FloatArray, image_depth_mm: float, colour: Colour
) -> None:
    """Pixels (n, 2) as dots on the image plane of `draw_camera`."""
    at = transform(inverse(cam_T_obj), image_depth_mm * camera.rays(pixels))
    axes.plot(*at.T, ".", color=colour, markersize=1.0)


def draw_plane_points(axes: Axes3D, points_obj: FloatArray, label: str = "control points W") -> None:
    """The quad of four control points W (4, 3) mm, numbered from 1."""
    ring = np.vstack([points_obj, points_obj[:1]])
    axes.plot(*ring.T, "-o", color=POINTS, linewidth=1.4, markersize=4.0, label=label)
    for number, point in enumerate(points_obj, start=1):
        axes.text(*point, f" {number}", color=POINTS, fontsize=9, fontweight="bold")


def draw_rays(axes: Axes3D, cam_T_obj: FloatArray, points_obj: FloatArray, colour: Colour = POINTS) -> None:
    """Lines from the camera's centre to points (n, 3) mm."""
    eye_obj = inverse(cam_T_obj)[:3, 3]
    lines = np.stack([np.broadcast_to(eye_obj, points_obj.shape), points_obj], axis=1)
    draw_lines(axes, lines, colour, "", 0.6)


def same_scale(axes: Axes3D, points_obj: FloatArray) -> None:
    """One millimetre is as long in x as in y and z, and points (n, 3) mm are all in the picture."""
    low, high = points_obj.min(axis=0), points_obj.max(axis=0)
    margin = 0.03 * float((high - low).max())
    axes.set_xlim(low[0] - margin, high[0] + margin)
    axes.set_ylim(low[1] - margin, high[1] + margin)
    axes.set_zlim(low[2] - margin, high[2] + margin)
    axes.set_box_aspect(tuple(high - low + 2.0 * margin))
