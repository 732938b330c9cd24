"""Motions keep the speed that was asked for, and stay smooth between frames."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from acp_lab.geometry.pose import check_rotation, rotation_angle_deg
from data_recipes.metal.cad_parts import make_part
from data_recipes.metal.motion import (
    PosePath,
    look_from,
    orbit_rotations,
    speed_profile,
    tumble_rotations,
    walk,
    wander,
)
from data_recipes.metal.plan import KINDS, Kind, SceneConfig
from data_recipes.metal.scene import plan_truth


@pytest.mark.parametrize("steady", [False, True])
def test_walk_has_the_steps_asked_for(steady: bool, rng: np.random.Generator) -> None:
    steps = speed_profile(rng, 30, 2.0, 3.0)
    assert steps.mean() == pytest.approx(2.0, abs=0.05)
    rotations = walk(tumble_rotations(rng, steps.sum() + 1, steady), steps)
    found = [rotation_angle_deg(a, b) for a, b in pairwise(rotations)]
    np.testing.assert_allclose(found, steps, rtol=0.02)


def test_walk_refuses_a_short_path(rng: np.random.Generator) -> None:
    with pytest.raises(ValueError, match="shorter"):
        walk(orbit_rotations(rng, 10.0)[:20], np.full(100, 3.0))


def test_wander_keeps_box_and_speed(rng: np.random.Generator) -> None:
    low, high = np.array([-40.0, -30.0, 350.0]), np.array([40.0, 30.0, 500.0])
    path = wander(rng, 40, 2.5, low, high)
    assert np.linalg.norm(np.diff(path, axis=0), axis=1).mean() == pytest.approx(2.5, abs=1e-9)
    assert (path >= low).all()
    assert (path <= high).all()


def test_camera_looks_down_at_the_origin() -> None:
    rotation = look_from(0.3, 0.8)
    check_rotation(rotation, "look_from")
    towards = -rotation[2]  # from the origin to the camera
    assert towards[2] == pytest.approx(np.sin(0.8))
    assert rotation[1, 2] < 0  # the image's y axis points down


def test_pose_path_is_exact_on_frames_and_smooth_between(rng: np.random.Generator) -> None:
    truth = plan_truth(make_part("slot_block"), SceneConfig("regular", 12, 640, 512, seed=3), held=True, rest=np.eye(3))
    path = PosePath(truth.poses)
    np.testing.assert_array_equal(path.at(5.0), truth.poses[5])
    near = path.at(5.001)
    check_rotation(near[:3, :3], "between frames")
    assert np.abs(near - truth.poses[5]).max() < 0.02
    middle = path.at(5.5)
    turn = rotation_angle_deg(truth.poses[5][:3, :3], truth.poses[6][:3, :3])
    assert rotation_angle_deg(truth.poses[5][:3, :3], middle[:3, :3]) == pytest.approx(turn / 2, rel=0.2)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("held", [False, True])
def test_part_stays_in_view_at_every_kind(kind: Kind, held: bool) -> None:
    part = make_part("slot_block")
    config = SceneConfig(kind, 40, 640, 512, seed=8)
    for pose in plan_truth(part, config, held, np.eye(3)).poses:
        pixels = config.camera.project(part.vertices @ pose[:3, :3].T + pose[:3, 3])
        assert pixels.min() >= 0
        assert (pixels.max(0) <= [639, 511]).all()
        assert 350 <= pose[2, 3] <= 550
