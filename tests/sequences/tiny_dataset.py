"""A data set in the BOP layout, small enough to be written anew for every test."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import make_pose, so3_exp

WIDTH, HEIGHT = 64, 48
K = [80.0, 0.0, 31.5, 0.0, 81.0, 23.5, 0.0, 0.0, 1.0]
DIAMETER = float(np.sqrt(40.0**2 + 30.0**2 + 20.0**2))

_CORNERS = np.array([[x, y, z] for x in (-20, 20) for y in (-15, 15) for z in (-10, 10)], dtype=np.float64)
_FACES = [
    (0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1),
    (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3),
]  # fmt: skip


def pose(frame_id: int, object_id: int = 1) -> FloatArray:
    """A different true pose for every frame and object."""
    rotation = so3_exp(np.array([0.1, 0.05 * frame_id, 0.2 * object_id]))
    return make_pose(rotation, np.array([object_id, frame_id, 400.0]))


def pose_entry(cam_T_obj: FloatArray, object_id: int = 1) -> dict[str, Any]:
    """A pose as scene_gt.json writes it."""
    return {
        "cam_R_m2c": cam_T_obj[:3, :3].ravel().tolist(),
        "cam_t_m2c": cam_T_obj[:3, 3].tolist(),
        "obj_id": object_id,
    }


def write_image(path: Path, value: int = 0, width: int = WIDTH, height: int = HEIGHT) -> None:
    """An RGB image whose left half is red, with a grey level of `value` elsewhere."""
    image = np.full((height, width, 3), value % 256, np.uint8)
    image[:, : width // 2] = (200, 0, 0)
    assert cv2.imwrite(str(path), image[..., ::-1])


def write_json(path: Path, values: Any) -> None:
    path.write_text(json.dumps(values), encoding="utf-8")


def write_box(path: Path) -> None:
    """A box of 40 x 30 x 20 mm as ASCII PLY."""
    header = ["ply", "format ascii 1.0", "element vertex 8"]
    header += [f"property float {axis}" for axis in "xyz"]
    header += ["element face 12", "property list uchar int vertex_indices", "end_header"]
    vertices = [" ".join(f"{value:g}" for value in corner) for corner in _CORNERS]
    faces = ["3 " + " ".join(str(i) for i in face) for face in _FACES]
    path.write_text("\n".join([*header, *vertices, *faces]) + "\n")


def write_scene(
    folder: Path,
    frame_ids: tuple[int, ...] = (0, 1, 2),
    object_ids: tuple[int, ...] = (1,),
    suffix: str = ".png",
) -> Path:
    """A scene with images, cameras and truth; the images get brighter from frame to frame."""
    (folder / "rgb").mkdir(parents=True)
    for frame_id in frame_ids:
        write_image(folder / "rgb" / f"{frame_id:06d}{suffix}", 10 * frame_id)
    write_json(folder / "scene_camera.json", {str(i): {"cam_K": K, "depth_scale": 1.0} for i in frame_ids})
    truth = {str(i): [pose_entry(pose(i, obj), obj) for obj in object_ids] for i in frame_ids}
    write_json(folder / "scene_gt.json", truth)
    return folder


def write_models(root: Path, infos: Mapping[int, Mapping[str, Any]]) -> None:
    """Box meshes for the object ids, and models_info.json with the given extra keys."""
    (root / "models").mkdir(parents=True, exist_ok=True)
    box = {"min_x": -20, "min_y": -15, "min_z": -10, "size_x": 40, "size_y": 30, "size_z": 20}
    for object_id in infos:
        write_box(root / "models" / f"obj_{object_id:06d}.ply")
    entries = {str(i): {"diameter": DIAMETER, **box, **extra} for i, extra in infos.items()}
    write_json(root / "models" / "models_info.json", entries)


def write_dataset(
    root: Path, frame_ids: tuple[int, ...] = (0, 1, 2), object_ids: tuple[int, ...] = (1,)
) -> Path:
    """One scene, test/000001, and the models of its objects."""
    write_models(root, {object_id: {} for object_id in object_ids})
    write_scene(root / "test" / "000001", frame_ids, object_ids)
    return root
