"""A data set that a tracker can really track, drawn in a few lines, and its prepared parts."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from acp_lab.cad.part import Part
from acp_lab.geometry.arrays import ByteImage, FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import make_pose, so3_exp, transform
from tests.sequences.tiny_dataset import pose_entry, write_box, write_json

CAMERA = Camera(320, 240, 400.0, 400.0, 159.5, 119.5)
FRAME_IDS = (0, 2, 3, 5, 6)
OBJECT_IDS = (1, 4)
_FACE_GREYS = {(0, -1): 70, (0, 1): 110, (1, -1): 200, (1, 1): 150, (2, -1): 230, (2, 1): 90}


def true_pose(frame_id: int, object_id: int = 1) -> FloatArray:
    """Two boxes side by side, slowly turning."""
    turn = so3_exp(np.array([0.5 + 0.008 * frame_id, 0.4 - 0.01 * frame_id, 0.01 * frame_id]))
    return make_pose(turn, np.array([-35.0 if object_id == 1 else 35.0, 0.3 * frame_id, 260.0]))


def draw(frame_id: int, object_ids: tuple[int, ...] = OBJECT_IDS) -> ByteImage:
    """The boxes of 40 x 30 x 20 mm, every visible face in a grey of its own; (h, w, 3) RGB."""
    # Eight times as large, then averaged: cv2 fills polygons half a pixel beyond their outlines.
    image = np.full((8 * CAMERA.height, 8 * CAMERA.width, 3), 40, np.uint8)
    half = np.array([20.0, 15.0, 10.0])
    for object_id in object_ids:
        pose = true_pose(frame_id, object_id)
        for (axis, sign), grey in _FACE_GREYS.items():
            normal, u, v = (np.eye(3)[(axis + i) % 3] for i in range(3))
            centre = sign * normal * half
            corners = [centre + half * (a * u + b * v) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
            corners_cam = transform(pose, np.array(corners))
            if (pose[:3, :3] @ (sign * normal)) @ corners_cam[0] >= 0.0:
                continue  # seen from behind
            pixels = 8.0 * (CAMERA.project(corners_cam) + 0.5) - 0.5
            cv2.fillConvexPoly(image, np.round(16 * pixels).astype(np.int32), (grey, grey, grey), shift=4)
    return cv2.resize(image, (CAMERA.width, CAMERA.height), interpolation=cv2.INTER_AREA)


def write_dataset(root: Path, scenes: tuple[int, ...] = (1,), object_ids: tuple[int, ...] = OBJECT_IDS) -> Path:
    """The boxes as a BOP data set; ids of images have gaps."""
    (root / "models").mkdir(parents=True)
    box = {"min_x": -20, "min_y": -15, "min_z": -10, "size_x": 40, "size_y": 30, "size_z": 20}
    diameter = float(np.linalg.norm([40, 30, 20]))
    for object_id in object_ids:
        write_box(root / "models" / f"obj_{object_id:06d}.ply")
    write_json(root / "models" / "models_info.json", {str(i): {"diameter": diameter, **box} for i in object_ids})
    for scene_id in scenes:
        folder = root / "test" / f"{scene_id:06d}"
        (folder / "rgb").mkdir(parents=True)
        for frame_id in FRAME_IDS:
            path = folder / "rgb" / f"{frame_id:06d}.png"
            assert cv2.imwrite(str(path), draw(frame_id, object_ids)[..., ::-1])
        matrix = CAMERA.matrix.ravel().tolist()
        write_json(folder / "scene_camera.json", {str(i): {"cam_K": matrix} for i in FRAME_IDS})
        truth = {str(i): [pose_entry(true_pose(i, obj), obj) for obj in object_ids] for i in FRAME_IDS}
        write_json(folder / "scene_gt.json", truth)
    return root


def edit_json(path: Path, change) -> None:  # type: ignore[no-untyped-def]
    """Read a JSON file, let `change` alter it, write it back."""
    values = json.loads(path.read_text())
    change(values)
    path.write_text(json.dumps(values))


@pytest.fixture(scope="session")
def _made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Data set and parts, made once."""
    from acp_lab.preparation import prepare
    from acp_lab.prepared_part import PrepareOptions

    root = tmp_path_factory.mktemp("boxes")
    write_dataset(root / "data")
    for object_id in OBJECT_IDS:
        part = Part.from_file(root / "data" / "models" / f"obj_{object_id:06d}.ply")
        prepare(part, PrepareOptions(generator="templates", fast=True), out=root / "parts")
    return root


@pytest.fixture
def dataset(_made: Path, tmp_path: Path) -> Path:
    """A copy that a test may damage."""
    return Path(shutil.copytree(_made / "data", tmp_path / "data"))


@pytest.fixture
def parts(_made: Path, tmp_path: Path) -> Path:
    """The prepared boxes, a copy."""
    return Path(shutil.copytree(_made / "parts", tmp_path / "parts"))
