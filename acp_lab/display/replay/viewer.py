"""A run in rerun's viewer inside a notebook: `acp.show(run)`.

Works without a network: rerun's notebook viewer fetches its page from the net unless it is told otherwise before
its first import, which is done here. It sends no usage statistics either (`TelemetryGuard`). What is shown is a
replay made on the spot, so it needs the run's sequence for the images.
"""

from __future__ import annotations

import bisect
import contextlib
import io
import operator
import os
import sys
from collections import defaultdict
from collections.abc import Iterable, Mapping
from functools import partial
from itertools import takewhile
from typing import TYPE_CHECKING, Any

import traitlets

from acp_lab.display.replay.blueprint import comparison, single_run, spot_of
from acp_lab.display.replay.clock import Moment, RunningClock
from acp_lab.display.replay.curves import log_run_styles
from acp_lab.display.replay.images import ImageWriter
from acp_lab.display.replay.log import RunLog
from acp_lab.display.replay.object_log import object_name
from acp_lab.errors import AcpLabError, SequenceError
from acp_lab.sequences.frame import UnreadableFrame
from acp_lab.tracking.observer import SessionInfo
from acp_lab.tracking.result import TrackResult
from acp_lab.tracking.session import TrackRun, check_run

if TYPE_CHECKING:
    from rerun import RecordingStream

_ASSET_SETTING = "RERUN_NOTEBOOK_ASSET"
_ASSET = "serve-local"


class RunViewer(traitlets.HasTraits):
    """The viewer on one or two runs; displays itself as the last value of a notebook cell.

    It leaves the keyboard to the notebook until someone clicks into it.

    frame: the frame that is shown, counted from 0 over those with results. It follows the viewer, and the viewer
    follows it: `traitlets.link((viewer, "frame"), (player, "frame"))` keeps another widget in step.
    widget: rerun's own notebook viewer.
    """

    frame = traitlets.Int(0)

    def __init__(self, runs: Mapping[str, TrackRun], height_px: int = 640) -> None:
        """runs: one, or two by the names below which they are logged, such as "a" and "b"."""
        super().__init__()
        viewer_class = notebook_viewer()
        recording, self._moments = record(runs)
        self._timeline = "frame"
        self._led = False  # while the viewer leads, it need not be told what it said
        self.widget = viewer_class(width="auto", height=height_px, recording=recording)
        self.widget.on_event(self._on_event)
        self.observe(self._lead, "frame")

    def frame_at(self, timeline: str, time: float) -> int:
        """The frame at a time of a timeline: frame (a count), step (a count) or time (nanoseconds, as rerun has it)."""
        starts = [_value(moment, timeline) for moment in self._moments]
        return max(bisect.bisect_right(starts, time) - 1, 0)

    def _on_event(self, event: Any) -> None:
        if event.type == "timeline_change":
            self._timeline = event.timeline
        elif event.type != "time_update":
            return
        if self._timeline in ("frame", "step", "time"):
            self._led = True
            try:
                self.frame = self.frame_at(self._timeline, event.time)
            finally:
                self._led = False

    def _lead(self, change: Any) -> None:
        if not self._led:
            self._timeline = "frame"
            self.widget.set_time_ctrl(sequence=change["new"], timeline="frame")

    def _ipython_display_(self) -> None:
        from IPython.display import display

        from acp_lab.display.widgets.keyboard_guard import guarded
        from acp_lab.display.widgets.telemetry_guard import TelemetryGuard

        display(TelemetryGuard())  # first: the viewer tells of itself as soon as it is there
        display(guarded(self.widget._display_()))  # rerun's name for the bare widget, without a box around it


def show(run: TrackRun, other: TrackRun | None = None, height_px: int = 640) -> RunViewer:
    """Show a run in a notebook, or two runs over the same frames beside each other.

    Iterations are in it when the tracker's `records_steps` was set, image edges when `records_target` was.
    Raises AcpLabError where rerun's notebook viewer is missing, or was imported too early to be kept off the
    net; SequenceError for a run without a sequence that can be read again; ParameterError for what is no run.
    """
    runs = {"": run} if other is None else {"a": run, "b": other}
    for each in runs.values():
        check_run(each)
    return RunViewer(runs, height_px)


def notebook_viewer() -> Any:
    """rerun's notebook viewer, told to bring its page along; AcpLabError when that cannot be."""
    asset = os.environ.setdefault(_ASSET_SETTING, _ASSET)
    imported = sys.modules.get("rerun_notebook")
    if imported is not None and getattr(imported, "ASSET_IS_URL", False) and not asset.startswith("http"):
        raise AcpLabError(
            f"rerun's notebook viewer was imported before acp_lab could keep it off the net: restart the kernel and "
            f'import acp_lab first, or set os.environ["{_ASSET_SETTING}"] = "{_ASSET}" at its start'
        )
    try:
        with contextlib.redirect_stdout(io.StringIO()):  # it says at length how it serves its page
            import rerun_notebook  # noqa: F401
            from rerun.notebook import Viewer
    except ImportError:
        raise AcpLabError(
            'rerun\'s notebook viewer is not installed: run python -m pip install "acp_lab[notebook]" (in a checkout '
            "make lab does it), then restart the kernel"
        ) from None
    return Viewer


def record(runs: Mapping[str, TrackRun]) -> tuple[RecordingStream, tuple[Moment, ...]]:
    """Runs as a recording in memory, and when their frames begin; by the names below which they are logged."""
    import rerun as rr

    for run in runs.values():
        if run.sequence is None or run.session is None or not run.sequence.frame_ids:
            raise SequenceError(f"{run.name}: its images cannot be read again: show a run of a data set or a video")
        if not any(run.results.values()):
            raise SequenceError(f"{run.name}: has no results: show a run that tracked at least one frame")
    name = " and ".join(f"{run.name} ({run.method})" for run in runs.values())
    recording = rr.RecordingStream("acp_lab", recording_id=f"{name} {id(runs)}")
    recording.set_log_time_enabled(False)
    recording.set_log_tick_enabled(False)
    recording.send_recording_name(name)
    recording.send_blueprint(_layout(runs), make_active=True, make_default=True)
    moments: list[Moment] = []
    frame_ids = sorted({result.frame_id for run in runs.values() for of in run.results.values() for result in of})
    images = ImageWriter(recording)
    try:
        for root, run in runs.items():
            # Two runs may differ in length; the viewer's time goes to the end of the longer one.
            moments = max(moments, _log_run(recording, images, run, root, frame_ids), key=len)
    finally:
        images.close()
    if len(runs) > 1:
        log_run_styles(recording, {root: _names(run) for root, run in runs.items()})
    recording.flush()
    return recording, tuple(moments)


def _layout(runs: Mapping[str, TrackRun]) -> Any:
    first = next(iter(runs.values()))
    begins = {object_id: results[0] for object_id, results in first.results.items() if results}
    spot = spot_of(_session(first).objects, begins)
    if len(runs) == 1:
        return single_run(_names(first), spot)
    titles = {root: f"{root.upper()}: {run.method}" for root, run in runs.items()}
    return comparison(titles, {root: _names(run) for root, run in runs.items()}, spot)


def _log_run(
    recording: RecordingStream, images: ImageWriter, run: TrackRun, root: str, frame_ids: Iterable[int]
) -> list[Moment]:
    """Log a run; frame_ids: of all that are shown. One that this run lacks takes its time, so that others beside it
    have the same image at the same moment."""
    assert run.sequence is not None
    log = RunLog(recording, images, _session(run), "all", root=f"{root}/" if root else "", label=root.upper())
    clock, moments = RunningClock(), []
    # Results need not cover the sequence: a results file may begin late, or leave images out.
    by_image: dict[int, dict[int, TrackResult]] = defaultdict(dict)
    for object_id, results in run.results.items():
        for result in results:
            by_image[result.frame_id][object_id] = result
    last, coming, has_begun = max(by_image, default=-1), iter(frame_ids), False
    for frame in takewhile(lambda frame: frame.index <= last, run.sequence.frames()):
        if frame.index not in by_image:
            continue
        for missing in takewhile(partial(operator.ne, frame.index), coming):
            moments.append(clock.begin(UnreadableFrame(missing, None, "no result")))
            clock.end(0)
        moments.append(clock.begin(frame))
        if not has_begun:
            log.begin(moments[-1])
            has_begun = True
        log.frame(frame, by_image[frame.index], clock)
    log.end()
    return moments


def _session(run: TrackRun) -> SessionInfo:
    assert run.session is not None
    return run.session


def _names(run: TrackRun) -> list[str]:
    return [object_name(tracked.object_id) for tracked in _session(run).objects]


def _value(moment: Moment, timeline: str) -> float:
    return {"frame": float(moment.frame), "step": float(moment.step), "time": 1e9 * moment.time_s}[timeline]
