"""The shipped sample is whole, small, and the one that the recipe makes."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest

from acp_lab.cad.part import Part
from acp_lab.geometry.pose import check_rotation, rotation_angle_deg
from acp_lab.sample import sample_dataset
from data_recipes.metal.cad_parts import make_part
from data_recipes.metal.scene import scene_truth
from data_recipes.metal_sequences import SAMPLE


@pytest.fixture(scope="module")
def scene() -> Path:
    return sample_dataset() / "test" / "000001"


@pytest.fixture(scope="module")
def poses(scene: Path) -> np.ndarray:
    truth = json.loads((scene / "scene_gt.json").read_text())
    assert list(truth) == [str(k) for k in range(40)]
    out = np.tile(np.eye(4), (40, 1, 1))
    for k, (one,) in enumerate(truth.values()):
        assert one["obj_id"] == 1
        out[k, :3, :3] = check_rotation(np.array(one["cam_R_m2c"]).reshape(3, 3), f"frame {k}")
        out[k, :3, 3] = one["cam_t_m2c"]
    return out


def test_small_enough_to_ship() -> None:
    assert sum(path.stat().st_size for path in sample_dataset().rglob("*") if path.is_file()) < 4e6


def test_frames(scene: Path) -> None:
    images = sorted((scene / "rgb").iterdir())
    assert [path.name for path in images] == [f"{k:06d}.jpg" for k in range(40)]
    for path in images:
        assert cv2.imread(str(path)).shape == (512, 640, 3)
    cameras = json.loads((scene / "scene_camera.json").read_text())
    assert list(cameras) == [str(k) for k in range(40)]


def test_motion(poses: np.ndarray) -> None:
    turn = [rotation_angle_deg(a[:3, :3], b[:3, :3]) for a, b in pairwise(poses)]
    assert 1.0 <= np.mean(turn) <= 2.0
    assert max(turn) < 2.5


def test_part_is_the_sharp_bracket() -> None:
    part = Part.from_file(sample_dataset() / "models" / "obj_000001.ply")
    made = make_part(SAMPLE.part)
    np.testing.assert_array_equal(part.vertices, made.vertices)
    info = json.loads((sample_dataset() / "models" / "models_info.json").read_text())["1"]
    assert info["diameter"] == pytest.approx(part.diameter, abs=1e-6)
    assert [info[f"size_{a}"] for a in "xyz"] == pytest.approx(list(part.box_size), abs=1e-6)


def test_truth_is_the_recipes(poses: np.ndarray) -> None:
    truth = scene_truth(make_part(SAMPLE.part), SAMPLE.config)
    np.testing.assert_allclose(poses, truth.poses, atol=1e-9)
