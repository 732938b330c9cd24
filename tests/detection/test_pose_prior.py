"""Searches that are limited to what is near a pose."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from acp_lab.detection.config import DetectionConfig
from acp_lab.detection.detector import Detector, turned_views
from acp_lab.detection.pose_prior import PosePrior, rotation_from_axis
from acp_lab.detection.work import finish
from acp_lab.geometry.pose import make_pose, rotation_angle_deg, so3_exp, transform
from acp_lab.tracking.find import Finder
from tests.prepared_sample import sample_model, sample_scene

NO_TURN = np.eye(4)[None]


@cache
def finder() -> Finder:
    return Finder(sample_model())


def test_the_shortest_turn_from_the_axis(rng: np.random.Generator) -> None:
    directions = rng.normal(size=(50, 3))
    directions[:, 2] = np.abs(directions[:, 2])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    turns = rotation_from_axis(directions)
    assert np.allclose(turns[..., 2], directions)
    assert np.allclose(np.linalg.det(turns), 1.0)
    angles = [rotation_angle_deg(turn, np.eye(3)) for turn in turns]
    assert np.allclose(np.cos(np.radians(angles)), directions[:, 2], atol=1e-9)


def test_what_is_near_is_allowed_whatever_its_place(rng: np.random.Generator) -> None:
    """Templates are made for a part on the optical axis; the prior's part stands beside it."""
    seen = so3_exp(rng.normal(size=3))
    centre = np.array([4.0, -7.0, 2.0])
    ray = np.array([150.0, -90.0, 400.0])
    rotation = rotation_from_axis(ray / np.linalg.norm(ray)) @ seen
    prior = PosePrior(make_pose(rotation, ray - rotation @ centre), 20.0, 1.2)
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    turned = np.stack([so3_exp(np.radians(angle) * axis) @ seen for angle in (0.0, 19.0, 21.0, 30.0, 180.0)])
    assert prior.allows(turned, centre, NO_TURN, 0.0).tolist() == [True, True, False, False, False]
    assert prior.allows(turned, centre, NO_TURN, 5.0).tolist() == [True, True, True, False, False]
    assert PosePrior(prior.cam_T_obj, 180.0, 1.2).allows(turned, centre, NO_TURN, 0.0).all()
    assert prior.depth_mm(centre) == pytest.approx((400.0 / 1.2, 480.0))


def test_a_symmetric_part_is_as_near_from_its_other_side() -> None:
    half = np.diag([-1.0, -1.0, 1.0, 1.0])
    prior = PosePrior(make_pose(np.eye(3), np.array([0.0, 0.0, 300.0])), 20.0, 1.2)
    other = half[None, :3, :3]
    assert not prior.allows(other, np.zeros(3), NO_TURN, 0.0).any()
    assert prior.allows(other, np.zeros(3), np.stack([np.eye(4), half]), 0.0).all()


def test_a_depth_that_is_known_takes_as_many_candidates_as_one_level() -> None:
    config = DetectionConfig(depth_mm=(250.0, 1200.0), depth_step=1.15)
    detector = Detector(sample_model().part, sample_model().best_generator(), config)
    starts = {ratio: detector._narrowed(PosePrior(np.eye(4), 180.0, ratio)).starts for ratio in (1.0, 1.05, 1.15, 1.4)}
    levels = np.log(1200.0 / 250.0) / np.log(1.15)
    assert starts[1.0] == starts[1.05] == round(config.starts / levels)
    assert starts[1.15] == round(2.0 * config.starts / levels)
    assert starts[1.4] == round(config.starts * np.log(1.4**2) / np.log(1200.0 / 250.0))


def test_the_part_is_found_near_where_it_was() -> None:
    model, scene = sample_model(), sample_scene()
    frame = scene.frame(scene.frame_ids[20])
    truth, before = scene.truth(frame.index, scene.object_ids[0]), scene.first_pose
    assert truth is not None
    points = model.part.vertices
    prior = PosePrior(before, 25.0, 1.15, 80.0)
    found = finder().find(frame, 2, prior)
    error = np.linalg.norm(transform(found[0].cam_T_obj, points) - transform(truth, points), axis=1).mean()
    assert error < 0.05 * model.part.diameter
    work = [sum(finder().search(frame, 2, limits)) for limits in (prior, None)]
    assert work[0] < 0.15 * work[1]


def test_nothing_is_found_far_from_the_prior() -> None:
    """The candidates keep to the prior: another side of the part, another depth."""
    model, scene = sample_model(), sample_scene()
    detector: Detector = finder().detector
    frame = scene.frame(scene.frame_ids[0])
    behind = scene.first_pose @ np.diag([1.0, -1.0, -1.0, 1.0])
    look = finish(detector.search(frame.image, frame.camera, PosePrior(behind, 20.0, 1.1)))
    centre = model.part.box_centre
    depth = transform(scene.first_pose, centre)[2]
    assert look.candidates
    for candidate in look.candidates:
        assert 0.75 < transform(candidate.cam_T_obj, centre)[2] / depth < 1.35
        assert rotation_angle_deg(candidate.cam_T_obj[:3, :3], behind[:3, :3]) < 70.0


@pytest.mark.parametrize("z", [-300.0, 0.0, 1e-9, 1e9])
def test_a_prior_nobody_can_see(z: float) -> None:
    scene = sample_scene()
    frame = scene.frame(scene.frame_ids[0])
    prior = PosePrior(make_pose(np.eye(3), np.array([0.0, 0.0, z])), 20.0, 1.1, 50.0)
    assert isinstance(finder().find(frame, 1, prior), tuple)


def test_all_templates_have_a_rotation() -> None:
    detector = finder().detector
    rotations = turned_views(detector.templates, detector.views, np.arange(len(detector.templates)))
    assert np.allclose(rotations @ rotations.transpose(0, 2, 1), np.eye(3), atol=1e-9)
