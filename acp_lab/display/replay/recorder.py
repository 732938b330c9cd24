"""A run as a rerun recording: what was seen, what was generated, what was believed, frame by frame.

    run = acp.Tracker(model).run(scene, scene.first_pose, observers=[acp.Replay("run.rrd")])

    acp-lab replay run.rrd

docs/replay.md lists the entities and the timelines. The file is written while the run goes on: a run that is
killed leaves one that `acp-lab replay` opens, up to its torn end.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import numpy as np

from acp_lab.display.replay.blueprint import single_run, spot_of
from acp_lab.display.replay.budget import SizeBudget
from acp_lab.display.replay.clock import RunningClock
from acp_lab.display.replay.images import ImageWriter
from acp_lab.display.replay.log import BRIGHT_COLOURS, Iterations, RunLog
from acp_lab.display.replay.object_log import object_name
from acp_lab.errors import InputFileError, ParameterError
from acp_lab.files import check_replaces_own
from acp_lab.input_file import path_of
from acp_lab.locks import only_writer
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.tracking.observer import SessionInfo
from acp_lab.tracking.result import TrackResult

APPLICATION = "acp_lab"
RUN_PROPERTY = "acp_lab_run"
"""Property of a recording: what `replay.file` has to know of it, as that a torn file lacks so many frames."""


FLUSH_S, LAST_FLUSH_S = 5.0, 120.0
"""How long to wait for rerun's writer. On a full disk it sometimes dies without a word."""


def _disconnect(recording: Any) -> None:
    with suppress(RuntimeError):
        recording.disconnect()


class Replay:
    """Observer that writes an .rrd file for `acp-lab replay` (or `rerun FILE.rrd`).

    path: the file, replaced. sessions: how many sessions (scenes) follow each other in it; the file is
    complete after the last one's end. iterations: of which frames the iterations are recorded. most_mb: how large the
    file may become (`budget`). frames: that come in all sessions, 0 where nobody knows.
    Raises InputFileError when the file cannot be written, is no replay, or another program is writing it;
    ParameterError for other arguments than these.
    """

    wants_target = True

    def __init__(
        self,
        path: str | Path,
        sessions: int = 1,
        iterations: Iterations = "off",
        most_mb: float = float("inf"),
        frames: int = 0,
    ) -> None:
        if iterations not in get_args(Iterations):
            raise ParameterError(f"iterations = {iterations!r}: give one of {', '.join(get_args(Iterations))}")
        for name, count, least in (("sessions", sessions, 1), ("frames", frames, 0)):
            if not isinstance(count, int | np.integer) or count < least:
                raise ParameterError(f"{name} = {count!r}: give a whole number, {least} or more")
        if not isinstance(most_mb, int | float | np.number) or not most_mb > 0.0:
            raise ParameterError(f"most_mb = {most_mb!r}: give megabytes, above 0")
        self.path = path_of(path, "a replay", "run.rrd")
        check_replaces_own(self.path, b"RRF", "the replay", "a replay")
        self.iterations = iterations
        self.wants_steps = iterations != "off"
        self._sessions = self._sessions_left = sessions
        self._clock = RunningClock()
        self._scenes: list[tuple[str, int]] = []
        self._objects: list[int] = []
        self._recording: Any = None
        self._images: ImageWriter | None = None
        self._log: RunLog | None = None
        self._budget = SizeBudget(1e6 * most_mb)
        self._frames, self._frames_in_all = 0, frames
        self._sent_before, self._sent_in_file = 0, -1
        self._failure: RuntimeError | None = None
        self._lock = ExitStack()
        self._is_complete = False

    @property
    def lacks(self) -> str:
        """One line: what was left out to keep the file small; empty where nothing."""
        return self._budget.told

    def on_start(self, session: SessionInfo) -> None:
        """Forget the last session's things; ParameterError for one more session than was announced."""
        if self._is_complete:
            raise ParameterError(
                f"{self.path}: this replay is complete, another run would replace it: make a new acp.Replay, or one of "
                f"sessions={self._sessions + 1} for both runs in one file"
            )
        # Names of folders need not be UTF-8, those in a recording must.
        self._session = replace(session, name=session.name.encode("utf-8", "replace").decode())
        self._log = None

    def on_frame(self, frame: Frame | UnreadableFrame, results: Mapping[int, TrackResult]) -> None:
        """Log one frame and its results; the first one opens the file."""
        if self._budget.data_end is not None or self._failure is not None:
            return
        try:
            self._record(frame, results)
        except RuntimeError as error:  # of rerun's writer, in Rust: tracking goes on, `close` tells
            self._failure = error

    def on_end(self) -> None:
        """Send what is left, and close the file after the last session."""
        if self._log is not None:
            self._log.end()
            self._sent_before += self._log.sent
            self._log = None
        self._sessions_left -= 1
        if self._sessions_left <= 0:
            self.close()

    def close(self) -> None:
        """Complete the file; on_end does it after the last session."""
        if self._recording is None or self._images is None:
            return
        recording, images = self._recording, self._images
        self._recording, self._images, self._is_complete = None, None, True
        with self._lock:
            try:
                images.close()
            finally:
                self._complete(recording)

    def _record(self, frame: Frame | UnreadableFrame, results: Mapping[int, TrackResult]) -> None:
        if self._log is None:
            self._log = self._begin(frame, results)
            if self._budget.images_end is not None:
                self._log.drop_images()
        self._log.frame(frame, results, self._clock)
        self._frames += 1
        if math.isfinite(self._budget.most_bytes):
            self._spend(self._log)

    def _complete(self, recording: Any) -> None:
        try:
            if self._failure is None:
                recording.flush(timeout_sec=LAST_FLUSH_S)
        except RuntimeError as error:
            self._failure = error
        # Else it complains when Python ends. A writer that died may make it wait for ever.
        closing = threading.Thread(target=_disconnect, args=(recording,), name="replay closing", daemon=True)
        closing.start()
        closing.join(None if self._failure is None else FLUSH_S)
        if self._failure is not None:
            raise InputFileError(
                f"{self.path}: the replay could not be written to its end ({self._failure}): check the room on the "
                "disk; acp-lab replay shows what is there"
            ) from None

    def _spend(self, log: RunLog) -> None:
        """See what the file takes by now, and drop what it has no room for."""
        assert self._images is not None
        sent = self._sent_before + log.sent
        if sent != self._sent_in_file:  # or the first frame: then what is logged once arrives
            self._recording.flush(timeout_sec=FLUSH_S)
            self._sent_in_file = sent
        data_bytes = max(0, self.path.stat().st_size - self._images.sent_bytes)
        before = self._budget.told
        in_all = self._frames_in_all or (self._session.frame_count if self._sessions == 1 else 0)
        frames_left = in_all - self._frames if in_all else None
        self._budget.spend(self._frames, sent, data_bytes, self._images.expected_bytes, frames_left)
        if self._budget.told != before:
            log.drop_images()
            log.note(f"The replay {self._budget.told}.")
            self._recording.send_recording_name(f"{self._session.name} ({self._session.method}): {self._budget.told}")

    def _begin(self, frame: Frame | UnreadableFrame, results: Mapping[int, TrackResult]) -> RunLog:
        import rerun as rr

        is_first = self._recording is None
        if is_first:
            self._open()
            self._spot = spot_of(self._session.objects, results)
            layout = single_run([object_name(tracked.object_id) for tracked in self._session.objects], self._spot)
            self._recording.send_blueprint(layout, make_active=True, make_default=True)
        self._clock.new_scene()
        start = self._clock.begin(frame)
        start.set_on(self._recording)
        if not is_first:
            self._recording.log("/", rr.Clear(recursive=True))
        self._describe()
        assert self._images is not None
        colours = tuple(BRIGHT_COLOURS[n % len(BRIGHT_COLOURS)] for n in map(self._objects.index, self._ids()))
        log = RunLog(self._recording, self._images, self._session, self.iterations, colours=colours)
        log.begin(start)
        return log

    def _describe(self) -> None:
        """Tell the file what it holds, as far as is known; said anew for each scene."""
        import rerun as rr

        self._scenes.append((self._session.name, self._session.frame_count))
        # Those that a later scene adds come last: an object keeps its colour through all scenes.
        self._objects += [object_id for object_id in self._ids() if object_id not in self._objects]
        described = rr.AnyValues(
            scenes=[name for name, _ in self._scenes],
            frames=[count for _, count in self._scenes],
            objects=[object_name(object_id) for object_id in self._objects],
            centre=self._spot.centre,
            reach=[self._spot.reach],
        )
        self._recording.send_property(RUN_PROPERTY, described)
        self._recording.flush(timeout_sec=FLUSH_S)  # before any frame: else a killed run's file says nothing

    def _ids(self) -> list[int]:
        return sorted(tracked.object_id for tracked in self._session.objects)

    def _open(self) -> None:
        import rerun as rr

        with ExitStack() as on_failure:
            on_failure.enter_context(only_writer(self.path, "the replay"))
            try:
                self.path.open("wb").close()
            except OSError as error:
                raise InputFileError(
                    f"{self.path}: the replay cannot be written ({error.strerror}): choose another place"
                ) from None
            self._lock = on_failure.pop_all()
        session = self._session
        self._recording = rr.RecordingStream(APPLICATION, recording_id=f"{session.name}:{session.method}")
        self._recording.save(self.path)
        # The wall clock of logging says nothing about the run.
        self._recording.set_log_time_enabled(False)
        self._recording.set_log_tick_enabled(False)
        self._recording.send_recording_name(f"{session.name} ({session.method})")
        self._images = ImageWriter(self._recording)
