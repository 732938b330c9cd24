"""What notebook 13 shows of the region tracker is what the tracker itself uses."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.course.lesson_13 import STEP, right_posterior
from acp_lab.errors import TrackingError
from acp_lab.geometry.pose_step import move_pose
from acp_lab.sequences.frame import Frame
from acp_lab.studies.region_lines import RegionView
from tests.prepared_sample import sample_model, sample_scene


def view() -> RegionView:
    frame = sample_scene().frame(0)
    assert isinstance(frame, Frame)
    return RegionView.of(sample_model(), frame, sample_scene().first_pose)


def test_segments_lead_to_the_posterior() -> None:
    seen = view().posteriors(sample_scene().first_pose, 3)
    for inside, posterior in zip(seen.inside[:20], seen.posterior[:20], strict=True):
        np.testing.assert_allclose(right_posterior(inside, STEP), posterior, rtol=1e-4, atol=1e-9)
    np.testing.assert_allclose(seen.posterior @ seen.offsets_px, seen.mean_px, atol=1e-6)


def test_colours_tell_inside_from_outside_and_lines_say_where_the_outline_is() -> None:
    found, pose = view(), sample_scene().first_pose
    lines = found.lines(pose)
    probability, origin = found.probabilities()

    def at(way_px: float) -> float:
        x, y = np.rint(lines.points + way_px * lines.outward - origin).astype(int).T
        return float(probability[y, x].mean())

    assert at(-5.0) > 0.7 > 0.3 > at(5.0)
    part = sample_model().part
    mm_per_px = pose[2, 3] / sample_scene().camera(0).fx
    moved = move_pose(pose, part.box_centre, np.array([0, 0, 0, 5.0 * mm_per_px, 0, 0]))
    outward, told = found.lines(moved).outward, found.posteriors(moved, 3).mean_px
    sideways = np.abs(outward[:, 0]) > 0.9
    assert np.median((told * np.sign(outward[:, 0]))[sideways]) == pytest.approx(-5.0, abs=1.5)


def test_a_pose_beside_the_image_is_refused() -> None:
    frame = sample_scene().frame(0)
    assert isinstance(frame, Frame)
    pose = sample_scene().first_pose
    pose[0, 3] += 1e4
    with pytest.raises(TrackingError, match="not seen"):
        RegionView.of(sample_model(), frame, pose)
