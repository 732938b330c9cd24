"""A session: several parts tracked side by side through one sequence, with observers listening."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Protocol

import numpy as np

from acp_lab.cad.part import Part
from acp_lab.errors import ParameterError, SequenceError, check_kind
from acp_lab.geometry.arrays import FloatArray
from acp_lab.sequences.frame import Frame, UnreadableFrame, check_frame
from acp_lab.sequences.protocol import Sequence
from acp_lab.sequences.results_csv import ResultRow
from acp_lab.tracking.observer import Observer, SessionInfo, TrackedObject
from acp_lab.tracking.result import TrackResult


class PartTracker(Protocol):
    """What every tracker offers: start with a pose, then follow.

    name: of the method. part: that is tracked. control_points_obj: (4, 3) mm per view region 0..5, the method's W.
    records_steps, records_target: whether results carry `steps` and `target`; the session sets them while observers
    want to see these.
    """

    part: Part
    records_steps: bool
    records_target: bool

    @property
    def name(self) -> str: ...
    @property
    def control_points_obj(self) -> tuple[FloatArray, ...]: ...

    def start(self, frame: Frame, cam_T_obj: FloatArray, found: bool = False) -> TrackResult:
        """Begin at a pose (4, 4) in the first frame; found: whether it was found in that frame."""
        ...

    def track(self, frame: Frame | UnreadableFrame) -> TrackResult:
        """The pose in the next frame."""
        ...


@dataclass(frozen=True, eq=False)
class TrackRun:
    """All results of one session, and what is needed to look at them again; the images stay in the sequence.

    Attributes:
        name: of the sequence; scene_id: its id in results; method: such as "acp".
        results: per object id, one result per frame in order. Target views are kept only of trackers whose
            `records_target` was set beforehand: they are large.
        sequence: that was tracked, to read its frames again.
        session: what observers were told of it: objects, truth, where the images are.
        starts: (4, 4) start poses, per object id.
    """

    name: str
    scene_id: int
    method: str
    results: Mapping[int, tuple[TrackResult, ...]]
    sequence: Sequence | None = None
    session: SessionInfo | None = None
    starts: Mapping[int, FloatArray] = field(default_factory=dict)

    @property
    def parts(self) -> Mapping[int, Part]:
        """The CAD parts by object id; empty for a run that was not made by `track_sequence`."""
        objects = () if self.session is None else self.session.objects
        return {tracked.object_id: tracked.part for tracked in objects}

    @property
    def rows(self) -> tuple[ResultRow, ...]:
        """As rows of results.csv, frame by frame."""
        rows = [
            ResultRow(
                self.scene_id,
                result.frame_id,
                object_id,
                result.quality,
                result.cam_T_obj,
                result.timings.total_s,
            )
            for object_id, results in self.results.items()
            for result in results
        ]
        return tuple(sorted(rows, key=lambda row: (row.im_id, row.obj_id)))

    def __str__(self) -> str:
        lines = []
        for object_id, results in self.results.items():
            if not results:
                lines.append(f"{self.name}, object {object_id}, {self.method}: no frames")
                continue
            times = [result.timings.total_s for result in results[1:]] or [float("nan")]
            quality = float(np.median([result.quality for result in results]))
            lines.append(
                f"{self.name}, object {object_id}, {self.method}: {len(results)} frames, median quality {quality:.2f}, "
                f"{1e3 * float(np.median(times)):.1f} ms per frame, last state {results[-1].state}"
            )
        return "\n".join(lines)


def check_run(run: object) -> None:
    """ParameterError for an argument that is no `TrackRun`, such as the path of a results file or a replay."""
    fix = "what tracker.run returned; files are opened by acp-lab explain and acp-lab replay"
    check_kind(run, TrackRun, "run", fix)


def track_sequence(
    trackers: Mapping[int, PartTracker],
    sequence: Sequence,
    starts: Mapping[int, FloatArray],
    observers: Iterable[Observer] = (),
    max_frames: int | None = None,
    method: str | None = None,
    found: Collection[int] = (),
) -> TrackRun:
    """Track objects through a sequence, and keep all results: tens of kilobytes per frame and object.

    Arguments and errors as in `follow_sequence`. A live camera has no end: an interrupt (Ctrl-C, Jupyter's stop button)
    ends its run, and what was tracked until then is returned.
    """
    keeper = _Keeper(trackers)
    try:
        follow_sequence(trackers, sequence, starts, (keeper, *_checked(observers)), max_frames, method, found)
    except KeyboardInterrupt:
        if sequence.frame_ids or not keeper.has_results:
            raise
    info = keeper.session
    assert info is not None
    return TrackRun(
        sequence.name,
        sequence.scene_id,
        info.method,
        {object_id: tuple(of_object) for object_id, of_object in keeper.results.items()},
        sequence,
        info,
        {object_id: np.array(starts[object_id], np.float64) for object_id in trackers},
    )


def follow_sequence(
    trackers: Mapping[int, PartTracker],
    sequence: Sequence,
    starts: Mapping[int, FloatArray],
    observers: Iterable[Observer] = (),
    max_frames: int | None = None,
    method: str | None = None,
    found: Collection[int] = (),
) -> SessionInfo:
    """Track objects through a sequence; observers get the results, nothing is kept, however long it takes.

    The first frame is tracked from the start poses and has results too.

    Args:
        trackers: by object id.
        starts: (4, 4) cam_T_obj in the first frame, by object id.
        method: what the run is called; None for the first tracker's name.
        found: ids of objects whose start pose was found in the first frame, see `Tracker.start`.

    Raises:
        SequenceError: no trackers, one for several objects, no frames, or the first one cannot be read.
        ParameterError: another kind of argument, or a frame that is none.
        TrackingError, GeometryError, PreparationError: as `Tracker.start`, of a start pose.
    """
    listening = _checked(observers)
    if not (max_frames is None or isinstance(max_frames, int)):
        raise ParameterError(f"max_frames = {max_frames!r}: give a whole number, or None for all")
    for what, given in (("trackers", trackers), ("starts", starts)):
        check_kind(given, Mapping, what, "a dictionary by object id, such as {1: …}")
    if len({id(tracker) for tracker in trackers.values()}) < len(trackers):
        raise SequenceError(f"{sequence.name}: one tracker for several objects: make one for each, acp.Tracker(model)")
    if not trackers:
        raise SequenceError(f"{sequence.name}: there is no object to track; give a tracker for each")
    without = sorted(set(trackers) - set(starts))
    if without:
        raise SequenceError(f"{sequence.name}: no start pose for object {without[0]}; give one for each tracker")
    method = next(iter(trackers.values())).name if method is None else method
    info = _session_info(trackers, sequence, max_frames, method)
    number = -1
    with ExitStack() as at_the_end:
        # Also after Ctrl-C, and each whatever the others do: files are closed and keep what was tracked.
        for observer in reversed(listening):
            at_the_end.callback(observer.on_end)
        for observer in listening:
            observer.on_start(info)
        for tracker in trackers.values():
            _record_for(listening, tracker, at_the_end)
        for number, frame in enumerate(sequence.frames(max_frames)):
            if number == 0 and isinstance(frame, UnreadableFrame):
                raise SequenceError(f"{frame.reason}: the first frame must be readable, tracking starts there")
            if not isinstance(frame, UnreadableFrame):
                check_frame(frame)
            of_frame = {
                object_id: _started(tracker, frame, starts[object_id], object_id in found)
                if number == 0 and isinstance(frame, Frame)
                else tracker.track(frame)
                for object_id, tracker in trackers.items()
            }
            for observer in listening:
                observer.on_frame(frame, of_frame)
    if number < 0:
        raise SequenceError(f"{sequence.name}: there is no frame to track")
    return info


def _started(tracker: PartTracker, frame: Frame, cam_T_obj: FloatArray, is_found: bool) -> TrackResult:
    """The first frame, from a pose (4, 4). Trackers of others need not know of poses that were found."""
    return tracker.start(frame, cam_T_obj, found=True) if is_found else tracker.start(frame, cam_T_obj)


class _Keeper:
    """Keeps all results; target views only of trackers that record them without being asked by observers."""

    def __init__(self, trackers: Mapping[int, PartTracker]) -> None:
        self.results: dict[int, list[TrackResult]] = {object_id: [] for object_id in trackers}
        self.session: SessionInfo | None = None
        self._keeps_target = {object_id: tracker.records_target for object_id, tracker in trackers.items()}

    @property
    def has_results(self) -> bool:
        """Whether a frame was tracked."""
        return any(self.results.values())

    def on_start(self, session: SessionInfo) -> None:
        self.session = session

    def on_frame(self, frame: Frame | UnreadableFrame, results: Mapping[int, TrackResult]) -> None:
        for object_id, result in results.items():
            kept = result if self._keeps_target[object_id] else replace(result, target=None)
            self.results[object_id].append(kept)

    def on_end(self) -> None:
        pass


def _checked(observers: Iterable[Observer]) -> tuple[Observer, ...]:
    """ParameterError for a single one, and for what is none."""
    check_kind(observers, Iterable, "observers", "a list, such as [acp.Replay('run.rrd')]")
    listening = tuple(observers)
    for observer in listening:
        if not hasattr(observer, "on_frame"):
            raise ParameterError(f"observers: a {type(observer).__name__} is none: give acp.Replay(...) and the like")
    return listening


def _session_info(
    trackers: Mapping[int, PartTracker], sequence: Sequence, max_frames: int | None, method: str
) -> SessionInfo:
    tracked = tuple(
        TrackedObject(object_id, tracker.part, tracker.control_points_obj)
        for object_id, tracker in trackers.items()
    )
    count = len(sequence.frame_ids)
    return SessionInfo(
        sequence.name,
        sequence.scene_id,
        method,
        tracked,
        sequence.truth,
        count if max_frames is None else min(count, max_frames),
        image_path_of(sequence),
    )


def image_path_of(sequence: Sequence) -> Callable[[int], Path | None] | None:
    """For `SessionInfo.image_path`: data sets keep one file per image id and alter nothing."""
    paths = getattr(sequence, "image_paths", None)
    return paths.get if isinstance(paths, Mapping) else None


def _record_for(observers: tuple[Observer, ...], tracker: PartTracker, at_the_end: ExitStack) -> None:
    """Let a tracker record what some observer wants to see, and put it back at the end."""
    for wish, switch in (("wants_steps", "records_steps"), ("wants_target", "records_target")):
        if any(getattr(observer, wish, False) for observer in observers):
            at_the_end.callback(setattr, tracker, switch, getattr(tracker, switch))
            setattr(tracker, switch, True)
