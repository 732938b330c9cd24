"""Pictures of a run, drawn with matplotlib and without a display.

`draw_frame` and `draw_curves` draw on given axes, for notebooks; `SummaryPicture` is an observer that writes
one PNG of a whole run: a few frames with the generated edges and the control points, and curves below them.

Convention: axes of images count pixels, the centre of the top-left one is (0, 0); curves run over image ids.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from acp_lab.cad.part import Part
from acp_lab.display.accuracy import AddPercent
from acp_lab.display.colours import GREY, LARGEST_RESIDUAL_PX, OBJECT_COLOURS, residual_colours
from acp_lab.display.look import as_it_is
from acp_lab.files import replacing
from acp_lab.geometry.arrays import ByteImage, FloatArray
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.tracking.observer import SessionInfo
from acp_lab.tracking.result import TrackResult

if TYPE_CHECKING:
    from matplotlib.axes import Axes

STROKE_PX = 3.0
MOST_CURVE_POINTS = 20_000


@dataclass
class Curves:
    """What one object's curves show: a value per frame, NaN where there is none; frame_ids are image ids."""

    name: str
    frame_ids: list[int] = field(default_factory=list)
    add_percent: list[float] = field(default_factory=list)
    quality: list[float] = field(default_factory=list)
    time_ms: list[float] = field(default_factory=list)


def draw_frame(axes: Axes, image: ByteImage, results: Sequence[TrackResult], title: str = "") -> None:
    """An image (h, w, 3) with generated edges, coloured by residual, and each object's control points.

    The axes are cut to what was tracked; they have no ticks.
    """
    from matplotlib.collections import LineCollection

    axes.imshow(image)
    seen = []
    for order, result in enumerate(results):
        quad = np.vstack([result.control_points, result.control_points[:1]])
        colour = OBJECT_COLOURS[order % len(OBJECT_COLOURS)]
        axes.plot(quad[:, 0], quad[:, 1], "-o", color=colour, linewidth=1.0, markersize=4.0)
        seen.append(result.control_points)
        edges = result.edges
        if edges is None or len(edges) == 0:
            continue
        half = 0.5 * STROKE_PX * edges.tangents
        strokes = np.stack([edges.points - half, edges.points + half], axis=1)
        residuals = np.full(len(edges), np.nan) if result.residuals_px is None else result.residuals_px
        axes.add_collection(LineCollection(list(strokes), colors=residual_colours(residuals), linewidths=1.2))
        seen.append(edges.points)
    _cut_to(axes, np.vstack(seen) if seen else None, image.shape[1], image.shape[0])
    axes.set_xticks([])
    axes.set_yticks([])
    axes.spines[:].set_visible(False)
    axes.set_title(title, fontsize=9)


def draw_curves(axes: Sequence[Axes], objects: Sequence[Curves]) -> None:
    """ADD(-S), quality and time of each object over the image ids, on three axes."""
    labels = ("ADD(-S) [% of diameter]", "quality [0 to 1]", "time per frame [ms]")
    for axis, label, key in zip(axes, labels, ("add_percent", "quality", "time_ms"), strict=True):
        for order, curves in enumerate(objects):
            values = np.array(getattr(curves, key), dtype=np.float64)
            if not np.isfinite(values).any():
                continue
            colour = OBJECT_COLOURS[order % len(OBJECT_COLOURS)]
            axis.plot(curves.frame_ids, values, color=colour, linewidth=1.3, label=as_it_is(curves.name))
        axis.set_xlabel("image id")
        axis.set_ylabel(label)
        axis.grid(alpha=0.3)
    axes[1].set_ylim(0.0, 1.02)
    _limit_times(axes[2], objects)
    if not any(np.isfinite(curves.add_percent).any() for curves in objects):
        axes[0].text(0.5, 0.5, "no truth", ha="center", va="center", transform=axes[0].transAxes, color=GREY)
    else:
        _mark_recall_limits(axes[0])
    if len(objects) > 1:
        axes[1].legend(fontsize=7)


class SummaryPicture:
    """Observer that writes a PNG of the run when it ends; a later session overwrites it.

    path: the picture. shown: image ids of the frames to show (about four look best).
    Raises InputFileError when the picture cannot be written.
    """

    def __init__(self, path: str | Path, shown: Sequence[int]) -> None:
        self.path = Path(path)
        self._shown = frozenset(shown)
        self._curves: dict[int, Curves] = {}

    def on_start(self, session: SessionInfo) -> None:
        """Forget the last session."""
        self._session = session
        self._pictures: list[tuple[int, ByteImage, tuple[TrackResult, ...]]] = []
        by_id = sorted(session.objects, key=lambda tracked: tracked.object_id)  # the order of their colours
        self._curves = {o.object_id: Curves(_title(o.object_id, o.part)) for o in by_id}
        self._add_percent = {o.object_id: AddPercent(o.part) for o in session.objects}

    def on_frame(self, frame: Frame | UnreadableFrame, results: Mapping[int, TrackResult]) -> None:
        """Record the numbers, and the image where it is to be shown."""
        truth = self._session.truth
        for object_id, result in results.items():
            curves = self._curves[object_id]
            if len(curves.frame_ids) >= MOST_CURVE_POINTS:
                continue
            true_pose = truth(frame.index, object_id) if truth else None
            curves.frame_ids.append(frame.index)
            curves.add_percent.append(self._add_percent[object_id](result.cam_T_obj, true_pose))
            curves.quality.append(result.quality)
            read = isinstance(frame, Frame)
            curves.time_ms.append(1e3 * result.timings.total_s if read else math.nan)
        if isinstance(frame, Frame) and frame.index in self._shown:
            image = frame.to_keep().image
            self._pictures.append((frame.index, image, tuple(results[i] for i in sorted(results))))

    def on_end(self) -> None:
        """Draw and write the picture; nothing when no frame was tracked."""
        if not any(curves.frame_ids for curves in self._curves.values()):
            return
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        columns = max(1, len(self._pictures))
        figure = Figure(figsize=(max(9.0, 3.2 * columns), 5.6), dpi=110, layout="constrained")
        FigureCanvasAgg(figure)
        halves = np.asarray(figure.subfigures(2, 1, height_ratios=[1.25, 1.0]))
        for axes, (index, image, results) in zip(_row(halves[0], columns), self._pictures, strict=False):
            states = ", ".join(str(result.state) for result in results)
            draw_frame(axes, image, results, f"image {index}: {states}")
        draw_curves(_row(halves[1], 3), list(self._curves.values()))
        shown = f"{self._session.name}: {', '.join(curves.name for curves in self._curves.values())}"
        figure.suptitle(
            f"{as_it_is(shown)}, method {self._session.method}   "
            f"(edges: light blue 0 px, yellow, vermillion {LARGEST_RESIDUAL_PX:.0f} px off, grey: no image edge)",
            fontsize=10,
        )
        with replacing(self.path, "the picture") as temporary:
            figure.savefig(temporary, format="png")


def _title(object_id: int, part: Part) -> str:
    name = f"obj_{object_id:06d}"
    return name if part.name == name else f"{part.name} ({name})"


def _row(figure: Any, count: int) -> list[Axes]:
    return list(figure.subplots(1, count, squeeze=False)[0])


def _cut_to(axes: Axes, points: FloatArray | None, width: int, height: int) -> None:
    """Limit image axes to the points (n, 2) and a margin, inside the image."""
    low, high = np.array([-0.5, -0.5]), np.array([width - 0.5, height - 0.5])
    if points is not None:
        points = points[np.isfinite(points).all(axis=1)]
        near = points[((points >= low) & (points <= high)).all(axis=1)]
        if len(near):
            margin = 0.15 * max(np.ptp(near, axis=0).max(), 20.0)
            low, high = (
                np.maximum(low, near.min(axis=0) - margin),
                np.minimum(high, near.max(axis=0) + margin),
            )
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(high[1], low[1])


def _mark_recall_limits(axis: Axes) -> None:
    """Dashed lines at 2, 5 and 10%, as far as the curve comes near them."""
    top = max(axis.get_ylim()[1], 2.2)
    for limit in (2.0, 5.0, 10.0):
        if limit <= top:
            axis.axhline(limit, color=GREY, linestyle="--", linewidth=0.8)
    axis.set_ylim(0.0, top)


def _limit_times(axis: Axes, objects: Sequence[Curves]) -> None:
    """Cut the scale below the time of a slow first frame, which would flatten the rest."""
    later = [value for curves in objects for value in curves.time_ms[1:] if math.isfinite(value)]
    first = [curves.time_ms[0] for curves in objects if curves.time_ms and math.isfinite(curves.time_ms[0])]
    if later and first and max(first) > 2.0 * max(later):
        axis.set_ylim(0.0, 1.5 * max(later))
        axis.set_title(f"first frame: {max(first):.0f} ms", fontsize=8, loc="right")
    else:
        axis.set_ylim(bottom=0.0)
