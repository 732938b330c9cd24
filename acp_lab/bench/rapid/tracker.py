"""RAPID, OLS and GOS as trackers of the lab: frames go to the worker, poses come back.

Sources: C. Harris and C. Stennett, "RAPID" (BMVC 1990); B.-K. Seo et al., "Optimal local searching" (TVCG 2014);
G. Wang et al., "Global optimal searching for textureless 3D object tracking" (2015); all as OpenCV has them.
"""

from __future__ import annotations

import subprocess
import time
import weakref
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from acp_lab.bench.rapid.environment import clean_environment, python
from acp_lab.bench.rapid.plain_arrays import receive, send
from acp_lab.cad.part import Part, box_corners
from acp_lab.errors import AcpLabError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import make_pose, so3_exp, so3_log
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.tracking.result import Timings, TrackResult, TrackState

NAMES = ("RAPID", "OLS", "GOS")


class Worker:
    """A process of the other Python. It ends with this one: its input does."""

    def __init__(self) -> None:
        """PreparationError where the environment was not made yet."""
        script = Path(__file__).with_name("worker.py")
        self._process = subprocess.Popen(
            [str(python()), str(script)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
            env=clean_environment(),
        )  # fmt: skip
        weakref.finalize(self, self._process.kill)

    def ask(self, said: dict[str, Any], *arrays: np.ndarray) -> tuple[dict[str, Any], list[np.ndarray]]:
        """One message there and one back; AcpLabError where the process died: that is no result of the tracker's."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        try:
            send(self._process.stdin, said, *arrays)
            answer = receive(self._process.stdout)
        except (OSError, ValueError):  # gone, or cut off in the middle of a message
            answer = None
        if answer is None:
            shared_worker.cache_clear()
            raise AcpLabError("the process of cv2.rapid died: try again")
        return answer


@lru_cache(maxsize=1)
def shared_worker() -> Worker:
    """One per process of ours, started when it is first needed."""
    return Worker()


class RapidTracker:
    """One of `NAMES` on a part; a `PartTracker`. ms: CPU of the worker in the last frame."""

    records_steps = False
    records_target = False

    def __init__(self, part: Part, name: str) -> None:
        self.part = part
        self.name = name
        self.ms = 0.0
        self._corners_obj = box_corners(part)[:4]
        self._worker = shared_worker()

    @property
    def control_points_obj(self) -> tuple[FloatArray, ...]:
        """(4, 3) mm per view region 0..5: it has none; four corners of the box stand for them in replays."""
        return (self._corners_obj,) * 6

    def start(self, frame: Frame, cam_T_obj: FloatArray, found: bool = False) -> TrackResult:
        """Begin at a pose (4, 4), wherever that comes from."""
        self._worker.ask({"do": "start", "name": self.name}, self.part.vertices, self.part.faces)
        self._pose = cam_T_obj
        self._ask(frame)  # for the colours that it learns; the pose is the one that was given
        return self._result(frame, cam_T_obj, cam_T_obj, 1.0, 0.0)

    def track(self, frame: Frame | UnreadableFrame) -> TrackResult:
        """The pose in the next frame; an unreadable frame gets the last one, and quality 0."""
        before = self._pose
        if isinstance(frame, UnreadableFrame):
            return self._result(frame, before, before, 0.0, 0.0)
        begin_s = time.perf_counter()
        share, self._pose = self._ask(frame)
        return self._result(frame, before, self._pose, share, time.perf_counter() - begin_s)

    def _ask(self, frame: Frame) -> tuple[float, FloatArray]:
        """The share of its points that were found, and the pose (4, 4); from the last one."""
        image, last = cv2.cvtColor(frame.image, cv2.COLOR_RGB2BGR), self._pose
        turn, shift = so3_log(last[:3, :3]), last[:3, 3]
        said, (turn, shift) = self._worker.ask({"do": "track"}, image, frame.camera.matrix, turn, shift)
        self.ms = float(said["ms"])
        good = np.isfinite(turn).all() and np.isfinite(shift).all()
        pose = make_pose(so3_exp(np.array(turn, float)), np.array(shift, float)) if good else last
        return min(max(float(said["share"]), 0.0), 1.0), pose

    def _result(
        self, frame: Frame | UnreadableFrame, predicted: FloatArray, pose: FloatArray, quality: float, total_s: float
    ) -> TrackResult:
        nothing = np.full((4, 2), np.nan)
        return TrackResult(
            frame.index, pose, predicted, nothing, float("nan"), quality, TrackState.TRACKING, 0, None, None, 0,
            Timings(total_s=total_s),
        )  # fmt: skip
