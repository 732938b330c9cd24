"""Candidates of the detector, aligned."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.detection.work import finish
from acp_lab.evaluation.part_metric import PartMetric
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose_step import move_pose
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.alignment import aligning
from acp_lab.tracking.find import Finder
from tests.prepared_sample import sample_model, sample_scene

PART = sample_model().part


def frame_and_truth(number: int) -> tuple[Frame, FloatArray]:
    scene = sample_scene()
    frame = scene.frame(scene.frame_ids[number])
    truth = scene.truth(frame.index, 1)
    assert isinstance(frame, Frame)
    assert truth is not None
    return frame, truth


def moved(pose: FloatArray, turn_deg: tuple[float, float, float], shift_mm: tuple[float, float, float]) -> FloatArray:
    """A pose (4, 4), turned about the part's centre and shifted."""
    return move_pose(pose, PART.box_centre, np.array([*np.radians(turn_deg), *shift_mm]))


@pytest.mark.parametrize("number", [0, 20])
@pytest.mark.parametrize(
    ("turn_deg", "shift_mm"),
    [((0.0, 0.0, 0.0), (0.0, 0.0, 10.0)), ((4.0, -3.0, 2.0), (1.0, -1.0, -8.0)), ((-10.0, 6.0, 0.0), (2.0, 0.0, 8.0))],
)
def test_aligned_to_what_the_frame_shows(
    number: int, turn_deg: tuple[float, float, float], shift_mm: tuple[float, float, float]
) -> None:
    frame, truth = frame_and_truth(number)
    off = moved(truth, turn_deg, shift_mm)
    metric = PartMetric(PART)
    assert metric.share(off, truth) > 0.05
    aligned = finish(aligning(sample_model(), frame, off))
    assert aligned is not None
    assert metric.share(aligned, truth) < 0.01


def test_two_at_a_time_are_the_same_as_one_after_the_other() -> None:
    """A search that goes on over many frames is not alone: nothing of one alignment enters another."""
    frame, truth = frame_and_truth(0)
    other_frame, other_truth = frame_and_truth(25)
    asked = [
        (frame, moved(truth, (3.0, 0.0, 0.0), (0.0, 0.0, 6.0))),
        (other_frame, moved(other_truth, (0.0, 4.0, 0.0), (0.0, 0.0, -6.0))),
    ]
    alone = [finish(aligning(sample_model(), *one)) for one in asked]
    under_way = [aligning(sample_model(), *one) for one in asked]
    for _ in range(4):
        assert all(next(steps) > 0.0 for steps in under_way)
    for steps, expected in zip(under_way, alone, strict=True):
        found = finish(steps)
        assert found is not None
        assert expected is not None
        np.testing.assert_array_equal(found, expected)


def test_what_leads_away_or_is_not_seen_is_none() -> None:
    frame, truth = frame_and_truth(0)
    behind, beside = truth.copy(), truth.copy()
    behind[2, 3] = -truth[2, 3]
    beside[0, 3] += 10.0 * truth[2, 3]
    assert finish(aligning(sample_model(), frame, behind)) is None
    assert finish(aligning(sample_model(), frame, beside)) is None
    for shift_mm in ((0.0, 0.0, -60.0), (0.0, 0.0, 60.0)):
        assert finish(aligning(sample_model(), frame, moved(truth, (0.0, 0.0, 0.0), shift_mm))) is None


def test_found_poses_are_aligned() -> None:
    finder, metric = Finder(sample_model()), PartMetric(PART)
    for number in (0, 12, 30):
        frame, truth = frame_and_truth(number)
        assert metric.share(finder.find(frame, 1)[0].cam_T_obj, truth) < 0.01
