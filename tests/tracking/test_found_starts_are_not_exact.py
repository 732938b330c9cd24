"""A start that was found in the image says no more than the image does."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.evaluation import add_mm
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import transform
from acp_lab.tracking.session import track_sequence
from acp_lab.tracking.tracker import Tracker
from tests.prepared_sample import sample_model, sample_scene


def farther(share: float) -> FloatArray:
    """The sample's first pose, so much farther away along the line of sight."""
    truth, centre_obj = sample_scene().first_pose, sample_model().part.box_centre
    pose = truth.copy()
    pose[:3, 3] += share * transform(truth, centre_obj)
    return pose


def add_percent(pose: FloatArray, frame_id: int) -> float:
    part, truth = sample_model().part, sample_scene().truth(frame_id, 1)
    assert truth is not None
    return 100.0 * add_mm(part.vertices, pose, truth) / part.diameter


@pytest.mark.parametrize("share", [-0.01, 0.01])
def test_its_distance_is_asked_of_the_image(share: float) -> None:
    tracker = Tracker(sample_model())
    given = tracker.start(sample_scene().frame(0), farther(share))
    assert tracker.start_was_trusted
    assert add_percent(given.cam_T_obj, 0) > 3.0, "whoever gives a pose may know what the image does not show"
    found = tracker.start(sample_scene().frame(0), farther(share), found=True)
    assert not tracker.start_was_trusted
    assert add_percent(found.cam_T_obj, 0) < 0.6


def test_runs_and_sessions_hand_it_on() -> None:
    scene, model = sample_scene(), sample_model()
    run = Tracker(model).run(scene, farther(0.01), max_frames=3, found=True)
    assert add_percent(run.results[1][0].cam_T_obj, 0) < 0.6
    trackers, starts = {i: Tracker(model) for i in (1, 2)}, dict.fromkeys((1, 2), farther(0.01))
    both = track_sequence(trackers, scene, starts, max_frames=2, found={2})
    errors = [add_percent(both.results[i][0].cam_T_obj, 0) for i in (1, 2)]
    assert errors[0] > 3.0
    assert errors[1] < 0.6
    np.testing.assert_array_equal(both.starts[2], farther(0.01))
