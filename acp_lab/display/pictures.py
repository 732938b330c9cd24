"""Small drawing steps that the notebooks put together: images, edges, dots, quads, on axes of matplotlib.

Convention: px of the full image, (x, y), the centre of the top-left pixel at (0, 0); colours by their meaning, from
`acp_lab.display.look`. Every function draws on the axes that it is given; `panels` makes some.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from acp_lab.display.look import GENERATED, POINTS, Colour
from acp_lab.errors import GeometryError
from acp_lab.generator.base import GeneratedEdges
from acp_lab.geometry.arrays import ByteImage

if TYPE_CHECKING:
    from matplotlib.axes import Axes

STROKE_PX = 3.0


def panels(
    columns: int, rows: int = 1, width_in: float = 3.4, height_in: float = 3.0, titles: Sequence[str] = ()
) -> list[Axes]:
    """Axes side by side, row after row, in a new figure; titles: of the first ones."""
    import matplotlib.pyplot as plt

    _, axes = plt.subplots(rows, columns, figsize=(width_in * columns, height_in * rows), squeeze=False)
    flat = list(axes.ravel())
    for axis, title in zip(flat, titles, strict=False):
        axis.set_title(title)
    return flat


def show_image(
    axes: Axes, image: np.ndarray, around: ArrayLike | None = None, margin_px: float = 15.0, **imshow: Any
) -> Any:
    """An image (h, w[, 3]) without ticks; what `imshow` returns, for a colour bar.

    around: points (n, 2) to which the picture is cut, with a margin. Further arguments go to `imshow`.
    """
    drawn = axes.imshow(image, **imshow)
    axes.set_xticks([])
    axes.set_yticks([])
    axes.spines[:].set_visible(False)
    if around is not None:
        cut_to(axes, around, margin_px)
    return drawn


def without_ground(image: ByteImage) -> ByteImage:
    """A picture (h, w, 3) on pure white as (h, w, 4) whose white is transparent: it stands on a dark page, too."""
    alpha = np.where((image == 255).all(axis=2), 0, 255).astype(np.uint8)
    return np.dstack([image, alpha])


def cut_to(axes: Axes, points: ArrayLike, margin_px: float = 15.0) -> None:
    """Show what lies around points (n, 2); those that are not finite do not count.

    Raises GeometryError when there is none.
    """
    at = np.asarray(points, dtype=np.float64).reshape(-1, 2)
    at = at[np.isfinite(at).all(axis=1)]
    if len(at) == 0:
        raise GeometryError("picture cut to no points: give at least one that is finite")
    low, high = at.min(axis=0) - margin_px, at.max(axis=0) + margin_px
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(high[1], low[1])


def draw_edges(
    axes: Axes, edges: GeneratedEdges | None, colour: Colour = GENERATED, label: str = "", width: float = 1.4
) -> None:
    """Edge points as short strokes along their tangents; nothing for None, those of a frame where none showed."""
    if edges is None:
        return
    draw_strokes(axes, edges.points, edges.tangents, colour, label, width)


def draw_strokes(
    axes: Axes,
    points: np.ndarray,
    directions: np.ndarray,
    colour: Colour | np.ndarray,
    label: str = "",
    width: float = 1.4,
    length_px: float = STROKE_PX,
) -> None:
    """Strokes of a length through points (n, 2) along unit directions (n, 2); one colour, or one (n, 3) each."""
    from matplotlib.collections import LineCollection

    half = 0.5 * length_px * directions
    strokes = np.stack([points - half, points + half], axis=1)
    axes.add_collection(LineCollection(list(strokes), colors=colour, linewidths=width, label=label or None))


def draw_dots(axes: Axes, points: ArrayLike, colour: Colour, label: str = "", size: float = 4.0) -> None:
    """Dots at points (n, 2)."""
    at = np.asarray(points, dtype=np.float64).reshape(-1, 2)
    axes.plot(at[:, 0], at[:, 1], "o", color=colour, markersize=size, markeredgewidth=0.0, label=label or None)


def draw_quad(
    axes: Axes, points: ArrayLike, colour: Colour = POINTS, label: str = "", numbers: bool = True, style: str = "-"
) -> None:
    """Four control points (4, 2) in order around their quad, numbered from 1."""
    quad = np.asarray(points, dtype=np.float64)
    ring = np.vstack([quad, quad[:1]])
    x, y = ring.T
    axes.plot(x, y, style, marker="o", color=colour, linewidth=1.2, markersize=5.0, label=label or None)
    if not numbers:
        return
    outward = quad - quad.mean(axis=0)
    outward /= np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-9)
    for number, (corner, way) in enumerate(zip(quad, outward, strict=True), start=1):
        axes.annotate(
            str(number),
            corner,
            xytext=tuple(10.0 * way * (1.0, -1.0)),  # screen points count upwards
            textcoords="offset points",
            ha="center",
            va="center",
            color="white",
            fontsize=8,
            fontweight="bold",
            bbox={"boxstyle": "circle,pad=0.15", "facecolor": colour, "edgecolor": "none"},
        )
