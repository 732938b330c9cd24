"""The sample's frames served as a camera: what cv2.VideoCapture(0) would give if the bracket lay in front of it."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np

from acp_lab.sequences.frame import Frame
from tests.prepared_sample import sample_scene


def there_and_back(count: int) -> Iterator[int]:
    """0, 1, ... count - 1, count - 2, ... 1, 0, 1, ...: a film that can go on for ever without a jump."""
    while True:
        yield from range(count)
        yield from range(count - 2, 0, -1)


class PluggedCamera:
    """Stands in for cv2.VideoCapture; the sample, there and back, at a frame rate (0: as fast as it is read)."""

    fps = 30.0
    shown: int = 0
    """The sample's frame that was given last."""

    def __init__(self, *_: Any) -> None:
        self.ids = there_and_back(len(sample_scene().frame_ids))
        self.begun_s, self.count = time.perf_counter(), 0

    def isOpened(self) -> bool:
        return True

    def set(self, key: int, value: float) -> bool:
        return True

    def get(self, key: int) -> float:
        return 0.0

    def read(self) -> tuple[bool, np.ndarray]:
        if self.fps:
            time.sleep(max(0.0, self.begun_s + self.count / self.fps - time.perf_counter()))
        self.count += 1
        type(self).shown = next(self.ids)
        frame = sample_scene().frame(self.shown)
        assert isinstance(frame, Frame)
        return True, cv2.cvtColor(frame.image, cv2.COLOR_RGB2BGR)

    def release(self) -> None:
        pass


def plug_in(fps: float = 30.0) -> None:
    """From now on every camera of this process is the sample; for kernels and fixtures of their own."""
    PluggedCamera.fps = fps
    cv2.VideoCapture = PluggedCamera  # type: ignore[misc, assignment]
