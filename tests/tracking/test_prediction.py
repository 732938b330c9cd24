"""Constant velocity: exact on the motion it assumes. Last pose: exact on none."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose_step import centre_position, move_pose
from acp_lab.tracking.prediction import ConstantVelocity, ConstantVelocityPrediction, LastPose, LastPosePrediction
from tests.geometry.geometry_strategies import directions
from tests.made_parts import box, looking_at

PART = box(shift=(500.0, -200.0, 100.0))
START = looking_at(PART, np.array([1.0, 0.5, 0.2]), 250.0, 0.4)


@given(turn=directions(), angle_rad=st.floats(0.0, 1.0), shift=directions(), length=st.floats(0.0, 50.0))
def test_it_is_exact_on_constant_spin_about_the_centre(
    turn: FloatArray, angle_rad: float, shift: FloatArray, length: float
) -> None:
    step = np.concatenate([angle_rad * turn, length * shift])
    motion = ConstantVelocity(PART.box_centre)
    motion.restart(START)
    pose = START
    for _ in range(4):
        pose = move_pose(pose, PART.box_centre, step)
        motion.observe(pose)
    np.testing.assert_allclose(motion.predict(), move_pose(pose, PART.box_centre, step), atol=1e-7)


def test_after_a_start_the_part_rests() -> None:
    motion = ConstantVelocity(PART.box_centre)
    motion.restart(START)
    np.testing.assert_array_equal(motion.predict(), START)
    motion.observe(move_pose(START, PART.box_centre, np.array([0.1, 0, 0, 1.0, 0, 0])))
    assert not np.allclose(motion.predict(), START)
    motion.restart(START)
    np.testing.assert_array_equal(motion.predict(), START)
    np.testing.assert_array_equal(motion.last, START)


def test_a_prediction_is_nobodys_array() -> None:
    motion = ConstantVelocity(PART.box_centre)
    motion.restart(START.copy())
    motion.predict()[:] = 0.0
    np.testing.assert_array_equal(motion.last, START)


def test_the_origin_of_the_object_frame_plays_no_part() -> None:
    """A pure spin leaves the centre where it is, however far away the frame's origin swings."""
    motion = ConstantVelocity(PART.box_centre)
    motion.restart(START)
    motion.observe(move_pose(START, PART.box_centre, np.array([0.0, 0.3, 0.0, 0.0, 0.0, 0.0])))
    np.testing.assert_allclose(
        centre_position(motion.predict(), PART.box_centre), centre_position(START, PART.box_centre), atol=1e-9
    )


def test_a_long_prediction_stays_a_pose() -> None:
    motion = ConstantVelocity(PART.box_centre)
    motion.restart(START)
    motion.observe(move_pose(START, PART.box_centre, np.array([0.2, -0.3, 0.1, 0.5, 0.0, 1.0])))
    for _ in range(300):
        motion.observe(motion.predict())
    turn = motion.last[:3, :3]
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-9)


def test_before_any_pose_there_is_nothing_to_predict() -> None:
    with pytest.raises(ValueError, match="no pose observed yet"):
        ConstantVelocity(PART.box_centre).predict()


def test_the_motion_of_a_pose_that_fits_nothing_is_not_taken_on() -> None:
    moved = move_pose(START, PART.box_centre, np.array([0.1, 0, 0, 1.0, 0, 0]))
    for quality, rests in ((0.19, True), (0.2, True), (0.21, False)):
        motion = ConstantVelocityPrediction(rest_below=0.2).predictor(PART.box_centre)
        motion.restart(START)
        motion.observe(moved, quality)
        assert motion.moves is not rests
        assert (np.abs(motion.predict() - moved).max() < 1e-12) == rests
        np.testing.assert_array_equal(motion.last, moved)
    for quality in (0.0, 1.0):  # the paper's loop asks no such question
        motion = ConstantVelocityPrediction(rest_below=-1.0).predictor(PART.box_centre)
        motion.restart(START)
        motion.observe(moved, quality)
        assert motion.moves


def test_no_velocity_is_taken_from_a_pose_that_fits_nothing() -> None:
    """Nor is one in the frame after it, to which the step from there would be no motion of the part."""
    step = np.array([0.1, 0, 0, 1.0, 0, 0])
    path = [START]
    for _ in range(5):
        path.append(move_pose(path[-1], PART.box_centre, step))
    motion = ConstantVelocity(PART.box_centre, rest_below=0.2)
    motion.restart(path[0])
    motion.observe(path[1], 0.9)
    motion.observe(move_pose(path[2], PART.box_centre, np.array([0, 0, 1.0, 30.0, 0, 0])), 0.1)
    motion.observe(path[3], 0.9)
    assert not motion.moves
    np.testing.assert_array_equal(motion.predict(), path[3])
    motion.observe(path[4], 0.9)
    np.testing.assert_allclose(motion.predict(), path[5], atol=1e-9)


def test_a_part_at_rest_rests_through_a_frame_without_an_image() -> None:
    motion = ConstantVelocity(PART.box_centre)
    motion.restart(START)
    motion.coast()
    assert not motion.moves
    np.testing.assert_array_equal(motion.predict(), START)


def test_the_last_pose_is_all_that_counts() -> None:
    motion = LastPosePrediction().predictor(PART.box_centre)
    motion.restart(START)
    for step in range(3):
        pose = move_pose(START, PART.box_centre, np.array([0.1 * step, 0, 0, 1.0, 0, 0]))
        motion.observe(pose, 1.0)
        np.testing.assert_array_equal(motion.predict(), pose)
        np.testing.assert_array_equal(motion.last, pose)
        assert not motion.moves
    motion.predict()[:] = 0.0
    np.testing.assert_array_equal(motion.last, pose)


def test_the_motion_is_the_last_step() -> None:
    part = box()
    step = np.array([0.02, -0.01, 0.03, 1.0, -2.0, 0.5])
    motion = ConstantVelocity(part.box_centre)
    motion.restart(looking_at(part, np.array([1.0, 0.5, 0.2]), 250.0, 0.4))
    assert motion.motion is None
    motion.observe(move_pose(motion.last, part.box_centre, step))
    found = motion.motion
    assert found is not None
    np.testing.assert_allclose(found, step, atol=1e-9)
    np.testing.assert_allclose(motion.predict(), move_pose(motion.last, part.box_centre, found), atol=1e-9)
    resting = LastPose()
    resting.restart(motion.last)
    assert resting.motion is None
