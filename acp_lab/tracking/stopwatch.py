"""Wall time by stage of one frame."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

from acp_lab.tracking.result import Timings


@dataclass
class Stopwatch:
    """Wall seconds by stage, of one frame, from when it is made on."""

    image_s: float = 0.0
    generate_s: float = 0.0
    search_s: float = 0.0
    solve_s: float = 0.0
    learn_s: float = 0.0
    _begin: float = field(default_factory=time.perf_counter)

    def __post_init__(self) -> None:
        self._last = self._begin

    def lap(self) -> float:
        """Seconds since the last lap."""
        now = time.perf_counter()
        elapsed, self._last = now - self._last, now
        return elapsed

    def timings(self, undistort_s: float) -> Timings:
        """The stages of a frame that took so long up to its undistorted image, and is done now."""
        return Timings(
            undistort_s,
            self.image_s,
            self.generate_s,
            self.search_s,
            self.solve_s,
            self.learn_s,
            undistort_s + time.perf_counter() - self._begin,
        )
