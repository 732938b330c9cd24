"""The frame loop of `acp-lab track` with all that listens to it: results, warnings, progress, replay."""

from __future__ import annotations

import os
import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from enum import Enum
from pathlib import Path
from statistics import median
from typing import Any

from acp_lab.commands import console, interrupt, machine
from acp_lab.commands.methods import chosen_method
from acp_lab.commands.resume import Resumption, inputs_of, resumption
from acp_lab.commands.track import DEFAULT_METHOD, SceneJob, TrackOptions, scene_jobs
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.sequences.rest import RestOfSequence
from acp_lab.tracking.method import Method
from acp_lab.tracking.observer import Observer, SessionInfo
from acp_lab.tracking.result import NOT_PREPARED, TrackResult, TrackState
from acp_lab.tracking.results_file import ResultsFile
from acp_lab.tracking.session import track_sequence
from acp_lab.tracking.tracker import Tracker


class ResultsObserver(ResultsFile):
    """One file for all scenes; `info`, which goes on filling, becomes results.run.json, then and again by `finish`.

    go_on: the rows that stay; those of its image are not written again.
    """

    def __init__(self, path: Path, info: dict[str, Any], go_on: Resumption | None = None) -> None:
        super().__init__(path, info, go_on.keep_bytes if go_on else 0)
        self._info = info
        self._stands = (go_on.scene_id, go_on.im_id) if go_on else None

    def on_frame(self, frame: Frame | UnreadableFrame, results: Mapping[int, TrackResult]) -> None:
        """Write the frame's rows, unless they stand there."""
        super().on_frame(frame, {} if (self._scene_id, frame.index) == self._stands else results)

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
    """What a run said about one object of one scene; prints as one line."""

    scene_id: int
    object_id: int
    part: str
    size: str = ""
    times_s: list[float] = field(default_factory=list)
    qualities: list[float] = field(default_factory=list)
    states: Counter[str] = field(default_factory=Counter)
    unreadable: int = 0
    first_lost: int | None = None

    @property
    def time_s_median(self) -> float:
        """Median wall seconds per frame that was read; NaN when none was."""
        return median(self.times_s) if self.times_s else float("nan")

    def __str__(self) -> str:
        frames = f"{sum(self.states.values())} frames{self.size}"
        states = ", ".join(f"{count} {state}" for state, count in self.states.most_common())
        if self.first_lost is not None:
            states += f"; first lost in image {self.first_lost}"
        if self.unreadable:
            states += f"; {self.unreadable} not readable"
        quality = f"{median(self.qualities):.2f}" if self.qualities else "-"
        return (
            f"scene {self.scene_id}, object {self.object_id} ({self.part}): {frames} ({states}), "
            f"quality {quality}, {1e3 * self.time_s_median:.1f} ms per frame (medians)"
        )


class SummaryObserver:
    """Counts states and collects times."""

    def __init__(self) -> None:
        self.objects: dict[int, ObjectSummary] = {}

    def on_start(self, session: SessionInfo) -> None:
        self.objects = {
            tracked.object_id: ObjectSummary(session.scene_id, tracked.object_id, tracked.part.name)
            for tracked in session.objects
        }

    def on_frame(self, frame: Frame | UnreadableFrame, results: Mapping[int, TrackResult]) -> None:
        for object_id, result in results.items():
            summary = self.objects[object_id]
            summary.states[str(result.state)] += 1
            if result.state is TrackState.LOST and summary.first_lost is None:
                summary.first_lost = frame.index
            summary.unreadable += isinstance(frame, UnreadableFrame)
            if isinstance(frame, Frame):
                summary.size = f" of {frame.camera.width} x {frame.camera.height}"
                summary.times_s.append(result.timings.total_s)
                summary.qualities.append(result.quality)

    def on_end(self) -> None:
        pass


def track_parts(options: TrackOptions) -> None:
    """Track, write the results and print what came of it."""
    interrupt.check()
    for summary in run_jobs(scene_jobs(options), options):
        print(summary)
    print(f"{options.out}: written")
    if options.replay is not None:
        print(f"{options.replay}: written; acp-lab replay {options.replay} shows it")


def run_jobs(
    jobs: Sequence[SceneJob], options: TrackOptions, extra: Sequence[Observer] = ()
) -> tuple[ObjectSummary, ...]:
    """Track all scenes one after the other; what was seen, per scene and object.

    Writes options.out, results.run.json beside it, and options.replay. extra: observers of every scene.
    """
    method = chosen_method(options.method or DEFAULT_METHOD, options.config)
    parts = {model.part.name: model for job in jobs for model in job.models.values()}
    # Before files are replaced: a part may lack the generator that the method needs.
    generators = {name: Tracker(model, method).generator_name for name, model in parts.items()}
    info = _run_info(parts, generators, method, options)
    info["inputs"] = inputs_of(jobs, options.parts, info["configuration"])
    go_on = resumption(options.out, jobs, info["inputs"], options.max_frames) if options.resume else None
    if go_on is not None:
        jobs = [rest for job in jobs if (rest := go_on.rest_of(job)) is not None]
        info["resumed_after"] = {"scene_id": go_on.scene_id, "im_id": go_on.im_id}
        console.note(go_on.told(bool(jobs)))
        if not jobs:
            return ()
    replays = [] if options.replay is None else [_replay(options, len(jobs))]
    summaries: list[ObjectSummary] = []
    console.note(_generators_in_use(generators))
    results = ResultsObserver(options.out, info, go_on)
    start = time.perf_counter()
    try:
        for job in jobs:
            seen = SummaryObserver()
            most = options.max_frames
            if most is not None and isinstance(job.sequence, RestOfSequence):
                most -= job.sequence.skipped
            count = len(job.sequence.frame_ids)
            reporter = Reporter(min(count, most or count))
            track_sequence(
                {object_id: Tracker(model, method) for object_id, model in job.models.items()},
                job.sequence,
                job.starts,
                observers=(results, seen, reporter, *replays, *extra),
                max_frames=most,
            )
            summaries += seen.objects.values()
        info["complete"] = True
    finally:
        info["wall_s"] = time.perf_counter() - start
        info["peak_memory_mb"] = machine.peak_memory_mb()
        results.finish()
    return tuple(summaries)


def _replay(options: TrackOptions, sessions: int) -> Observer:
    from acp_lab.display.replay.recorder import Replay

    assert options.replay is not None
    return Replay(options.replay, sessions, options.replay_iterations)


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
