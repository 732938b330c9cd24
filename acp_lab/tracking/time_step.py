"""How much time goes by from frame to frame, where a sequence tells: frames left out, a camera that slows down.

A motion that was seen from frame to frame goes twice as far where a frame was left out, and is less sure there. The
times of frames tell (`Frame.time_s`), or their numbers, as ids have gaps where images are absent. (Not in the paper,
which predicts no motion; see docs/paper-ledger.md.)
"""

from __future__ import annotations

from collections import deque
from statistics import median_low
from typing import NamedTuple

from acp_lab.sequences.frame import Frame, UnreadableFrame

_INTERVALS = 9
"""The usual interval is the median of so many, of two middle ones the shorter: frames are left out, not put in."""
_SAME = 0.2
"""An interval this close to the usual one, as a share of it, is the usual one: computers are late by a little."""
_LEAST = 0.5
"""Share of the usual interval: images nearer together waited for their reader."""
_LONG = 10.0
"""Usual steps after which nobody knows whether a motion still goes on."""


class TimeStep(NamedTuple):
    """From the last frame to this one. of_last: as a share of the step before; of_usual: of the usual step."""

    of_last: float = 1.0
    of_usual: float = 1.0

    @property
    def is_long(self) -> bool:
        """Whether it is so long that no motion is foretold over it."""
        return self.of_usual > _LONG


class FrameTimes:
    """The intervals between the frames of one track: seconds where its first frame has a time, else ids."""

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Before a new track."""
        self._last: float | None = None
        self._is_timed = False
        self._intervals: deque[float] = deque(maxlen=_INTERVALS)

    def begin(self, frame: Frame) -> None:
        """A new track, with its first frame."""
        self.forget()
        self._is_timed = frame.time_s is not None
        self._last = self._time_of(frame)

    def step_to(self, frame: Frame | UnreadableFrame) -> TimeStep:
        """The step from the frame before to the next one; a usual one where nobody knows."""
        usual = median_low(self._intervals) if self._intervals else None
        last, now = self._last, self._time_of(frame)
        if now is None and last is not None and usual is not None:
            now = last + usual  # of an image that cannot be read no time is known
        self._last = last if now is None else now
        # Backwards is a motion, too; the same time twice is no time.
        interval = 0.0 if last is None or now is None else abs(now - last)
        if not interval > 0.0:
            return TimeStep()
        before = self._intervals[-1] if self._intervals else interval
        self._intervals.append(interval)
        step_before, step = (_steps(one, interval if usual is None else usual) for one in (before, interval))
        return TimeStep(step / step_before, step)

    def _time_of(self, frame: Frame | UnreadableFrame) -> float | None:
        if not self._is_timed:
            return float(frame.index)
        return frame.time_s if isinstance(frame, Frame) else None


def _steps(interval: float, usual: float) -> float:
    """How many usual steps an interval is."""
    steps = interval / usual
    return 1.0 if abs(steps - 1.0) < _SAME else max(steps, _LEAST)
