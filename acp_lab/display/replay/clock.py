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
"""For the timeline `time` of sequences that know no times."""


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
        self._scene_start_s = 0.0

    def new_scene(self) -> None:
        """The times of the frames to come begin at zero again; those of the replay go on."""
        self._scene_start_s = self._next.time_s

    def begin(self, frame: Frame | UnreadableFrame) -> Moment:
        """When a frame begins."""
        known = frame.time_s if isinstance(frame, Frame) else None
        if known is not None:
            self._next = replace(self._next, time_s=self._scene_start_s + known)
        return self._next

    def end(self, iterations: int) -> Moment:
        """When the frame ends, so many iterations later; the next one begins after that."""
        now = self._next
        last = replace(now, step=now.step + iterations)
        self._next = Moment(now.frame + 1, now.time_s + 1.0 / GUESSED_FPS, last.step + 1)
        return last
