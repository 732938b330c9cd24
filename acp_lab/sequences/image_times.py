"""When images were taken: by the names of their files, or by a camera's clock."""

from __future__ import annotations

import re
import time
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import cv2

_UNIX_TIME = re.compile(r"(1\d{9})\.?(\d{9}|\d{6}|\d{3})")
"""Seconds since 1970, of the years 2001 to 2033, and their fraction: ms, µs or ns, with a point or without.

Dates, such as 20240131123045123, begin with a 2.
"""


def times_of(paths: Sequence[Path]) -> tuple[float, ...] | None:
    """Of image files named by when they were taken, as recorders do: s from the first on; None for other names.

    Unix time, as in 1403636579763555584.png or 1305031102.175304.png; every name has one, and they rise.
    """
    found = [_UNIX_TIME.fullmatch(path.stem) for path in paths]
    names = [match.groups() for match in found if match is not None]
    if len(names) < len(found):
        return None
    # Whole nanoseconds: a float of so many seconds is good to a quarter of a microsecond only.
    taken_ns = [int(seconds) * 10**9 + int(fraction.ljust(9, "0")) for seconds, fraction in names]
    if any(after <= before for before, after in pairwise(taken_ns)):
        return None
    return tuple((one - taken_ns[0]) / 1e9 for one in taken_ns)


class CameraClock:
    """When the images of a live camera were taken, s from when this was made: by its driver's clock where it has one.

    Images that wait for their reader all arrive at once, but the driver stamped them when they came.
    """

    def __init__(self) -> None:
        self._start_s = time.perf_counter()
        self._stamp_s: float | None = None
        self._ahead_s: float | None = None

    def taken_s(self, device: cv2.VideoCapture) -> float:
        """Of the image just read; when it arrived, where the driver has no clock or that was just set."""
        arrived_s = time.perf_counter() - self._start_s
        before_s, stamp_s = self._stamp_s, device.get(cv2.CAP_PROP_POS_MSEC) / 1000.0
        self._stamp_s = stamp_s if stamp_s >= 0.0 else None
        if self._stamp_s is None or before_s is None or not before_s < self._stamp_s:
            self._ahead_s = None
            return arrived_s
        if self._ahead_s is None:
            self._ahead_s = self._stamp_s - arrived_s
        return self._stamp_s - self._ahead_s
