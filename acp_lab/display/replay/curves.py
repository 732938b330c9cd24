"""The curves and the words of a replay: numbers per frame and object, and what happened when.

All curves share one look per object. Values that are not finite are left out: the curve has a gap there in its
points, and nothing is made up. States change rarely, so they are logged when they do, with the reason.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from acp_lab.control_points.view_regions import REGION_NAMES
from acp_lab.display.accuracy import AddPercent
from acp_lab.display.colours import GREEN, GREY, ORANGE, PURPLE, SKY, VERMILLION, YELLOW, lighter, to_bytes
from acp_lab.display.replay.columns import ColumnBuffer
from acp_lab.display.replay.object_log import object_name
from acp_lab.evaluation import PoseError, pose_error
from acp_lab.geometry.arrays import FloatArray
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.tracking.observer import TrackedObject
from acp_lab.tracking.result import TrackResult, TrackState
from acp_lab.tracking.uncertainty import spread

if TYPE_CHECKING:
    from rerun import RecordingStream

CURVES = ("quality", "loss", "add_percent", "pose_error", "uncertainty", "iterations", "ms", "region", "step_loss")
"""Entities below `curves/`; each has one curve per object but for those with SERIES."""
SERIES = {
    "pose_error": {"rotation [deg]": SKY, "translation [mm]": ORANGE},
    "uncertainty": {"turn [deg]": SKY, "shift [mm]": ORANGE},
    "ms": {
        "undistort": GREY,
        "image": SKY,
        "generate": GREEN,
        "search": YELLOW,
        "solve": ORANGE,
        "learn": PURPLE,
        "total": VERMILLION,
    },
}
RUN_COLOURS = (lighter(SKY, 0.2), ORANGE)
STATE_COLOURS = {TrackState.TRACKING: GREEN, TrackState.WEAK: ORANGE, TrackState.LOST: VERMILLION}


class CurveLog:
    """Logs one object's numbers and states; `label` names it in legends, where it is among others in every one."""

    def __init__(
        self,
        log: ColumnBuffer,
        tracked: TrackedObject,
        colour: tuple[float, ...],
        label: str,
        among_others: bool,
    ) -> None:
        self._log = log
        self._among_others = among_others
        self._tracked = tracked
        self._colour = colour
        self._label = label
        self._name = object_name(tracked.object_id)
        self._add_percent = AddPercent(tracked.part)
        self._state: TrackState | None = None
        self._sought = ""
        self._region: int | None = None

    def begin(self) -> None:
        """Log the names and colours of the curves."""
        import rerun as rr

        for curve in CURVES:
            series = SERIES.get(curve, {"": self._colour})
            names = [f"{self._label} {part}".strip() if part == "" or self._among_others else part for part in series]
            style = rr.SeriesLines(names=names, colors=[to_bytes(colour) for colour in series.values()])
            self._log.style(f"curves/{curve}/{self._name}", style)
        lanes = rr.StateConfiguration(
            values=[str(state) for state in STATE_COLOURS],
            labels=[str(state) for state in STATE_COLOURS],
            colors=[to_bytes(colour) for colour in STATE_COLOURS.values()],
        )
        self._log.style(f"state/{self._name}", lanes)

    def result(self, frame: Frame | UnreadableFrame, result: TrackResult, cam_T_true: FloatArray | None) -> None:
        """Log a frame's numbers, and its state where it is another than before."""
        add_percent, error = self._errors(result, cam_T_true)
        times = result.timings
        stages = (times.undistort_s, times.image_s, times.generate_s, times.search_s, times.solve_s, times.learn_s)
        self._log_scalars("quality", result.quality)
        self._log_scalars("loss", result.loss)
        if error is not None:
            self._log_scalars("add_percent", add_percent)
            self._log_scalars("pose_error", error.rotation_deg, error.translation_mm)
        if result.covariance is not None:
            self._log_scalars("uncertainty", *spread(result.covariance))
        self._log_scalars("iterations", result.iterations)
        self._log_scalars("ms", *(1e3 * seconds for seconds in (*stages, times.total_s)))
        self._log_scalars("region", result.region)
        self._log_numbers(frame, result, add_percent, error)
        self._log_state(frame, result)

    def _errors(self, result: TrackResult, cam_T_true: FloatArray | None) -> tuple[float, PoseError | None]:
        if cam_T_true is None:
            return math.nan, None
        symmetries = self._tracked.part.symmetries
        return self._add_percent(result.cam_T_obj, cam_T_true), pose_error(result.cam_T_obj, cam_T_true, symmetries)

    def _log_scalars(self, curve: str, *values: float) -> None:
        import rerun as rr

        if np.isfinite(values).all():
            self._log.row(f"curves/{curve}/{self._name}", rr.Scalars, scalars=np.array(values, np.float64))

    def _log_numbers(
        self, frame: Frame | UnreadableFrame, result: TrackResult, add_percent: float, error: PoseError | None
    ) -> None:
        import rerun as rr

        lines = [f"**{self._label}: {result.state}** in image {frame.index}"]
        lines.append(
            f"quality {result.quality:.2f}, loss {result.loss:.2f}, region {REGION_NAMES[result.region]}, "
            f"{result.iterations} iterations, {1e3 * result.timings.total_s:.1f} ms"
        )
        if result.covariance is not None:
            turn_deg, shift_mm = spread(result.covariance)
            lines.append(
                f"known to {turn_deg:.2f} deg, {shift_mm:.2f} mm (one standard deviation), "
                f"within 5 % of the diameter with {result.exactness:.2f}"
            )
        if error is not None:
            lines.append(
                f"{self._add_percent.metric} {add_percent:.2f} % of the diameter, {error.rotation_deg:.2f} deg, "
                f"{error.translation_mm:.2f} mm"
            )
        if isinstance(frame, UnreadableFrame):
            lines.append(f"unreadable: {frame.reason}")
        if result.sought is not None:
            lines.append(str(result.sought))
        text = "\n\n".join(lines)
        self._log.row(f"numbers/{self._name}", rr.TextDocument, text=[text], media_type=["text/markdown"])

    def _log_state(self, frame: Frame | UnreadableFrame, result: TrackResult) -> None:
        import rerun as rr

        entity = f"state/{self._name}"
        for text in self._news(frame, result):
            self._log.now(entity, rr.TextLog(text, level=_level(frame, result)))
        if result.state is not self._state:
            self._log.now(entity, rr.StateChange(state=str(result.state)))
        self._state, self._region = result.state, result.region

    def _news(self, frame: Frame | UnreadableFrame, result: TrackResult) -> list[str]:
        """What is worth a line in the log: state changes, unreadable frames, searches, another region."""
        where = f"{self._label}, image {frame.index}"
        now = REGION_NAMES[result.region]
        if self._state is None:
            return [f"{where}: starts in region {now}, {result.state}, quality {result.quality:.2f}"]
        news = []
        if isinstance(frame, UnreadableFrame):
            news.append(f"{where}: unreadable: {frame.reason}")
        elif result.note:
            back = self._state is TrackState.LOST and result.state is not TrackState.LOST
            news.append(f"{where}: {'back: ' if back else ''}{result.note}")
        elif result.state is not self._state:
            news.append(f"{where}: {self._state} -> {result.state}: quality {result.quality:.2f}")
        sought = "" if result.sought is None else str(result.sought)
        if sought and sought != self._sought:
            news.append(f"{where}: {sought}")
        self._sought = sought
        if self._region is not None and result.region != self._region:
            news.append(f"{where}: view region {REGION_NAMES[self._region]} -> {now}")
        return news


def log_run_styles(recording: RecordingStream, objects: Mapping[str, Sequence[str]]) -> None:
    """Give the curves of runs that share their plots one colour per run.

    objects: the names of the tracked objects' entities, by the name of the entity below which a run is.
    """
    import rerun as rr

    for order, (root, names) in enumerate(objects.items()):
        colour = RUN_COLOURS[order % len(RUN_COLOURS)]
        for curve, name in product(CURVES, names):
            label = f"{root.upper()} {name}" if len(names) > 1 else root.upper()
            series = list(SERIES.get(curve, {"": colour}))
            style = rr.SeriesLines(
                names=[f"{label} {part}".strip() for part in series],
                colors=[to_bytes(colour)] * len(series),
                # Of two runs' times only the sums can be told apart.
                visible_series=[curve != "ms" or part == series[-1] for part in series],
            )
            recording.log(f"{root}/curves/{curve}/{name}", style, static=True)


def _level(frame: Frame | UnreadableFrame, result: TrackResult) -> Any:
    import rerun as rr

    if result.state is TrackState.LOST:
        return rr.TextLogLevel.ERROR
    weak = result.state is TrackState.WEAK or isinstance(frame, UnreadableFrame)
    return rr.TextLogLevel.WARN if weak else rr.TextLogLevel.INFO
