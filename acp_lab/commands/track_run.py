"""The frame loop of `acp-lab track` with all that listens to it: results, warnings, progress, replay."""

from __future__ import annotations

import os
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, fields, is_dataclass
from enum import Enum
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

from acp_lab.commands import console, interrupt, machine
from acp_lab.commands.methods import chosen_method
from acp_lab.commands.resume import Resumption, inputs_of, resumption
from acp_lab.commands.track import SceneJob, TrackOptions, scene_jobs, start_source
from acp_lab.errors import PreparationError, SequenceError, TrackingError
from acp_lab.machine import short_collections
from acp_lab.pasted import quoted
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.tracking.method import Method
from acp_lab.tracking.observer import Observer, SessionInfo
from acp_lab.tracking.result import EXACT, NOT_PREPARED, TrackResult, TrackState
from acp_lab.tracking.results_file import ResultsFile
from acp_lab.tracking.session import follow_sequence
from acp_lab.tracking.sought import MOST_KEPT, to_row
from acp_lab.tracking.states import StateConfig, StateMachine
from acp_lab.tracking.tracker import Tracker

if TYPE_CHECKING:
    from acp_lab.display.replay.recorder import Replay


class ResultsObserver(ResultsFile):
    """One file for all scenes; `info`, which goes on filling, becomes results.run.json, then and again by `finish`.

    go_on: the rows that stay; those of its image are not written again.
    """

    def __init__(self, path: Path, info: dict[str, Any], go_on: Resumption | None = None) -> None:
        super().__init__(path, info, None if go_on is None else go_on.file)
        self._info = info
        self._searches, self._unreadable = (info.setdefault(name, []) for name in ("searches", "unreadable"))
        self._stands = (go_on.scene_id, go_on.im_id) if go_on else None

    def on_frame(self, frame: Frame | UnreadableFrame, results: Mapping[int, TrackResult]) -> None:
        """Write the frame's rows, unless they stand there."""
        super().on_frame(frame, {} if (self._scene_id, frame.index) == self._stands else results)
        if isinstance(frame, UnreadableFrame) and len(self._unreadable) < MOST_KEPT:
            self._unreadable.append({"scene_id": self._scene_id, "im_id": frame.index})
        for object_id, result in results.items():
            if result.sought is not None and len(self._searches) < MOST_KEPT:
                self._searches.append(to_row(self._scene_id, result.frame_id, object_id, result.sought))

    def on_end(self) -> None:
        """Stay open for the next scene."""

    def finish(self) -> None:
        """Write what `info` holds by now, and close."""
        if self._writer is not None:
            self._writer.write_run_info(self._info)
        super().on_end()


class Reporter:
    """Warns of frames that cannot be read and of views that were not prepared, and shows progress on a terminal."""

    def __init__(self, total: int) -> None:
        self._progress = console.Progress()
        self._total = total

    def on_start(self, session: SessionInfo) -> None:
        self._name = session.name
        self._done = 0

    def on_frame(self, frame: Frame | UnreadableFrame, results: Mapping[int, TrackResult]) -> None:
        interrupt.check()
        self._done += 1
        if isinstance(frame, UnreadableFrame):
            self._progress.close()
            console.warn(f"image {frame.index}: {frame.reason}: its pose is predicted, with score 0")
        for object_id, result in results.items():
            if NOT_PREPARED in result.note:
                self._progress.close()
                console.warn(f"image {frame.index}, object {object_id}: {result.note}")
        self._progress(self._name, self._done, max(self._total, self._done) if self._total else 0)

    def on_end(self) -> None:
        self._progress.close()


@dataclass
class ObjectSummary:
    """What a run said about one object of one scene; prints as one line.

    bad_since: the image from which on it is not `tracking`, None while it is. first_lost: of the stretch in which it
    was lost first, as `acp-lab explain` counts. exactness: of the frames that this run itself has read.
    """

    scene_id: int
    object_id: int
    part: str
    size: str = ""
    times_s: list[float] = field(default_factory=list)
    qualities: list[float] = field(default_factory=list)
    exactness: list[float] = field(default_factory=list)
    states: Counter[str] = field(default_factory=Counter)
    unreadable: int = 0
    first_lost: int | None = None
    bad_since: int | None = None

    def add(self, im_id: int, state: TrackState, is_unreadable: bool) -> None:
        """Count a frame."""
        self.states[str(state)] += 1
        if state is TrackState.TRACKING:
            self.bad_since = None
        elif self.bad_since is None:
            self.bad_since = im_id
        if state is TrackState.LOST and self.first_lost is None:
            self.first_lost = self.bad_since
        self.unreadable += is_unreadable

    def add_seen(self, time_s: float, quality: float) -> None:
        """Take in a frame that was read."""
        self.times_s.append(time_s)
        self.qualities.append(quality)

    @property
    def was_good(self) -> bool:
        """Whether the part was ever `tracking`."""
        return self.states[str(TrackState.TRACKING)] > 0

    @property
    def time_s_median(self) -> float:
        """Median wall seconds per frame that was read; NaN when none was."""
        return median(self.times_s) if self.times_s else float("nan")

    def __str__(self) -> str:
        frames = f"{sum(self.states.values())} frames{self.size}"
        states = ", ".join(f"{count} {state}" for state, count in self.states.most_common())
        if self.first_lost is not None:
            states += f"; first lost from image {self.first_lost} on"
        if self.unreadable:
            states += f"; {self.unreadable} not readable"
        quality = f"{median(self.qualities):.2f}" if self.qualities else "-"
        if self.exactness and median(self.exactness) < EXACT:
            quality += f", exactness {median(self.exactness):.2f}"
        return (
            f"scene {self.scene_id}, object {self.object_id} ({self.part}): {frames} ({states}), "
            f"quality {quality}, {1e3 * self.time_s_median:.1f} ms per frame (medians)"
        )


@dataclass(frozen=True)
class RunSummary:
    """What came of a run; prints as a line per object. replay_lacks: what was left out of the replay, in words."""

    objects: tuple[ObjectSummary, ...] = ()
    replay_lacks: str = ""

    def __str__(self) -> str:
        return "\n".join(str(of_object) for of_object in self.objects)


class SummaryObserver:
    """Counts states and collects times; before: by object id, what a run that this one goes on with has seen."""

    def __init__(self, before: Mapping[int, ObjectSummary] | None = None) -> None:
        self.objects: dict[int, ObjectSummary] = dict(before or {})

    def on_start(self, session: SessionInfo) -> None:
        for tracked in session.objects:
            empty = ObjectSummary(session.scene_id, tracked.object_id, tracked.part.name)
            self.objects.setdefault(tracked.object_id, empty)

    def on_frame(self, frame: Frame | UnreadableFrame, results: Mapping[int, TrackResult]) -> None:
        for object_id, result in results.items():
            summary = self.objects[object_id]
            summary.add(frame.index, result.state, isinstance(frame, UnreadableFrame))
            if isinstance(frame, Frame):
                summary.size = f" of {frame.camera.width} x {frame.camera.height}"
                summary.add_seen(result.timings.total_s, result.quality)
                summary.exactness.append(result.exactness)

    def on_end(self) -> None:
        pass


def track_parts(options: TrackOptions) -> None:
    """Track, write the results and print what came of it."""
    interrupt.check()
    jobs = scene_jobs(options)
    live = any(not job.sequence.frame_ids for job in jobs)  # a camera announces no images
    summary = run_jobs(jobs, options)
    if summary.objects:
        print(summary)
    print(f"{options.out}: written{_next_after_loss(summary, options.out, live)}")
    if options.replay is not None and summary.objects:
        lacks = f" ({summary.replay_lacks})" if summary.replay_lacks else ""
        print(f"{options.replay}: written{lacks}; acp-lab replay {quoted(options.replay)} shows it")


def _next_after_loss(summary: RunSummary, out: Path, live: bool = False) -> str:
    """The command that explains the first loss, or that no frame was good; nothing where all went well.

    live: a camera was tracked, whose images are gone: nothing can be explained.
    """
    lost = next((one for one in summary.objects if one.first_lost is not None or not one.was_good), None)
    if lost is None or live:
        return ""
    which = f" --scene {lost.scene_id} --object {lost.object_id}" if len(summary.objects) > 1 else ""
    why = "it was lost, and where to start again" if lost.was_good else "no frame was good"
    return f"; acp-lab explain {quoted(out)}{which} says why {why}"


def run_jobs(jobs: Sequence[SceneJob], options: TrackOptions, extra: Sequence[Observer] = ()) -> RunSummary:
    """Track all scenes one after the other; what was seen, per scene and object.

    Writes options.out, results.run.json beside it, and options.replay. extra: observers of every scene.
    """
    if not jobs:
        raise SequenceError("nothing to track: no scene shows a part that was asked for")
    method = chosen_method(options.method_name, options.config)
    parts = {model.part.name: model for job in jobs for model in job.models.values()}
    # Before files are replaced: a part may lack the generator that the method needs.
    trackers = {name: Tracker(model, method) for name, model in parts.items()}
    generators = {name: tracker.generator_name for name, tracker in trackers.items()}
    for job in jobs:
        for object_id, pose in job.starts.items():
            with _named(job, options):
                trackers[job.models[object_id].part.name].check_region(pose)
    info = _run_info(parts, generators, method, options)
    info["inputs"] = inputs_of(jobs, options.parts, info["configuration"])
    go_on = resumption(options.out, jobs, info["inputs"], options.max_frames, method.states) if options.resume else None
    before = {} if go_on is None else {job.sequence.scene_id: seen_before(go_on, job, method.states) for job in jobs}
    if go_on is not None:
        info |= {name: go_on.kept(name) for name in ("searches", "unreadable")}
        # The scene that was begun comes first, whatever the order now: its rows are the last ones of the file.
        in_order = sorted(jobs, key=lambda job: job.sequence.scene_id != go_on.scene_id)
        jobs = [rest for job in in_order if (rest := go_on.rest_of(job)) is not None]
        info["resumed_after"] = {"scene_id": go_on.scene_id, "im_id": go_on.im_id}
        console.note(go_on.told(bool(jobs)))
        if not jobs:
            return RunSummary()
    console.note(_generators_in_use(generators))
    results = ResultsObserver(options.out, info, go_on)
    replay = None if options.replay is None else _replay(options, options.replay, jobs)
    listening: tuple[Observer, ...] = (results, *extra) if replay is None else (results, replay, *extra)
    start = time.perf_counter()
    with ExitStack() as at_the_end:
        if replay is not None:
            at_the_end.callback(replay.close)  # last: when it fails, the results are complete
        try:
            for job in jobs:
                earlier = before.get(job.sequence.scene_id, {})
                before[job.sequence.scene_id] = _follow(job, method, options, listening, earlier)
            info["complete"] = True
        finally:
            info["wall_s"] = time.perf_counter() - start
            info["peak_memory_mb"] = machine.peak_memory_mb()
            results.finish()
    summaries = tuple(summary for of_scene in before.values() for summary in of_scene.values())
    return RunSummary(summaries, "" if replay is None else replay.lacks)


def seen_before(go_on: Resumption, job: SceneJob, states: StateConfig) -> dict[int, ObjectSummary]:
    """By object id, what the kept rows of a scene say; not of the image in which the tracker starts again.

    Times and qualities are those of rows with a score above 0: of the others nobody knows whether there was an image.
    """
    found: dict[int, ObjectSummary] = {}
    machines: dict[int, StateMachine] = {}
    unreadable = {(entry["scene_id"], entry["im_id"]) for entry in go_on.kept("unreadable")}
    for row in go_on.rows:
        image = row.scene_id, row.im_id
        if row.scene_id != job.sequence.scene_id or image == (go_on.scene_id, go_on.im_id):
            continue
        if row.obj_id not in found:
            found[row.obj_id] = ObjectSummary(row.scene_id, row.obj_id, job.models[row.obj_id].part.name)
            machines[row.obj_id] = StateMachine(states)
        machines[row.obj_id].replay(row.score)
        found[row.obj_id].add(row.im_id, machines[row.obj_id].state, image in unreadable)
        if row.score > 0.0:
            found[row.obj_id].add_seen(row.time_s, row.score)
    return found


def _follow(
    job: SceneJob,
    method: Method,
    options: TrackOptions,
    listening: Sequence[Observer],
    before: Mapping[int, ObjectSummary],
) -> dict[int, ObjectSummary]:
    """Track one scene; what was seen of it by object id, with what was before."""
    most = None if options.max_frames is None else options.max_frames - job.tracked_before
    count = len(job.sequence.frame_ids)
    seen, reporter = SummaryObserver(before), Reporter(min(count, most or count))
    trackers = {object_id: Tracker(model, method) for object_id, model in job.models.items()}
    observers = (listening[0], seen, reporter, *listening[1:])
    with _named(job, options), short_collections():
        follow_sequence(
            trackers, job.sequence, job.starts, observers=observers, max_frames=most, found=job.found
        )
    return seen.objects


@contextmanager
def _named(job: SceneJob, options: TrackOptions) -> Iterator[None]:
    """Say of a start that is refused, and nothing else is, where its pose comes from."""
    try:
        yield
    except (PreparationError, TrackingError) as error:
        raise type(error)(f"{start_source(job, options)}: {error}") from None


def _replay(options: TrackOptions, path: Path, jobs: Sequence[SceneJob]) -> Replay:
    from acp_lab.display.replay.recorder import Replay

    most_mb = float("inf") if options.replay_max_mb is None else options.replay_max_mb
    counts = [min(len(job.sequence.frame_ids), options.max_frames or sys.maxsize) for job in jobs]
    # One session more than there are: it is closed when the results are.
    return Replay(path, len(jobs) + 1, options.replay_iterations, most_mb, sum(counts) if all(counts) else 0)


def _generators_in_use(generators: Mapping[str, str]) -> str:
    """One line: which generator draws the edges of which parts."""
    users: dict[str, list[str]] = {}
    for part, generator in sorted(generators.items()):
        users.setdefault(generator, []).append(part)
    return "generator of edges: " + "; ".join(f"{name} for {', '.join(of)}" for name, of in users.items())


def _run_info(
    parts: Mapping[str, PreparedPart],
    generators: Mapping[str, str],
    method: Method,
    options: TrackOptions,
) -> dict[str, Any]:
    return {
        "command": ["acp-lab", *sys.argv[1:]],
        "folder": os.getcwd(),
        "method": method.name,
        "options": plain(options),
        "configuration": plain(method),
        "parts": {name: {"sha256": model.part.sha256, "generator": generators[name]} for name, model in parts.items()},
        "threads": options.threads,
        "machine": machine.machine(),
        "versions": machine.versions(),
        "complete": False,
    }


def plain(value: Any) -> Any:
    """A configuration as JSON can hold it: dataclasses as objects, paths and anything unknown as text."""
    if is_dataclass(value) and not isinstance(value, type):
        # Which of several kinds a part of a method is, is known to its class.
        kind = {"kind": type(value).__dict__["kind"]} if "kind" in type(value).__dict__ else {}
        return kind | {item.name: plain(getattr(value, item.name)) for item in fields(value)}
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(item) for item in value]
    if isinstance(value, Enum):
        return plain(value.value)
    if value is None or isinstance(value, bool | int | str):
        return value
    to_list: Callable[[], Any] | None = getattr(value, "tolist", None)  # NumPy arrays and numbers
    if to_list is not None:
        return plain(to_list())
    if isinstance(value, float):
        return value if abs(value) < float("inf") else str(value)
    return str(value)
