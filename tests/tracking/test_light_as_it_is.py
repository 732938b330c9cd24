"""Parts that move fast before cameras that store light as it is, and before such as encode it for displays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose_step import move_pose
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.tracking.learning.encoding import EncodingConfig
from acp_lab.tracking.learning.knowledge import Off, SampleLearning
from acp_lab.tracking.method import Method
from acp_lab.tracking.targets.normals import NormalSearch, NormalTarget
from acp_lab.tracking.tracker import Tracker
from tests.made_parts import bracket, looking_at
from tests.tracking.rendered import AS_DRAWN, CAMERA, add_percent, draw, prepared

PART = bracket()
MODEL = prepared(PART)
START = looking_at(PART, np.array([1.0, 0.5, 0.4]), 260.0, 0.4)
COUNT, MOMENTS, OPEN = 28, 9, 0.6
SWING_MM, SWING_FRAMES = np.array([9.0, 16.0, 5.0]), np.array([17.0, 13.0, 19.0])
DISPLAY = 2.2
assert isinstance(AS_DRAWN.learning, SampleLearning)
# Drawn pictures are soft.
ASKED = replace(AS_DRAWN, learning=replace(AS_DRAWN.learning, encoding=EncodingConfig(times_lens=2.0)))


def at_time(time: float) -> FloatArray:
    """(4, 4) the pose at a time in frames."""
    spin = time * np.array([0.012, -0.015, 0.01])
    shift = SWING_MM * np.sin(2.0 * np.pi * time / SWING_FRAMES)
    return move_pose(START, PART.box_centre, np.concatenate([spin, shift]))


def exposed(number: int) -> FloatArray:
    """(h, w, 3) light, 0 to 1, of a frame whose shutter is open for a while about its time."""
    moments = number + OPEN * (np.arange(MOMENTS) / (MOMENTS - 1) - 0.5)
    drawn = [draw([(PART, at_time(moment))], number, CAMERA) for moment in moments]
    return np.mean([(image / 255.0) ** DISPLAY for image in drawn], axis=0)


@pytest.fixture(scope="module")
def light() -> list[FloatArray]:
    return [exposed(number) for number in range(COUNT)]


def stored(light: list[FloatArray], exponent: float) -> list[Frame]:
    greys = [(255.0 * each ** (1.0 / exponent)).round().astype(np.uint8) for each in light]
    return [Frame(number, grey, CAMERA) for number, grey in enumerate(greys)]


def follow(frames: Sequence[Frame | UnreadableFrame], method: Method) -> tuple[Tracker, list[float]]:
    """The tracker, and ADD in percent of the diameter, of all frames but the first."""
    tracker = Tracker(MODEL, method)
    assert isinstance(frames[0], Frame)
    tracker.start(frames[0], at_time(0.0))
    results = [tracker.track(frame) for frame in frames[1:]]
    return tracker, [add_percent(PART, result.cam_T_obj, at_time(result.frame_id)) for result in results]


def unasked(method: Method = ASKED) -> Method:
    assert isinstance(method.learning, SampleLearning)
    return replace(method, learning=replace(method.learning, encoding=Off()))


def test_light_that_is_stored_as_it_is_is_learnt(light: list[FloatArray]) -> None:
    frames = stored(light, 1.0)
    tracker, errors = follow(frames, ASKED)
    assert tracker.gamma == 1.0
    assert np.mean(errors[10:]) < 0.8 * np.mean(follow(frames, unasked())[1][10:])
    seen = tracker.look(frames[-1], tracker.predicted)
    assert seen is not None
    target = seen.targets[0]
    assert isinstance(target, NormalTarget)
    assert target.patch.gamma == tracker.gamma


def test_light_that_is_encoded_for_displays_is_what_it_was(light: list[FloatArray]) -> None:
    frames = stored(light, DISPLAY)
    tracker, errors = follow(frames, ASKED)
    assert tracker.gamma is None
    assert errors == follow(frames, unasked())[1]


def test_a_new_track_begins_without_it(light: list[FloatArray]) -> None:
    frames = stored(light, 1.0)
    tracker, _ = follow(frames, ASKED)
    assert tracker.gamma is not None
    tracker.start(frames[0], at_time(0.0))
    assert tracker.gamma is None


@pytest.mark.parametrize("missing", [[2], [3, 4], [1]])
def test_the_first_frame_is_measured_again_across_gaps(light: list[FloatArray], missing: list[int]) -> None:
    frames = stored(light, 1.0)
    given = [UnreadableFrame(f.index, CAMERA, "damaged") if f.index in missing else f for f in frames]
    tracker, errors = follow(given, ASKED)
    assert tracker.gamma == 1.0
    assert np.mean(errors[10:]) < 0.8 * np.mean(follow(given, unasked())[1][10:])


def test_a_tracker_that_was_told_does_not_learn_it(light: list[FloatArray]) -> None:
    target = ASKED.targets[0]
    assert isinstance(target, NormalSearch)
    told = replace(ASKED, targets=(replace(target, search=replace(target.search, gamma=1.0)), *ASKED.targets[1:]))
    frames = stored(light, 1.0)
    tracker, errors = follow(frames, told)
    assert tracker.gamma is None
    assert errors == follow(frames, unasked(told))[1]
