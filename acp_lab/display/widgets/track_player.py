"""A stored run, frame by frame: the image with what was generated and found in it, and the curves, in step."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import ipywidgets
import numpy as np
import traitlets

from acp_lab.display.accuracy import AddPercent
from acp_lab.display.look import GENERATED, IMAGE, POINTS, START, TRUTH
from acp_lab.display.widgets.controls import row, side_by_side
from acp_lab.display.widgets.curve_plot import Curve, CurvePlot, Mark
from acp_lab.display.widgets.film_canvas import FilmCanvas, Picture
from acp_lab.display.widgets.frame_shelf import FrameShelf
from acp_lab.display.widgets.overlay import RESIDUAL_LABEL, Overlay, residual_strokes
from acp_lab.display.widgets.still import Still
from acp_lab.errors import SequenceError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.sequences.protocol import Sequence
from acp_lab.tracking.result import TrackResult
from acp_lab.tracking.session import TrackRun, check_run

LOSS_ROW, QUALITY_ROW = "loss e(I)", "quality [0 to 1]"
ADD_LIMITS = (2.0, 5.0)
PLAY_MS = 40
LARGEST_SHOWN_ADD = 20.0
"""Percent; a lost part would flatten the rest of the curve."""


class TrackPlayer(Still, ipywidgets.VBox):
    """Plays, scrubs and steps a `TrackRun`.

    frame: which frame of the run is shown, counted from 0 over those with results of any object; it moves with all
    controls, and moves them when it is assigned, so another viewer can lead or follow it (`player.observe(...,
    "frame")`). object_id: whose results. frame_ids: the images of the frames. result: of the object in that frame;
    canvas.picture(): what is shown of it. canvas, curves: the parts.
    """

    still = "widget_player.png"

    frame = traitlets.Int(0)
    object_id = traitlets.Int(1)

    def __init__(self, run: TrackRun, sequence: Sequence | None = None, object_id: int | None = None) -> None:
        """sequence: where the images are, by default the one that was tracked; object_id: by default the first with
        results.

        Raises SequenceError for a run without a sequence or results, and for an object that was not tracked.
        """
        check_run(run)
        sequence = run.sequence if sequence is None else sequence
        if sequence is None or not any(run.results.values()):
            raise SequenceError(f"{run.name}: nothing to play: give the results of track_sequence and their sequence")
        with_results = (i for i, results in run.results.items() if results)
        chosen = next(with_results) if object_id is None else object_id
        if chosen not in run.results:
            raise SequenceError(f"{run.name}: no object {chosen}: the run has {sorted(run.results)}")
        self.run, self.sequence = run, sequence
        self.frame_ids = tuple(sorted({result.frame_id for results in run.results.values() for result in results}))
        self._results = {i: _of_frames(results, self.frame_ids) for i, results in run.results.items()}
        super().__init__(object_id=chosen)
        self._shelf = FrameShelf(sequence)
        self._add_percent, self._metric = self._errors()
        self.follow = ipywidgets.Checkbox(False, description="follow the part", indent=False)
        self.follow.layout.width = "auto"
        names = {f"object {i}": i for i in run.results}
        self.object = ipywidgets.Dropdown(options=names, value=chosen, layout=ipywidgets.Layout(width="130px"))
        self.object.layout.display = None if len(names) > 1 else "none"
        self.curves = CurvePlot((), (), x_label="image id")
        self._show_curves()
        count = len(self.frame_ids)
        self.canvas = FilmCanvas(self._picture, count, closed=True, height_px=500, interval_ms=PLAY_MS)
        left = ipywidgets.VBox([self.canvas, row([self.follow, self.object], gap="4px 12px")])
        self.children = [side_by_side((left, "3 1 420px"), (self.curves, "2 1 320px"))]
        traitlets.link((self, "frame"), (self.canvas, "frame"))
        traitlets.link((self, "frame"), (self.curves, "cursor"))
        traitlets.link((self, "object_id"), (self.object, "value"))
        self.follow.observe(lambda _: self.canvas.renew(), "value")
        self.observe(lambda _: self._show_object(), "object_id")

    @property
    def results(self) -> tuple[TrackResult | None, ...]:
        """Of the chosen object, one per frame; None where it was not tracked."""
        return self._results[self.object_id]

    @property
    def result(self) -> TrackResult | None:
        """Of the frame shown."""
        return self.results[self.frame]

    @traitlets.validate("frame")
    def _within(self, proposal: dict[str, Any]) -> int:
        return int(np.clip(proposal["value"], 0, len(self.frame_ids) - 1))

    def _show_object(self) -> None:
        self._add_percent, self._metric = self._errors()
        self._show_curves()
        self.canvas.renew()

    def _errors(self) -> tuple[FloatArray, str]:
        """ADD or ADD-S in percent of the diameter, NaN where nobody knows, and its name."""
        part = self.run.parts.get(self.object_id)
        if part is None:
            return np.full(len(self.frame_ids), np.nan), ""
        error = AddPercent(part)
        percent = [
            np.nan if result is None else error(result.cam_T_obj, self.sequence.truth(frame_id, self.object_id))
            for frame_id, result in zip(self.frame_ids, self.results, strict=True)
        ]
        return np.array(percent), error.metric

    def _show_curves(self) -> None:
        results = self.results
        curves = [
            Curve(np.array([np.nan if one is None else one.loss for one in results]), GENERATED, LOSS_ROW),
            Curve(np.array([np.nan if one is None else one.quality for one in results]), TRUTH, QUALITY_ROW),
        ]
        marks: tuple[Mark, ...] = ()
        if np.isfinite(self._add_percent).any():
            shown = np.minimum(self._add_percent, LARGEST_SHOWN_ADD)
            add_row = f"{self._metric} [% of diameter]"
            curves.insert(0, Curve(shown, POINTS, add_row, most=LARGEST_SHOWN_ADD))
            limits = [limit for limit in ADD_LIMITS if limit <= max(np.nanmax(shown), ADD_LIMITS[0])]
            marks = tuple(Mark(limit, add_row, f"{limit:g}%") for limit in limits)
        with self.curves.hold_sync():
            self.curves.x = tuple(map(float, self.frame_ids))
            self.curves.marks, self.curves.curves = marks, tuple(curves)

    def _picture(self, frame: int) -> Picture:
        frame_id, result = self.frame_ids[frame], self.results[frame]
        shelved, title = self._shelf(frame_id), f"{self.run.name}, image {frame_id}"
        if result is None:
            status = shelved.note or f"object {self.object_id} was not tracked in this image"
            return Picture(shelved.content, shelved.size, title, status)
        return Picture(
            image=shelved.content,
            image_size=shelved.size,
            title=title,
            status=shelved.note or self._told(result, self._add_percent[frame]),
            points=result.control_points if np.isfinite(result.control_points).all() else (),
            overlays=result_overlays(result),
            view=_view_of(result) if self.follow.value else (),
        )

    def _told(self, result: TrackResult, add_percent: float) -> str:
        words = [str(result.state), result.quality_in_words, f"{1e3 * result.timings.total_s:.1f} ms"]
        if np.isfinite(add_percent):
            words.insert(1, f"{self._metric} {add_percent:.2f} %")
        return ", ".join([*words, result.note] if result.note else words)


def _of_frames(results: Iterable[TrackResult], frame_ids: Iterable[int]) -> tuple[TrackResult | None, ...]:
    by_image = {result.frame_id: result for result in results}
    return tuple(by_image.get(frame_id) for frame_id in frame_ids)


def result_overlays(result: TrackResult) -> tuple[Overlay, ...]:
    """What a frame's result looks like over its image: image edges, generated edges, the way of the points."""
    overlays: list[Overlay] = []
    found = _image_edges(result)
    if len(found):
        overlays.append(Overlay("dots", found, IMAGE, "image edges", 2.5))
    if result.edges is not None and len(result.edges):
        overlays.extend(residual_strokes(result.edges, result.residuals_px, RESIDUAL_LABEL))
    if result.steps:
        ways = np.array([step.control_points for step in result.steps])
        overlays.extend(Overlay("line", ways[:, i], POINTS, "way of I in this frame", 1.5) for i in range(4))
        overlays.append(Overlay("dots", ways[0], START, "where I began", 6.0))
    return tuple(overlays)


def _image_edges(result: TrackResult) -> FloatArray:
    """(m, 2) px: the method's own edge map if it was recorded, else where each generated point found its edge."""
    if result.target is not None:
        return result.target.edge_points
    if result.edges is None or result.residuals_px is None:
        return np.zeros((0, 2))
    residuals = result.residuals_px
    seen = np.isfinite(residuals)
    points: FloatArray = result.edges.points[seen] + residuals[seen, None] * result.edges.normals[seen]
    return points


def _view_of(result: TrackResult) -> tuple[float, ...]:
    """A box around the part, of the aspect that most images have, so that the stage does not change its shape."""
    points = result.control_points if result.edges is None or not len(result.edges) else result.edges.points
    points = points[np.isfinite(points).all(1)]
    if len(points) == 0:
        return ()
    low, high = points.min(0), points.max(0)
    height = 1.25 * max(float((high - low)[1]), float((high - low)[0]) * 0.8, 20.0)
    x, y = 0.5 * (low + high) - 0.5 * height * np.array([1.25, 1.0])
    return float(x), float(y), 1.25 * height, height
