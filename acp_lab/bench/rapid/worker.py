"""The other side of the pipe: run as a script by the Python that has cv2.rapid. It ends when its input does.

- {"do": "start", "name": "GOS"} + vertices (n, 3) mm, triangles (m, 3), answered by {}
- {"do": "track"} + image (h, w, 3) BGR, camera matrix (3, 3), rotation vector (3,), translation (3,) mm, answered by
  {"share": of the control points that were found, "ms": CPU} + rotation vector, translation
"""

from __future__ import annotations

import sys
import time
from typing import Any

import cv2
import numpy as np
from plain_arrays import receive, send

# Points on the outline, and px searched on both sides of it.
_POINTS, _REACH_PX = 100, 10
_STOP = (cv2.TERM_CRITERIA_MAX_ITER + cv2.TERM_CRITERIA_EPS, 10, 0.5)


def made(name: str, vertices: np.ndarray, triangles: np.ndarray) -> Any:
    """A tracker of cv2.rapid: "RAPID", "OLS" or "GOS"."""
    rapid: Any = cv2.rapid  # type: ignore[attr-defined]
    makers = {"RAPID": rapid.Rapid_create, "OLS": rapid.OLSTracker_create, "GOS": rapid.GOSTracker_create}
    return makers[name](vertices.astype(np.float32), triangles.astype(np.int32))


def main() -> None:
    """Answer until the input ends."""
    cv2.setNumThreads(1)
    tracker: Any = None
    while (message := receive(sys.stdin.buffer)) is not None:
        said, arrays = message
        if said["do"] == "start":
            tracker = made(said["name"], *arrays)
            send(sys.stdout.buffer, {})
            continue
        image, matrix, turn, shift = arrays
        begin_s = time.process_time()
        try:
            share, turn, shift = tracker.compute(
                image, _POINTS, _REACH_PX, matrix, turn.reshape(3, 1).copy(), shift.reshape(3, 1).copy(), _STOP
            )
        except cv2.error:  # too few points are left to solve for a pose: it stays where it was
            share = 0.0
        ms = 1e3 * (time.process_time() - begin_s)
        send(sys.stdout.buffer, {"share": float(share), "ms": ms}, np.ravel(turn), np.ravel(shift))


if __name__ == "__main__":
    main()
