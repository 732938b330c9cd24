"""When things happened: the three timelines of a replay.

`frame` counts the frames of the whole file, scene after scene, and `time` the seconds. `step` counts what
happens inside the frames: a frame's image is one step, each iteration is one, and the result shares the step of
the last iteration. All three only ever rise; a count that began anew in each frame would merge the frames.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from acp_lab.sequences.frame import Frame, UnreadableFrame

if TYPE_CHECKING:
    from rerun import RecordingStream

GUESSED_FPS = 30.0
"""For the timeline `time` of sequences that know no times; of others, until the step between two frames is known."""
LARGEST_S = 9.0e9
"""A timeline counts nanoseconds in 64 bits. Milliseconds since 1970, taken for seconds, are beyond that."""


@dataclass(frozen=True)
class Moment:
    """A point on the three timelines."""

    frame: int
    time_s: float
    step: int

    def set_on(self, recording: RecordingStream) -> None:
        """What the calling thread logs from now on happens at this moment."""
        recording.set_time("frame", sequence=self.frame)
        recording.set_time("time", duration=self.time_s)
        recording.set_time("step", sequence=self.step)


class RunningClock:
    """Counts on from frame to frame and from scene to scene."""

    def __init__(self) -> None:
        self._next = Moment(0, 0.0, 0)
        self.new_scene()

    def new_scene(self) -> None:
        """The times of the frames to come begin at zero again; those of the replay go on."""
        self._scene_start_s = self._last_s = self._next.time_s
        self._step_s = 1.0 / GUESSED_FPS
        self._is_known = self._was_known = False

    def begin(self, frame: Frame | UnreadableFrame) -> Moment:
        """When a frame begins; may be asked again until it ends."""
        known = frame.time_s if isinstance(frame, Frame) else None
        # No run ends for want of a time that a replay can show.
        self._is_known = known is not None and bool(-LARGEST_S < known < LARGEST_S)
        if known is not None and self._is_known:
            # Guesses for frames before it may have gone too far.
            time_s = max(self._scene_start_s + float(known), self._last_s)
            self._next = replace(self._next, time_s=min(time_s, LARGEST_S))
        return self._next

    def end(self, iterations: int) -> Moment:
        """When the frame ends, so many iterations later; the next one begins after that."""
        now = self._next
        if self._is_known and self._was_known and now.time_s > self._last_s:
            self._step_s = now.time_s - self._last_s
        self._last_s, self._was_known = now.time_s, self._is_known
        last = replace(now, step=now.step + iterations)
        self._next = Moment(now.frame + 1, min(now.time_s + self._step_s, LARGEST_S), last.step + 1)
        return last
