"""A camera that shakes: its jerks are foretold, as long as they explain how the part is seen to move."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from acp_lab.cad.part import Part
from acp_lab.cad.raycast import hit_map, make_caster
from acp_lab.errors import TrackingError
from acp_lab.geometry.arrays import ByteImage, FloatArray
from acp_lab.geometry.pose_step import move_pose, pose_step_between
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.tracking.camera_motion import CameraFollower, CameraMotion
from acp_lab.tracking.kalman import KalmanPrediction, PoseKalman
from acp_lab.tracking.learning.knowledge import Off
from acp_lab.tracking.method import ACP_EDGES
from acp_lab.tracking.tracker import Tracker
from tests.made_parts import bracket, looking_at
from tests.tracking.rendered import AS_DRAWN, CAMERA, add_percent, draw, poses, prepared
from tests.tracking.test_background import ground, rotation, turned

PART = bracket()
START = looking_at(PART, np.array([1.0, 0.5, 0.4]), 260.0, 0.4)
GROUND = ground(CAMERA)
COUNT = 14
# A spin, and little else: where the camera goes to and fro, the part soon leaves so small a picture.
STEP = np.array([0.01, -0.015, 0.01, 0.3, -0.2, 0.3])


def jerks(count: int = COUNT, size_px: float = 6.0) -> FloatArray:
    """(count, 3) where a shaking camera has turned to, none in the first frame."""
    at = np.random.default_rng(5).uniform(-size_px, size_px, (count, 3)) / CAMERA.fx
    at[0] = 0.0
    return at


def posed(turn: FloatArray, pose: FloatArray) -> FloatArray:
    """A pose (4, 4) as a camera sees it that has turned."""
    found = np.eye(4)
    found[:3, :3] = rotation(turn)
    return np.asarray(found @ pose)


def picture(part: Part, pose: FloatArray, number: int) -> ByteImage:
    """The part before a ground with corners."""
    _, face = hit_map(part, make_caster(part), CAMERA, pose)
    return np.where((face < 0)[..., None], GROUND, draw([(part, pose)], number))


def shaken(size_px: float = 6.0) -> list[tuple[Frame, FloatArray]]:
    """Frames before a camera that shakes, and their true poses."""
    found = []
    for number, (turn, pose) in enumerate(zip(jerks(size_px=size_px), poses(PART, START, COUNT, STEP), strict=True)):
        image = turned(picture(PART, pose, number), turn, CAMERA)
        found.append((Frame(number, image, CAMERA), posed(turn, pose)))
    return found


def follower(frames: list[tuple[Frame, FloatArray]], found: list[FloatArray]) -> list[FloatArray | None]:
    """What is expected of each frame but the first, where these poses are found."""
    following = CameraFollower(PART, CameraMotion())
    following.begin(frames[0][0], found[0])
    steps = []
    for (frame, _), pose in zip(frames[1:], found[1:], strict=True):
        steps.append(following.acceleration(frame, pose))
        following.found(pose, CAMERA)
    return steps


def test_jerks_are_known_before_the_part_is_looked_for() -> None:
    frames = shaken()
    truths = [pose for _, pose in frames]
    steps = follower(frames, truths)
    # How the camera turned before the first nobody knows, and one jerk has to be seen in the part.
    assert steps[:2] == [None, None]
    jerks_mm = []
    for number in range(1, COUNT - 1):
        before, now = (pose_step_between(truths[k], truths[k + 1], PART.box_centre) for k in (number - 1, number))
        # The part's own motion is even.
        jerk, step = now - before, steps[number]
        is_small = CAMERA.fx * np.hypot(*jerk[3:5]) / 260.0 < 3.5
        assert step is not None or is_small or number == 1
        if step is not None:
            np.testing.assert_allclose(step, jerk, atol=2.0 * 260.0 / CAMERA.fx)
        jerks_mm.append(np.abs(jerk[3:5]).max())
    assert np.mean(jerks_mm) > 4.0


def test_a_part_that_the_camera_carries_is_not_expected_to_move() -> None:
    frames = shaken()
    steps = follower(frames, poses(PART, START, COUNT, STEP))
    assert all(step is None for step in steps)


def test_a_camera_on_a_stand_foretells_nothing() -> None:
    assert follower(shaken(0.0), poses(PART, START, COUNT, STEP)) == [None] * (COUNT - 1)


def test_frames_without_an_image_or_a_pose_are_no_evidence() -> None:
    frames = shaken()
    following = CameraFollower(PART, CameraMotion())
    following.begin(*frames[0])
    for frame, pose in frames[1:4]:
        following.acceleration(frame, pose)
        following.found(pose, CAMERA)
    following.acceleration(frames[4][0], frames[4][1])  # nothing is found there
    assert following.acceleration(frames[5][0], frames[5][1]) is not None
    following.found(frames[5][1], CAMERA)
    following.miss()
    assert following.acceleration(frames[7][0], frames[7][1]) is None
    following.found(frames[7][1], CAMERA)
    assert following.acceleration(frames[8][0], frames[8][1]) is not None


def test_twice_the_time_is_twice_the_turn() -> None:
    """A camera that turns evenly has no jerk where a frame was left out."""
    per_frame, following = np.array([0.0, 4.0, 0.0]) / CAMERA.fx, CameraFollower(PART, CameraMotion())
    for place, number in enumerate((0, 1, 2, 4)):
        frame = Frame(number, turned(GROUND, number * per_frame, CAMERA), CAMERA)
        if place == 0:
            following.begin(frame, START)
        else:
            step = following.acceleration(frame, START, 2.0 if number == 4 else 1.0)
            following.found(posed(number * per_frame, START), CAMERA)
    assert step is None or np.abs(step[3:]).max() < 1.5 * 260.0 / CAMERA.fx


def test_the_filter_goes_on_with_the_jerk() -> None:
    kalman, step = PoseKalman(PART.box_centre, KalmanPrediction()), np.array([0.01, 0.0, 0.02, 3.0, -2.0, 1.0])
    kalman.restart(START)
    for number in range(1, 5):
        kalman.observe(move_pose(START, PART.box_centre, number * STEP))
    pose, motion, sure = kalman.predict(), kalman.motion, kalman.information()
    assert motion is not None
    kalman.accelerate(step)
    np.testing.assert_allclose(kalman.predict(), move_pose(pose, PART.box_centre, step))
    assert kalman.motion == pytest.approx(motion + step)
    np.testing.assert_array_equal(kalman.information(), sure)


@pytest.fixture(scope="module")
def model() -> PreparedPart:
    return prepared(PART)


def test_a_tracker_expects_the_part_where_a_shaking_camera_takes_it(model: PreparedPart) -> None:
    frames, off = shaken(), dict[str, list[float]]()
    for name, method in {"asked": AS_DRAWN, "not asked": replace(AS_DRAWN, camera=Off())}.items():
        tracker = Tracker(model, method)
        tracker.start(*frames[0])
        off[name] = []
        for frame, truth in frames[1:]:
            off[name].append(add_percent(PART, tracker.predicted, truth))
            result = tracker.track(frame)
            off.setdefault(f"{name}: expected", []).append(add_percent(PART, result.predicted, truth))
            assert add_percent(PART, result.cam_T_obj, truth) < 5.0
    # From the third frame on, when it is known how the camera turned before.
    asked, not_asked = (np.mean(off[f"{name}: expected"][2:]) for name in ("asked", "not asked"))
    assert asked < 0.5 * not_asked


def test_a_frame_that_cannot_be_read_and_one_that_comes_again_do_no_harm(model: PreparedPart) -> None:
    frames, tracker = shaken(3.0), Tracker(model, AS_DRAWN)
    tracker.start(*frames[0])
    for number, (frame, truth) in enumerate(frames[1:], 1):
        if number == 5:
            tracker.track(UnreadableFrame(number, CAMERA, "gone"))
            continue
        result = tracker.track(frame)
        if number == 8:
            result = tracker.track(replace(frame, index=frame.index))
        assert add_percent(PART, result.cam_T_obj, truth) < 5.0


@pytest.mark.parametrize(
    "setting", [{"margin_px": -1.0}, {"least_share": float("nan")}, {"least_share": 0.0}, {"memory": 1.0}], ids=str
)
def test_settings_are_checked(setting: dict[str, float]) -> None:
    with pytest.raises(TrackingError, match=r"camera\."):
        CameraMotion(**setting)


def test_a_prediction_that_takes_no_accelerations_is_not_asked_to(model: PreparedPart) -> None:
    frames, tracker = shaken(), Tracker(model, replace(ACP_EDGES, camera=CameraMotion()))
    tracker.start(*frames[0])
    for frame, _ in frames[1:4]:
        assert tracker.track(frame).state is not None
