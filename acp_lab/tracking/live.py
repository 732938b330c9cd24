"""Following a part while the camera runs: a loop in a thread of its own, which others tell what to do.

It watches until it is told where the part is, by a pose or by "look for it yourself", and follows it from then on.
Whoever shows the frames is handed in as a function; whoever presses buttons calls the methods.

Nobody is woken here, everybody looks again every now and then: an interrupt of a notebook's kernel inside
`threading.Condition`, which is Python, may leave its lock taken or somebody asleep for ever.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterator
from typing import Literal

from acp_lab.errors import AcpLabError, TrackingError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import check_pose
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.sequences.protocol import Sequence
from acp_lab.sequences.results_csv import ResultRow
from acp_lab.tracking.find import Finder
from acp_lab.tracking.method import Method
from acp_lab.tracking.result import TrackResult
from acp_lab.tracking.tracker import Tracker

OBJECT_ID = 1
LOOK_S = 0.01
"""Between two looks at what the hand wants."""
Doing = Literal["watching", "looking", "following", "waiting", "ended"]
Start = tuple[FloatArray, bool]
"""A pose (4, 4), and whether it was found in the image, see `Tracker.start`."""
Show = Callable[[Frame | UnreadableFrame, TrackResult | None], object]
Tell = Callable[[str], object]


class LiveLoop:
    """Reads a sequence to its end, or until `stop`; what it does meanwhile is up to the hand.

    doing: "watching" only shows; "looking" searches each frame for the part until it is found; "following" tracks;
    "waiting" stands still at a frame; "ended" once no more frames come. rows: what was tracked since the last start, as
    results.csv has it.
    """

    def __init__(
        self, model: PreparedPart, sequence: Sequence, show: Show, tell: Tell, method: Method | str = "acp"
    ) -> None:
        """show: called with every frame, and its result while following; tell: with words for the user."""
        self.model, self.sequence = model, sequence
        self._show, self._tell = show, tell
        self._tracker = Tracker(model, method)
        self._finder = Finder(model)
        self.doing: Doing = "watching"
        self._stands_at: Frame | None = None
        self.rows: list[ResultRow] = []
        self._start: Start | None = None
        self._is_over = False
        self._lock = threading.RLock()
        self._thread = threading.Thread(target=self._run, name="live", daemon=True)

    @property
    def end_in_words(self) -> str:
        """What there is to say once no more frames come."""
        return f"ended; {len(self.rows)} frames were tracked: run the cell again to begin anew"

    def begin(self) -> None:
        """Open the sequence and read it, in a thread; once only."""
        self._thread.start()

    def look(self) -> None:
        """Search for the part from the next frame on, and follow it once it is found."""
        self._do("looking")

    def hold(self, timeout_s: float = 10.0) -> Frame | None:
        """Stand still at the next frame, which is returned, until told to go on: somebody needs time to look at it.

        None, without standing still, when no frame comes in this time.
        """
        self._do("waiting")
        _wait_until(lambda: self._stands_at is not None or self.doing == "ended", timeout_s)
        with self._lock:
            frame = self._stands_at
            if frame is None:
                self._turn_from("waiting", "watching")
        return frame

    def follow(self, cam_T_obj: FloatArray, found: bool = False) -> None:
        """Follow the part from a pose (4, 4) on, in the frame at which the loop stands, else in the next one.

        found: whether it was found in that frame, see `Tracker.start`. GeometryError for what is no pose.
        """
        self._do("following", (check_pose(cam_T_obj, "the pose to follow from"), found))

    def watch(self) -> None:
        """Only show the frames."""
        self._do("watching")

    def stop(self, timeout_s: float = 10.0) -> None:
        """End after the frame at hand, and let the camera go."""
        self._is_over = True
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join(timeout_s)

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait until the sequence has ended; False when it still runs after that time.

        Raises TrackingError where it has not begun.
        """
        if self._thread.ident is None:
            raise TrackingError(f"{self.sequence.name}: there is nothing to wait for before begin()")
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _do(self, what: Doing, start: Start | None = None) -> None:
        with self._lock:
            if self.doing != "ended":
                self.doing, self._start = what, start

    def _turn_from(self, before: Doing, what: Doing, start: Start | None = None) -> bool:
        """Do something else, unless somebody said otherwise meanwhile: a button outranks what the loop found out."""
        with self._lock:
            is_asked = self.doing == before and self._start is None
            if is_asked:
                self._do(what, start)
        return is_asked

    def _run(self) -> None:
        try:
            for frame in self._paced():
                if self._is_over:
                    break
                self._show(frame, self._result(frame))
            else:
                self._tell(self.end_in_words)
        except AcpLabError as error:
            self._tell(str(error))
        except Exception as error:
            # Else whoever looks at the window reads what was told before, as if all were well.
            self._tell(f"ended by an error in the program: {error!r}")
            raise
        finally:
            with self._lock:
                self.doing = "ended"

    def _result(self, frame: Frame | UnreadableFrame) -> TrackResult | None:
        if isinstance(frame, Frame) and self.doing == "waiting":
            self._stand_at(frame)
        if isinstance(frame, Frame) and self.doing == "looking":
            self._look_in(frame)
        with self._lock:  # the start is taken with what it was meant for
            if self.doing != "following" or (self._start is not None and not isinstance(frame, Frame)):
                return None
            start, self._start = self._start, None
        try:
            result = self._track(frame, start)
        except AcpLabError as error:  # the pose that was given shows nothing here
            if self._turn_from("following", "watching"):
                self._tell(str(error))
            return None
        row = ResultRow(
            self.sequence.scene_id,
            result.frame_id,
            OBJECT_ID,
            result.quality,
            result.cam_T_obj,
            result.timings.total_s,
        )
        self.rows.append(row)
        return result

    def _stand_at(self, frame: Frame) -> None:
        self._show(frame, None)
        self._stands_at = frame
        _wait_until(self._goes_on)

    def _goes_on(self) -> bool:
        """Whether the loop need not stand still any longer; then it does not, for whoever asks from now on."""
        with self._lock:
            goes_on = self._is_over or self.doing != "waiting"
            if goes_on:
                self._stands_at = None
        return goes_on

    def _track(self, frame: Frame | UnreadableFrame, start: Start | None) -> TrackResult:
        if start is None or not isinstance(frame, Frame):
            return self._tracker.track(frame)
        pose, is_found = start
        result = self._tracker.start(frame, pose, found=is_found)
        self.rows = []  # what was tracked before is kept where the new start shows nothing
        return result

    def _look_in(self, frame: Frame) -> None:
        self._tell("looking for the part: keep it still …")
        found = self._finder.find(frame, 1)
        if found and found[0].is_accepted and self._turn_from("looking", "following", (found[0].cam_T_obj, True)):
            self._tell(f"found, score {found[0].score:.2f}")

    def _paced(self) -> Iterator[Frame | UnreadableFrame]:
        """The frames; those of a file not sooner than they were taken, as a camera would give them."""
        due_s = time.perf_counter()
        before_s = 0.0
        for frame in self.sequence.frames():
            time_s = frame.time_s if isinstance(frame, Frame) and self.sequence.frame_ids else None
            if time_s is not None:
                # After a pause the film goes on where it was, it does not catch up.
                due_s = max(due_s + time_s - before_s, time.perf_counter() - 0.1)
                before_s = time_s
                # Whoever stops it need not wait for a gap in the film.
                _wait_until(lambda: self._is_over, due_s - time.perf_counter())
            yield frame


def _wait_until(is_true: Callable[[], bool], timeout_s: float = math.inf) -> None:
    """Wait until something is true, or for so long."""
    end_s = time.perf_counter() + timeout_s
    while not is_true() and (left_s := end_s - time.perf_counter()) > 0.0:
        time.sleep(min(LOOK_S, left_s))
