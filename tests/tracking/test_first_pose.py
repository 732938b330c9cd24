"""The first pose of a video: one frame that says enough, or two that follow each other and say the same."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.geometry.arrays import FloatArray
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.tracking.find import ACCEPTED, Detection, Finder
from acp_lab.tracking.first_pose import LIKELY, FirstPose
from tests.prepared_sample import sample_model, sample_scene

FRAME = sample_scene().frame(0)
START = sample_scene().first_pose


class Told(Finder):
    """Finds what it is told: score and place (mm) in each frame, None for nothing."""

    def __init__(self, finds: list[tuple[float, float] | None]) -> None:
        super().__init__(sample_model())
        self.finds = iter(finds)

    def find(self, *_: object) -> tuple[Detection, ...]:
        told = next(self.finds)
        return () if told is None else (Detection(pose_at(told[1]), told[0], np.array([0.0, 0.0, 1.0])),)


def pose_at(x_mm: float) -> FloatArray:
    pose = START.copy()
    pose[0, 3] += x_mm
    return pose


def first(finds: list[tuple[float, float] | None]) -> tuple[int, float] | None:
    """Number of the frame in which a pose is accepted, and its place."""
    search = FirstPose(Told(finds))
    assert isinstance(FRAME, Frame)
    for number in range(len(finds)):
        pose = search.look(FRAME)
        if pose is not None:
            return number, round(float(pose[0, 3] - START[0, 3]), 6)
    return None


def test_one_frame_that_says_enough() -> None:
    assert first([(0.2, 0.0), (ACCEPTED, 5.0)]) == (1, 5.0)


def test_two_frames_that_say_the_same() -> None:
    """The pose of the second: that is the frame in which tracking begins."""
    assert first([(LIKELY, 0.0), (LIKELY, 3.0)]) == (1, 3.0)


@pytest.mark.parametrize(
    "finds",
    [
        [(LIKELY, 0.0), (LIKELY - 0.01, 0.0), (LIKELY, 0.0)],
        [(LIKELY, 0.0), (LIKELY, 60.0), (LIKELY, 0.0)],  # elsewhere
        [(LIKELY, 0.0), None, (LIKELY, 0.0)],
        [None, None],
    ],
)
def test_one_likely_frame_is_not_enough(finds: list[tuple[float, float] | None]) -> None:
    assert first(finds) is None


def test_frames_on_both_sides_of_an_unreadable_one_do_not_follow_each_other() -> None:
    search = FirstPose(Told([(LIKELY, 0.0), (LIKELY, 0.0), (LIKELY, 0.0)]))
    assert isinstance(FRAME, Frame)
    assert search.look(FRAME) is None
    assert search.look(UnreadableFrame(1, None, "it is cut off")) is None
    assert search.look(FRAME) is None
    assert search.look(FRAME) is not None
