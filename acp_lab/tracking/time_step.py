"""How much time goes by from frame to frame, where a sequence tells: frames left out, a camera that slows down.

A motion that was seen from frame to frame goes twice as far where a frame was left out, and is less sure there. The
times of frames tell (`Frame.time_s`), or their numbers, as ids have gaps where images are absent. (Not in the paper,
which predicts no motion; see docs/paper-ledger.md.)
"""

from __future__ import annotations

import math
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
        """No frame is known."""
        self._last: float | None = None
        self._is_timed = self._is_assumed = False
        # The last step, 0 before there was one, and as a share of what was usual then.
        self._before, self._of_usual = 0.0, 1.0
        self._intervals: deque[float] = deque(maxlen=_INTERVALS)

    def begin(self, frame: Frame) -> None:
        """A new track, with its first frame."""
        self.forget()
        self._is_timed = _is_known(frame.time_s)
        self._last = self._time_of(frame)

    def step_to(self, frame: Frame | UnreadableFrame) -> TimeStep:
        """The step from the frame before to the next one; a usual one where nobody knows."""
        usual = median_low(self._intervals) if self._intervals else None
        interval = self._interval_to(frame, usual)
        if interval is None:
            return TimeStep()
        self._intervals.append(interval)
        usual = interval if usual is None else usual
        of_usual = interval / usual
        of_usual = 1.0 if abs(of_usual - 1.0) < _SAME else max(of_usual, _LEAST)
        step, before, of_usual_before = of_usual * usual, self._before, self._of_usual
        is_as_before = before == 0.0 or of_usual == of_usual_before == 1.0
        found = TimeStep(1.0 if is_as_before else step / before, of_usual)
        # How far the part went in a long time says nothing of the next step.
        self._before, self._of_usual = (usual, 1.0) if found.is_long else (step, of_usual)
        return found

    def _interval_to(self, frame: Frame | UnreadableFrame, usual: float | None) -> float | None:
        """Since the frame before; the usual one where the frame has no time of its own, None if that is not known."""
        last, now = self._last, self._time_of(frame)
        if last is None or now is None or now == last:
            if last is not None and usual is not None:
                self._last, self._is_assumed = last + usual, True
            return usual
        # Images that cannot be read may take no time at all, so that what was assumed is later than what is.
        is_told = not (self._is_assumed and now < last)
        self._last, self._is_assumed = now, False
        return abs(now - last) if is_told else usual  # backwards is a motion, too

    def _time_of(self, frame: Frame | UnreadableFrame) -> float | None:
        if not self._is_timed:
            return float(frame.index)
        return frame.time_s if isinstance(frame, Frame) and _is_known(frame.time_s) else None


def _is_known(time_s: float | None) -> bool:
    return time_s is not None and math.isfinite(time_s)
