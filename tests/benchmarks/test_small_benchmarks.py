"""What starts set by hand and a replay cost or find, on the sample."""

from __future__ import annotations

import numpy as np

from acp_lab.geometry.pose import rotation_angle_deg, transform
from benchmarks import replay_cost, snap_starts
from tests.prepared_sample import sample_model, sample_scene


def test_starts_are_as_far_off_as_they_say() -> None:
    model, frame, truth = sample_model(), sample_scene().frame(0), sample_scene().first_pose
    rng = np.random.default_rng(0)
    first, second = snap_starts.set_by_hand(model, frame, truth, rng)
    assert 0.5 < rotation_angle_deg(first[:3, :3], truth[:3, :3]) < 40.0
    assert rotation_angle_deg(first[:3, :3], second[:3, :3]) > 5.0
    pose = snap_starts.off(model, truth, rng)
    np.testing.assert_allclose(rotation_angle_deg(pose[:3, :3], truth[:3, :3]), snap_starts.TURN_DEG)
    centre = model.part.box_centre
    moved_mm = np.linalg.norm(transform(pose, centre) - transform(truth, centre))
    distance_mm = np.linalg.norm(transform(truth, centre))
    assert moved_mm < snap_starts.SHIFT_MM + snap_starts.DEPTH_SHARE * (distance_mm + snap_starts.SHIFT_MM)


def test_a_start_that_is_not_found_gives_way_to_the_next() -> None:
    model, frame, truth = sample_model(), sample_scene().frame(0), sample_scene().first_pose
    beside = truth.copy()
    beside[0, 3] += 200.0
    found = snap_starts.snapped_to(model, frame, (beside, truth))
    assert np.abs(found - truth).max() < 3.0


def test_a_replay_with_iterations_costs_more() -> None:
    plain = replay_cost.cost(sample_scene(), sample_model(), "off")
    whole = replay_cost.cost(sample_scene(), sample_model(), "all")
    assert 0.0 < plain.file_mb < whole.file_mb
    assert plain.frame_ms > 0.0
    assert plain.start_s > 0.0
