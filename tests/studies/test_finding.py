"""Looking into the detector, on the sample's first frame."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from acp_lab.geometry.pose import make_pose, so3_exp
from acp_lab.sequences.frame import Frame
from acp_lab.studies.finding import (
    Stage,
    edges_by_direction,
    find_stages,
    nearest_in,
    outline_contrast,
    pose_errors,
    spread_scores,
    template_scores,
    template_view,
    turned_agreement,
)
from acp_lab.studies.true_edges import TrueEdges
from acp_lab.tracking.find import Finder
from tests.prepared_sample import sample_model, sample_scene


@cache
def finder() -> Finder:
    return Finder(sample_model())


def seen() -> tuple[Frame, np.ndarray]:
    frame = sample_scene().frame(0)
    assert isinstance(frame, Frame)
    return frame, sample_scene().first_pose


def test_edges_are_sorted_by_their_directions() -> None:
    frame, _ = seen()
    image = np.full_like(frame.image, 40)
    image[100:, 200:] = 200
    edges = edges_by_direction(Frame(0, image, frame.camera))
    assert edges.shape == (8, *image.shape[:2])
    across, down = edges[0].nonzero(), edges[4].nonzero()
    assert 99 <= across[0].min() <= across[0].max() <= 101
    assert 199 <= down[1].min() <= down[1].max() <= 201
    assert len(across[0]) > 400
    assert len(down[0]) > 380


def test_contrast_is_that_of_the_part_against_its_ground() -> None:
    frame, pose = seen()
    truth = TrueEdges(sample_model().part, sample_model().edges)
    points, brighter = outline_contrast(truth, frame, pose)
    assert len(points) == len(brighter) > 300
    assert 0.6 < (brighter > 0.0).mean() < 1.0, "bright metal on darker wood, with reflections"
    dark = Frame(0, 255 - frame.image, frame.camera)
    np.testing.assert_allclose(outline_contrast(truth, dark, pose)[1], -brighter, atol=1.5)


def test_a_template_scores_where_its_features_are() -> None:
    response = np.zeros((8, 40, 50), np.float32)
    offsets, bins = np.array([[-5, 0], [3, -4], [0, 6]]), np.array([0, 3, 3])
    for (x, y), layer in zip(offsets, bins, strict=True):
        response[layer, 20 + y, 30 + x] = 1.0
    scores = template_scores(response, offsets, bins)
    assert scores.shape == (40, 50)
    assert np.unravel_index(scores.argmax(), scores.shape) == (20, 30)
    assert scores.max() == pytest.approx(1.0)


def test_the_template_next_to_the_truth_stands_out_and_wider_when_edges_reach_further() -> None:
    frame, pose = seen()
    detector = finder().detector
    view = template_view(detector, frame, pose)
    assert view.turn_deg < 15.0, "views are 162 all around, turns 15 degrees"
    diameter_px = detector.config.scan_px
    assert np.abs(view.offsets).max() < 0.75 * diameter_px
    one, four = (spread_scores(detector, view, reach) for reach in (1.0, 4.0))
    assert four.at_truth > four.elsewhere
    assert four.at_truth > one.at_truth
    assert four.width_px > one.width_px


def test_a_part_in_the_corner_has_scores_as_well() -> None:
    frame, pose = seen()
    view = replace(template_view(finder().detector, frame, pose), centre=np.array([1.0, 0.0]))
    corner = spread_scores(finder().detector, view, 4.0)
    assert corner.at_truth == corner.scores[:3, :4].max()


def test_directions_tell_a_turned_part_from_the_true_one() -> None:
    frame, pose = seen()
    plain, directional = turned_agreement(finder().detector, frame, pose, np.array([-60.0, 0.0, 60.0]))
    assert plain.argmax() == directional.argmax() == 1
    assert (directional <= plain + 1e-6).all()
    assert directional[[0, 2]].mean() / directional[1] < 0.5 * plain[[0, 2]].mean() / plain[1]


def test_stages_narrow_down_to_the_part() -> None:
    frame, pose = seen()
    stages = find_stages(finder(), frame, pose)
    assert [len(stage.errors) for stage in stages[:-1]] == sorted((len(s.errors) for s in stages[:-1]), reverse=True)
    assert stages[-1].first_right == 1
    assert "the first at place 1" in str(stages[-1])
    np.testing.assert_allclose(stages[-1].poses[0], finder().find(frame, 1)[0].cam_T_obj, atol=1e-6)
    assert stages[0].errors.min() > stages[-1].errors.min(), "the scan is rough"


def test_errors_are_shares_of_the_diameter_and_places_count_from_one() -> None:
    part, truth = sample_model().part, sample_scene().first_pose
    aside = truth.copy()
    aside[0, 3] += 0.25 * part.diameter
    turned = truth @ make_pose(so3_exp(np.array([0.0, 0.0, 0.01])), np.zeros(3))
    errors = pose_errors(part, np.array([aside, truth, turned]), truth)
    np.testing.assert_allclose(errors[:2], [0.25, 0.0], atol=1e-9)
    assert 0.0 < errors[2] < 0.02
    stage = Stage("made", np.array([aside, turned]), errors[[0, 2]])
    assert (stage.right, stage.first_right) == (1, 2)
    assert nearest_in(stage, part, truth) == 2
    assert Stage("made", aside[None], errors[:1]).first_right is None
