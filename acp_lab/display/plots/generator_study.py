"""Pictures of the edge generator: the loss of its training, what it paints, and the edge points read off that.

Convention: canonical px; edge images (h, w) in [0, 1]; orange is what was generated, green the truth.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from acp_lab.display.look import GENERATED, IMAGE, POINTS, TRUTH, UNKNOWN
from acp_lab.display.pictures import draw_dots, draw_edges, draw_quad, draw_strokes, show_image
from acp_lab.generator.base import GeneratedEdges
from acp_lab.generator.painted.edge_points import RidgePoints
from acp_lab.generator.painted.quality import comparison_grid
from acp_lab.generator.painted.watch import STAGE_NAMES, WatchedEpoch
from acp_lab.geometry.arrays import Float32Array, FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_STAGE_COLOURS = dict(zip(STAGE_NAMES, (POINTS, IMAGE, GENERATED, UNKNOWN), strict=True))


def draw_inverse_psnr(value_axes: Axes, slope_axes: Axes) -> None:
    """1/PSNR of eq. 3 over the mean square error, with its pole, and how steep it is, beside the error's own slope."""
    error = np.geomspace(1e-4, 0.97, 400)
    slope = 0.1 * np.log(10.0) / (error * np.log(error) ** 2)
    value_axes.plot(error, -0.1 / np.log10(error), color=GENERATED, label="1 / PSNR (eq. 3)")
    value_axes.plot(error, error, "--", color=UNKNOWN, label="MSE itself")
    value_axes.axvline(1.0, color=UNKNOWN, linewidth=0.8)
    value_axes.text(0.3, 0.5, "pole at 1:\nevery pixel wrong", ha="right", fontsize=8)
    value_axes.set_ylim(0.0, 0.65)
    value_axes.set_ylabel("loss")
    slope_axes.plot(error, slope, color=GENERATED, label="1 / PSNR (eq. 3)")
    slope_axes.axhline(1.0, color=UNKNOWN, linestyle="--", label="MSE itself")
    slope_axes.set_yscale("log")
    slope_axes.set_ylabel("slope: loss per unit of MSE")
    for axes in (value_axes, slope_axes):
        axes.set_xscale("log")
        axes.set_xlabel("mean square error of the image")
        axes.legend(loc="upper left" if axes is value_axes else "upper center")


def draw_images(axes: Sequence[Axes], images: Sequence[Float32Array], titles: Sequence[str] = ()) -> None:
    """Edge images side by side, black to white, one on each of the axes."""
    for axis, image in zip(axes, images, strict=False):
        show_image(axis, image, vmin=0.0, vmax=1.0)
    for axis, title in zip(axes, titles, strict=False):
        axis.set_title(title, fontsize=8)


def draw_epochs(axes: Axes, epochs: Sequence[WatchedEpoch], views: int = 4) -> None:
    """A column per epoch, what was painted for the first held-out views; the last column is the truth."""
    columns = [epoch.painted[:views] for epoch in epochs] + [epochs[-1].truth[:views]]
    size = columns[0].shape[1]
    show_image(axes, comparison_grid(columns))
    names = [f"{epoch.stage}\n{epoch.epoch} of {epoch.epochs}" for epoch in epochs] + ["the truth"]
    for number, name in enumerate(names):
        x = number * (size + 2) + 0.5 * size
        axes.text(x, -4.0, name, ha="center", va="bottom", fontsize=7)


def draw_training(axes: Axes, epochs: Sequence[WatchedEpoch]) -> None:
    """Eq. 4 on the held-out views after every epoch, stacked of its two terms; stages in bands of their own colour."""
    done = [epoch.done for epoch in epochs]
    bce = np.array([epoch.bce for epoch in epochs])
    total = np.array([epoch.held_out_loss for epoch in epochs])
    axes.fill_between(done, 0.0, bce, color=TRUTH, alpha=0.35, linewidth=0.0, label="BCE (eq. 2)")
    axes.fill_between(done, bce, total, color=GENERATED, alpha=0.45, linewidth=0.0, label="0.5 · 1/PSNR (eq. 3)")
    axes.plot(done, total, "-o", color=GENERATED, markersize=3.0, label="their sum (eq. 4)")
    top = 1.18 * float(total.max())
    for stage in STAGE_NAMES:
        own = [epoch.done for epoch in epochs if epoch.stage == stage]
        if own:
            axes.axvspan(own[0] - 0.5, own[-1] + 0.5, ymin=0.93, color=_STAGE_COLOURS[stage], alpha=0.3, linewidth=0.0)
            axes.text(0.5 * (own[0] + own[-1]), 0.965 * top, stage, ha="center", va="center", fontsize=7)
    axes.set_ylim(0.0, top)
    axes.set_xlim(0.5, done[-1] + 0.5)
    axes.set_xlabel("epoch")
    axes.set_ylabel("loss on held-out views")
    axes.legend(loc="lower left")


def draw_edge_points(
    axes: Axes, image: Float32Array, found: RidgePoints, truth: FloatArray | None = None, size: float = 3.0
) -> None:
    """Edge points over the image that they were read off: dots with their tangents; truth (n, 2): dots of the truth."""
    show_image(axes, image, vmin=0.0, vmax=1.0)
    if truth is not None:
        draw_dots(axes, truth, TRUTH, "truth", 1.5)
    draw_strokes(axes, found.points, found.tangents, GENERATED, width=0.8, length_px=0.9)
    draw_dots(axes, found.points, GENERATED, "edge points", size)


def draw_view(
    axes: Axes, image: Float32Array, points: FloatArray, rigid: GeneratedEdges | None = None, title: str = ""
) -> None:
    """An edge image with its control points (4, 2); rigid: edges of a rigid generator for the same points."""
    show_image(axes, image, vmin=0.0, vmax=1.0)
    if rigid is not None:
        draw_edges(axes, rigid, GENERATED, width=1.0)
    draw_quad(axes, points)
    height, width = image.shape
    axes.set_xlim(-0.5, width - 0.5)
    axes.set_ylim(height - 0.5, -0.5)
    axes.set_title(title, fontsize=8)
