"""How much time goes by from frame to frame, and what filters and a tracker make of frames that are left out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from acp_lab.cad.part import Part
from acp_lab.geometry.arrays import ByteImage, FloatArray
from acp_lab.geometry.pose_step import move_pose, pose_step_between
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.tracking.kalman import KalmanPrediction, PoseKalman
from acp_lab.tracking.prediction import ConstantVelocity
from acp_lab.tracking.result import TrackState
from acp_lab.tracking.time_step import FrameTimes, TimeStep
from acp_lab.tracking.tracker import Tracker
from tests.made_parts import box, looking_at
from tests.tracking.rendered import AS_DRAWN, CAMERA, MadeSequence, add_percent, draw

BLACK: ByteImage = np.zeros((CAMERA.height, CAMERA.width, 3), np.uint8)
PART = box(shift=(500.0, -200.0, 100.0))
CENTRE = PART.box_centre
START = looking_at(PART, np.array([1.0, 0.5, 0.2]), 250.0, 0.4)
STEP = np.array([0.01, -0.005, 0.02, 0.6, -0.4, 1.0])
SURE = np.diag(np.repeat([1e-5, 1e-3], 3) ** -2.0)
USUAL, TWICE, HALF = TimeStep(), TimeStep(2.0, 2.0), TimeStep(0.5, 1.0)


def steps(*numbers: int, interval_s: float | None = None) -> list[TimeStep]:
    """To each frame after the first, by their numbers or, with an interval, by their times."""
    times, found = FrameTimes(), list[TimeStep]()
    for count, number in enumerate(numbers):
        time_s = None if interval_s is None else interval_s * number
        frame = Frame(number if interval_s is None else 3 * count, BLACK, CAMERA, time_s)
        if count == 0:
            times.begin(frame)
        else:
            found.append(times.step_to(frame))
    return found


@pytest.mark.parametrize("interval_s", [None, 1.0 / 30.0, 0.5])
def test_a_frame_left_out_is_two_steps(interval_s: float | None) -> None:
    found = steps(0, 1, 2, 4, 5, 8, 11, 12, interval_s=interval_s)
    expected = [USUAL, USUAL, TWICE, HALF, TimeStep(3.0, 3.0), TimeStep(1.0, 3.0), TimeStep(1 / 3, 1.0)]
    np.testing.assert_allclose(found, expected, rtol=1e-9)


@pytest.mark.parametrize("numbers", [range(20), range(0, 60, 3), range(20, 0, -1), [0] * 20])
def test_frames_at_equal_times_are_a_usual_step_apart(numbers: range) -> None:
    assert set(steps(*numbers)) == {USUAL}


def test_another_rate_becomes_the_usual_one() -> None:
    found = steps(*range(12), *range(12, 40, 2))
    assert found[12:14] == [TWICE, TimeStep(1.0, 2.0)]
    assert found[-1] == USUAL


@given(st.lists(st.floats(-0.04, 0.04), min_size=3, max_size=30))
def test_a_computer_that_is_a_little_late_changes_nothing(late: list[float]) -> None:
    times = FrameTimes()
    times.begin(Frame(0, BLACK, CAMERA, 0.0))
    assert {times.step_to(Frame(k, BLACK, CAMERA, k + off)) for k, off in enumerate(late, 1)} == {USUAL}


def test_images_that_waited_for_their_reader_were_not_taken_at_once() -> None:
    np.testing.assert_allclose(steps(0, 100, 200, 201, 301), [USUAL, USUAL, (0.5, 0.5), (2.0, 1.0)])


def test_an_unreadable_image_is_a_step_like_others() -> None:
    gone = UnreadableFrame(0, CAMERA, "damaged")
    times = FrameTimes()
    times.begin(Frame(0, BLACK, CAMERA, 0.0))
    found = [times.step_to(Frame(0, BLACK, CAMERA, 0.04)), times.step_to(gone), times.step_to(gone)]
    found.append(times.step_to(Frame(0, BLACK, CAMERA, 0.16)))  # three steps after the last that was read
    assert found == [USUAL] * 4
    assert times.step_to(Frame(0, BLACK, CAMERA, 0.24)) == pytest.approx(TWICE)


def test_images_that_fail_at_once_take_no_time() -> None:
    """What was assumed of them is later than the next image that is read: the motion does not go on for them twice."""
    times, gone = FrameTimes(), UnreadableFrame(0, CAMERA, "damaged")
    times.begin(Frame(0, BLACK, CAMERA, 0.0))
    assert [times.step_to(Frame(0, BLACK, CAMERA, float(time_s))) for time_s in (1, 2)] == [USUAL] * 2
    assert [times.step_to(gone) for _ in range(6)] == [USUAL] * 6
    assert [times.step_to(Frame(0, BLACK, CAMERA, float(time_s))) for time_s in (3, 4)] == [USUAL] * 2


@pytest.mark.parametrize("unknown", [None, float("nan"), float("inf"), 5.0])
def test_after_a_gap_a_frame_without_a_time_of_its_own_is_a_usual_step_away(unknown: float | None) -> None:
    times = FrameTimes()
    times.begin(Frame(0, BLACK, CAMERA, 0.0))
    found = [times.step_to(Frame(0, BLACK, CAMERA, time_s)) for time_s in (1.0, 2.0, 5.0, unknown)]
    assert found == [USUAL, USUAL, TimeStep(3.0, 3.0), TimeStep(1.0 / 3.0, 1.0)]


@given(st.lists(st.floats(0.002, 0.3), min_size=2, max_size=60))
def test_steps_follow_from_one_another_whatever_the_times(intervals_s: list[float]) -> None:
    """A motion that nobody sees neither grows nor fades by being told of times again and again."""
    times, times_s = FrameTimes(), np.cumsum([0.0, *intervals_s])
    times.begin(Frame(0, BLACK, CAMERA, 0.0))
    found = [times.step_to(Frame(0, BLACK, CAMERA, float(time_s))) for time_s in times_s[1:]]
    assert np.isfinite(found).all()
    if not any(step.is_long for step in found):
        told = np.prod([step.of_last for step in found])
        # Those much shorter than usual count as half of that, those about usual as usual.
        assert told < 1.5 * max(intervals_s) / min(intervals_s)
        assert told > min(intervals_s) / max(intervals_s) / 1.5


@pytest.mark.parametrize("unknown", [None, float("nan"), 3.0])
def test_a_frame_without_a_time_is_counted_once(unknown: float | None) -> None:
    times = FrameTimes()
    times.begin(Frame(0, BLACK, CAMERA, 0.0))
    assert {times.step_to(Frame(0, BLACK, CAMERA, time_s)) for time_s in (1.0, 2.0, 3.0, unknown, 5.0)} == {USUAL}


def test_after_a_long_pause_a_step_is_a_usual_one_again() -> None:
    found = steps(0, 1, 2, 3, 1003, 1004)
    assert found[3].is_long
    assert found[4] == USUAL


def test_frames_of_a_timed_track_without_a_time_tell_nothing() -> None:
    times = FrameTimes()
    times.begin(Frame(0, BLACK, CAMERA, 0.0))
    assert times.step_to(Frame(7, BLACK, CAMERA)) == USUAL
    times.begin(Frame(0, BLACK, CAMERA))
    assert [times.step_to(Frame(k, BLACK, CAMERA, 100.0 * k**2)) for k in range(1, 5)] == [USUAL] * 4


def moving(predictor: PoseKalman | ConstantVelocity, numbers: list[int]) -> FloatArray:
    """A part that moves by `STEP` a number, followed over frames of these numbers; the last of its poses."""
    predictor.restart(START)
    at, times = 0, FrameTimes()
    times.begin(Frame(0, BLACK, CAMERA))
    for number in numbers:
        predictor.elapse(times.step_to(Frame(number, BLACK, CAMERA)))
        predictor.observe(move_pose(START, CENTRE, number * STEP), 1.0, SURE)
        at = number
    return move_pose(START, CENTRE, at * STEP)


@pytest.mark.parametrize("numbers", [[1, 2, 3, 4], [1, 2, 4, 5], [1, 2, 3, 6], [1, 2, 5, 6, 7, 9]])
@pytest.mark.parametrize("ahead", [1, 2, 4])
def test_the_part_is_expected_as_far_as_it_goes_in_the_time(numbers: list[int], ahead: int) -> None:
    straight = STEP * [0, 0, 0, 1, 1, 1]
    for predictor in (PoseKalman(CENTRE, KalmanPrediction()), ConstantVelocity(CENTRE)):
        last = moving(predictor, numbers)
        before = numbers[-1] - numbers[-2]
        predictor.elapse(TimeStep(ahead / before, float(ahead)))
        off = pose_step_between(move_pose(last, CENTRE, ahead * STEP), predictor.predict(), CENTRE)
        assert np.linalg.norm(off[3:]) < 0.05 * ahead * np.linalg.norm(straight)
        assert np.linalg.norm(off[:3]) < 0.05 * ahead * np.linalg.norm(STEP[:3])
        # What smears its edges: as far as it goes while the shutter is open, however long it was closed before.
        np.testing.assert_allclose(predictor.motion, STEP, rtol=0.05)
        # It has coasted over what was left out.
        coasted = move_pose(last, CENTRE, (ahead - 1) * STEP)
        np.testing.assert_allclose(pose_step_between(coasted, predictor.last, CENTRE), 0.0, atol=0.2 * ahead)


def test_over_a_gap_it_is_less_sure_about_as_much_as_over_frames_without_an_image() -> None:
    """The variance of a turn and of a shift, each."""
    gap, coasting, usual = (PoseKalman(CENTRE, KalmanPrediction()) for _ in range(3))
    for predictor in (gap, coasting, usual):
        moving(predictor, [1, 2, 3, 4])
    gap.elapse(TimeStep(3.0, 3.0))
    coasting.coast()
    coasting.coast()
    spreads = [np.diag(np.linalg.inv(one.information())) for one in (gap, coasting, usual)]
    assert (spreads[0] > 8.0 * spreads[2]).all()
    np.testing.assert_allclose(spreads[0], spreads[1], rtol=0.5)


def test_a_step_that_is_usual_changes_nothing_and_after_a_long_time_the_part_rests() -> None:
    for predictor in (PoseKalman(CENTRE, KalmanPrediction()), ConstantVelocity(CENTRE)):
        last = moving(predictor, [1, 2, 3])
        expected, sure = predictor.predict(), predictor.information()
        predictor.elapse(USUAL)
        np.testing.assert_array_equal(predictor.predict(), expected)
        if sure is not None:
            np.testing.assert_array_equal(predictor.information(), sure)
        predictor.elapse(TimeStep(1000.0, 1000.0))
        np.testing.assert_allclose(predictor.predict(), last)
        assert not predictor.moves


def test_after_a_picture_that_came_again_a_gap_is_one_all_the_same() -> None:
    predictor = PoseKalman(CENTRE, KalmanPrediction())
    last = moving(predictor, [1, 2, 3, 4])
    predictor.repeat()
    predictor.observe(last, 1.0, SURE)
    predictor.elapse(TWICE)
    off = pose_step_between(move_pose(last, CENTRE, 2.0 * STEP), predictor.predict(), CENTRE)
    assert np.abs(off).max() < 0.05 * np.abs(STEP).max()


def test_a_part_that_goes_far_while_frames_are_left_out_is_where_it_was_foretold(
    part: Part, model: PreparedPart
) -> None:
    """Farther than any part can go in one step."""
    start, step = looking_at(part, np.array([0.8, 0.6, 1.0]), 330.0, 0.3), np.array([0, 0, np.radians(5.5), 0.2, 0, 0])
    tracker = Tracker(model, AS_DRAWN)
    for number in (0, 1, 2, 3, 4, 5, 14, 15):
        truth = move_pose(start, part.box_centre, number * step)
        frame = Frame(number, draw([(part, truth)], number), CAMERA)
        result = tracker.track(frame) if number else tracker.start(frame, truth)
        assert add_percent(part, result.cam_T_obj, truth) < 2.0
        assert result.state is TrackState.TRACKING


def test_the_prediction_of_a_tracker_leaps_over_frames_left_out(sequence: MadeSequence, model: PreparedPart) -> None:
    frames = [one for one in sequence.frames() if isinstance(one, Frame)]
    left = [0, 1, 2, 3, 4, 7]
    off_mm = dict[bool, float]()
    for is_told in (True, False):
        tracker, start = Tracker(model), sequence.truth(0, 1)
        assert start is not None
        tracker.start(frames[0], start)
        for number in left[1:]:
            result = tracker.track(frames[number] if is_told else replace(frames[number], index=left.index(number)))
        truth = sequence.truth(frames[left[-1]].index, 1)
        assert truth is not None
        off_mm[is_told] = float(np.linalg.norm(result.predicted[:3, 3] - truth[:3, 3]))
        assert add_percent(model.part, result.cam_T_obj, truth) < 2.0
    assert off_mm[True] < 0.5 * off_mm[False]
