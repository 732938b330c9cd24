"""The study of losses: its starts, the edges it takes away, and what it says of losses that are known to fail."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.errors import SequenceError
from acp_lab.studies.loss_study import ERASED_REACH_PX, LossChoice, LossStudyConfig, erase_edges, loss_study
from acp_lab.tracking.targets.distance_map import DistanceTarget
from tests.prepared_sample import sample_model, sample_scene

NARROW = LossChoice("narrow", "tukey", (4.0, 2.0))
NONE = LossChoice("no threshold", "geman-mcclure", (1e4, 1e4))


def test_a_threshold_helps_on_a_real_frame() -> None:
    frame, pose = sample_scene().frame(20), sample_scene().truth(20, 1)
    config = LossStudyConfig(turn_deg=1.0, shift_mm=1.0, trials=2, limit=0.03)
    study = loss_study(sample_model(), [frame], [pose], [NARROW, NONE], (0.0, 0.3), config)
    assert study.errors.shape == (2, 2, 2)
    assert study.median[0, 0] < study.limit < study.median[1, 0]
    assert study.median[0, 1] < study.median[1, 1]
    assert study.found[0, 0] == 1.0
    assert "30% removed" in str(study)
    assert "no threshold" in str(study)


def test_the_same_seed_gives_the_same_numbers() -> None:
    frame, pose = sample_scene().frame(5), sample_scene().truth(5, 1)
    config = LossStudyConfig(trials=1, steps=2)
    runs = [loss_study(sample_model(), [frame], [pose], [NARROW], (0.2,), config, seed) for seed in (1, 1, 2)]
    np.testing.assert_array_equal(runs[0].errors, runs[1].errors)
    assert (runs[0].errors != runs[2].errors).any()


def test_frames_and_truths_must_match() -> None:
    with pytest.raises(SequenceError, match="one pose for each frame"):
        loss_study(sample_model(), [sample_scene().frame(0)], [], [NARROW])


def target_with(rows: list[int]) -> DistanceTarget:
    edges = np.zeros((60, 80), bool)
    edges[rows] = True
    return DistanceTarget(edges, edges[None], (100, 200))


def test_erasing_takes_the_parts_edges_on_one_side() -> None:
    """A horizontal edge of the part, and one of something else below it."""
    target = target_with([10, 40])
    points = np.column_stack([np.linspace(100.0, 179.0, 200), np.full(200, 210.3)])
    right = erase_edges(target, points, 0.5, 0.0)
    assert right.edges[10, :36].all()
    assert not right.edges[10, 45:].any()
    assert right.edges[40].all(), "what is not the part's stays"
    np.testing.assert_array_equal(right.layers[0], right.edges)
    left = erase_edges(target, points, 0.5, np.pi)
    assert not left.edges[10, :34].any()
    assert left.edges[10, 45:].all()


def test_erasing_reaches_a_little_beside_the_points_and_nothing_is_nothing() -> None:
    target = target_with([10, 10 + int(ERASED_REACH_PX), 14])
    points = np.column_stack([np.linspace(100.0, 179.0, 200), np.full(200, 210.0)])
    assert erase_edges(target, points, 0.0, 0.0) is target
    gone = erase_edges(target, points, 0.99, 0.0)
    assert not gone.edges[10:13, 5:].any()
    assert gone.edges[14].all()
    outside = erase_edges(target, points + 500.0, 0.9, 0.0)
    np.testing.assert_array_equal(outside.edges, target.edges)
