"""How long offsets last: made frames in which that is known."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.errors import ParameterError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.studies.offset_persistence import (
    SeenOffsets,
    persistence_by_distance,
    persistence_by_turn,
    seen_offsets,
)
from acp_lab.studies.pose_bound import EdgeEvidence

COUNT = 300


def frame_at(angle_deg: float, offsets: FloatArray, seed: int = 0, count: int = COUNT) -> SeenOffsets:
    """Samples on a line of 100 mm, the same ones in all frames of a seed; every third is of the outline."""
    points = np.zeros((count, 3))
    points[:, 0] = np.sort(np.random.default_rng(seed).uniform(0.0, 100.0, count))
    angle = np.radians(angle_deg)
    view = np.array([np.sin(angle), 0.0, np.cos(angle)])
    return SeenOffsets(points, offsets, np.arange(count) % 3 == 0, view)


def test_offsets_that_fade_with_the_turn() -> None:
    """Part of an offset stays, part is new in every frame beyond five degrees."""
    rng = np.random.default_rng(1)
    lasting, passing = rng.normal(size=(2, COUNT))
    frames = [frame_at(angle, lasting + passing) for angle in (0.0, 1.0)]
    frames += [frame_at(angle, lasting + rng.normal(size=COUNT)) for angle in (20.0, 30.0, 41.0)]
    found = persistence_by_turn(frames, (0.0, 2.0, 5.0, 60.0))
    assert found[0] == pytest.approx(1.0)
    assert np.isnan(found[1])
    assert found[2] == pytest.approx(0.5, abs=0.1)


def test_what_was_outline_in_one_frame_is_another_edge_in_the_next() -> None:
    offsets = np.random.default_rng(2).normal(size=COUNT)
    one, other = frame_at(0.0, offsets), frame_at(1.0, offsets)
    changed = SeenOffsets(other.points_obj, -offsets, ~other.outline, other.view_obj)
    assert np.isnan(persistence_by_turn([one, changed], (0.0, 2.0))).all()
    assert persistence_by_turn([one, other], (0.0, 2.0))[0] == pytest.approx(1.0)


def test_samples_of_other_places_are_not_compared() -> None:
    offsets = np.random.default_rng(3).normal(size=COUNT)
    assert np.isnan(persistence_by_turn([frame_at(0.0, offsets), frame_at(1.0, offsets, seed=9)], (0.0, 2.0))).all()


def test_neighbours_lie_off_together() -> None:
    """Waves of 40 mm: alike within a few mm, against each other half a wave apart."""
    frames = []
    for k in range(8):
        frame = frame_at(10.0 * k, np.zeros(COUNT), seed=k)
        phase = np.random.default_rng(k).uniform(0.0, 2.0 * np.pi)
        waves = np.sin(2.0 * np.pi * frame.points_obj[:, 0] / 40.0 + phase)
        frames.append(SeenOffsets(frame.points_obj, waves, frame.outline, frame.view_obj))
    found = persistence_by_distance(frames, (0.0, 2.0, 18.0, 22.0, 500.0, 600.0))
    assert found[0] > 0.95
    assert found[2] < -0.9
    assert np.isnan(found[4])


def test_what_a_class_shares_is_taken_away_and_wrong_edges_count_little() -> None:
    rng = np.random.default_rng(4)
    outline = rng.random(COUNT) < 0.5
    sign = rng.choice([-2.0, 2.0], COUNT)  # px per mm, normals either way
    own_mm = rng.normal(0.0, 0.1, COUNT)
    residuals_px = sign * (np.where(outline, -0.3, 0.2) + own_mm)
    sign[0], residuals_px[1] = 0.0, 50.0
    evidence = EdgeEvidence(
        np.zeros((COUNT, 6)), residuals_px, sign, outline, np.zeros(COUNT, np.int64), rng.normal(size=(COUNT, 3))
    )
    found = seen_offsets(evidence, np.array([0.0, 0.0, 7.0]))
    np.testing.assert_array_equal(found.view_obj, [0.0, 0.0, 1.0])
    np.testing.assert_array_equal(found.points_obj, evidence.points_obj[1:])
    assert abs(found.offsets[0]) == 3.0
    for rows in (found.outline, ~found.outline):
        assert np.median(found.offsets[rows]) == pytest.approx(0.0, abs=1e-12)
    assert np.corrcoef(found.offsets[1:], own_mm[2:])[0, 1] > 0.97


@pytest.mark.parametrize("limits", [(), (1.0,), (1.0, 1.0), (2.0, 1.0)])
def test_bins_that_do_not_rise_are_refused(limits: tuple[float, ...]) -> None:
    for measure in (persistence_by_turn, persistence_by_distance):
        with pytest.raises(ParameterError, match="each above the one before"):
            measure([], limits)
