"""The six pose parameters of a run: what moved, by how much, and that a whole turn is no jump."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from acp_lab.cad.part import Part
from acp_lab.errors import SequenceError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose_step import move_pose
from acp_lab.studies.pose_parameters import NAMES, pose_parameters
from acp_lab.tracking.observer import SessionInfo, TrackedObject
from acp_lab.tracking.session import TrackRun
from acp_lab.tracking.tracker import Tracker
from tests.made_parts import box, looking_at
from tests.tracking.rendered import MadeSequence, draw, poses, prepared


@pytest.fixture(scope="module")
def run() -> TrackRun:
    part = box((60.0, 40.0, 4.0))
    truth = poses(part, looking_at(part, np.array([0.4, 0.3, 1.0]), 260.0, 0.3), 2)
    sequence = MadeSequence([draw([(part, pose)]) for pose in truth], {1: truth})
    return Tracker(prepared(part)).run(sequence, truth[0])


def made(run: TrackRun, truth: list[FloatArray], found: list[FloatArray]) -> TrackRun:
    """A run with these poses."""
    (first, *_) = run.results[1]
    results = tuple(replace(first, frame_id=2 * i, cam_T_obj=pose) for i, pose in enumerate(found))
    info = SessionInfo("made", 1, "acp", (TrackedObject(1, run.parts[1]),), lambda frame, _: truth[frame // 2])
    return replace(run, results={1: results}, session=info)


def test_each_parameter_is_what_moved(run: TrackRun) -> None:
    part: Part = run.parts[1]
    start = looking_at(part, np.array([0.4, 0.3, 1.0]), 260.0, 0.3)
    for number in range(6):
        step = np.zeros(6)
        step[number] = np.radians(3.0) if number < 3 else 3.0
        there = move_pose(start, part.box_centre, step)
        found = pose_parameters(made(run, [start, there], [start, start]))
        np.testing.assert_allclose(found.true[1] - found.true[0], 3.0 * np.eye(6)[number], atol=1e-6)
        np.testing.assert_allclose(found.off, [np.zeros(6), -3.0 * np.eye(6)[number]], atol=1e-6)
        assert NAMES[number].startswith("turn" if number < 3 else "xyz"[number - 3])


def test_a_part_that_turns_round_and_round_has_no_jump(run: TrackRun) -> None:
    part = run.parts[1]
    turning = poses(part, looking_at(part, np.array([0.4, 0.3, 1.0]), 260.0, 0.3), 60, np.eye(6)[2] * np.radians(15.0))
    ahead = [move_pose(pose, part.box_centre, np.eye(6)[2] * np.radians(2.0)) for pose in turning]
    found = pose_parameters(made(run, turning, ahead))
    np.testing.assert_allclose(np.diff(found.true[:, 2]), 15.0, atol=1e-6)
    np.testing.assert_allclose(found.off[:, 2], 2.0, atol=1e-6)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_constant_error_is_constant_however_the_part_turns(run: TrackRun, axis: int) -> None:
    """Also next to a quarter turn about y, where two of three Euler angles run wild, and next to whole turns."""
    part, start = run.parts[1], looking_at(run.parts[1], np.array([0.4, 0.3, 1.0]), 260.0, 0.3)
    turning = poses(part, start, 60, np.eye(6)[axis] * np.radians(9.9))
    error = np.array([1.0, -2.0, 0.5, 0.3, 0.2, -0.4])
    step = np.concatenate([np.radians(error[:3]), error[3:]])
    found = pose_parameters(made(run, turning, [move_pose(pose, part.box_centre, step) for pose in turning]))
    np.testing.assert_allclose(np.diff(found.true, axis=0), np.tile(9.9 * np.eye(6)[axis], (59, 1)), atol=1e-6)
    np.testing.assert_allclose(found.off, np.tile(error, (60, 1)), atol=1e-6)


def test_a_run_is_compared_with_its_truth(run: TrackRun) -> None:
    found = pose_parameters(run)
    assert found.frame_ids.tolist() == [0, 2]
    assert found.estimated.shape == found.true.shape == (2, 6)
    assert np.abs(found.off).max() < 8.0
    assert np.abs(found.true[1] - found.true[0]).max() > 0.5


def test_what_cannot_be_compared_is_told(run: TrackRun) -> None:
    with pytest.raises(SequenceError, match="object 7 was not tracked"):
        pose_parameters(run, 7)
    assert run.session is not None
    with pytest.raises(SequenceError, match="no frame of object 1 has a truth"):
        pose_parameters(replace(run, session=replace(run.session, truth=None)))
