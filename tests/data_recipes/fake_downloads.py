"""Small data sets in the layouts of other people, made anew for every test.

`tiny_views` are random pictures of a box that turns, `sample_views` frames of the shipped sample, which can be tracked.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import trimesh

from acp_lab.geometry.pose import inverse, make_pose, so3_exp
from acp_lab.sample import sample_dataset
from acp_lab.sequences import open_sequence

WIDTH, HEIGHT = 64, 48


@dataclass(frozen=True, eq=False)
class Views:
    """Pictures RGB (h, w, 3), K (3, 3) of each, cam_T_obj (4, 4) mm of each, and the mesh in mm."""

    images: Sequence[np.ndarray]
    matrices: Sequence[np.ndarray]
    poses: Sequence[np.ndarray]
    vertices: np.ndarray
    faces: np.ndarray


def tiny_views(count: int = 8, box: tuple[float, float, float] = (60.0, 40.0, 25.0), step_rad: float = 0.06) -> Views:
    """A box that turns about its upright axis; every image has its own principal point."""
    rng = np.random.default_rng(3)
    mesh = trimesh.creation.box(box)
    images = [rng.integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8) for _ in range(count)]
    matrices = [np.array([[80.0, 0, 31.5 + 0.5 * i], [0, 80.0, 23.5], [0, 0, 1]]) for i in range(count)]
    tilt = so3_exp(np.array([0.6, 0.0, 0.0]))
    poses = [
        make_pose(tilt @ so3_exp(np.array([0.0, step_rad * i, 0.0])), np.array([2.0, -1.0, 300.0 + i]))
        for i in range(count)
    ]
    return Views(images, matrices, poses, np.array(mesh.vertices), np.array(mesh.faces))


def sample_views(count: int) -> Views:
    """The first frames of the shipped sample."""
    scene = open_sequence(sample_dataset())
    mesh = trimesh.load(sample_dataset() / "models" / "obj_000001.ply", process=False)
    frames = list(scene.frames(count))
    poses = [scene.truth(frame.index, 1) for frame in frames]
    return Views(
        [frame.image for frame in frames],  # type: ignore[union-attr]
        [frame.camera.matrix for frame in frames],  # type: ignore[union-attr]
        [pose for pose in poses if pose is not None],
        np.array(mesh.vertices), np.array(mesh.faces),
    )  # fmt: skip


def write_image(path: Path, image: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), image[..., ::-1])


def write_text(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


def write_mesh(path: Path, views: Views, scale: float = 1.0) -> None:
    """PLY or OBJ as text with all digits, so that a unit can be changed and changed back."""
    corners = [" ".join(repr(float(scale * v)) for v in row) for row in views.vertices]
    if path.suffix == ".obj":
        faces = ["f " + " ".join(str(i + 1) for i in face) for face in views.faces]
        write_text(path, "\n".join([f"v {corner}" for corner in corners] + faces) + "\n")
        return
    header = ["ply", "format ascii 1.0", f"element vertex {len(corners)}"]
    header += [f"property double {axis}" for axis in "xyz"]
    header += [f"element face {len(views.faces)}", "property list uchar int vertex_indices", "end_header"]
    faces = ["3 " + " ".join(map(str, face)) for face in views.faces]
    write_text(path, "\n".join([*header, *corners, *faces]) + "\n")


BOP_KEYS = ("cam_R_m2c", "cam_t_m2c")


def write_rt_less(
    root: Path, views: Views, object_id: int = 3, metres: bool = True, keys: tuple[str, str] = BOP_KEYS
) -> Path:
    """One scene and one part as RT-Less has them; all images share the first K."""
    scale = 0.001 if metres else 1.0
    write_mesh(root / "CADmodels" / "ply" / f"obj{object_id}.ply", views, scale)
    scene = root / "Testing images(512#512)" / "scene1"
    lines = []
    for number, (image, pose) in enumerate(zip(views.images, views.poses, strict=True), start=1):
        write_image(scene / "rgb" / f"{number}.png", image)
        lines.append(f"'{number}':")
        lines.append(f"- {keys[0]}: {json.dumps(pose[:3, :3].tolist())}")
        lines.append(f"  {keys[1]}: {json.dumps((scale * pose[:3, 3:]).tolist())}")
        lines.append(f"  obj_id: {object_id}")
    write_text(scene / "gt.yml", "\n".join(lines) + "\n")
    write_text(scene / "Intrinsic.yml", f"Intrinsic: {json.dumps(views.matrices[0].tolist())}\n")
    return root


def pose_entry(pose: np.ndarray, object_id: int) -> dict[str, Any]:
    return {"cam_R_m2c": pose[:3, :3].ravel().tolist(), "cam_t_m2c": pose[:3, 3].tolist(), "obj_id": object_id}


def write_t_less(
    root: Path, views: Views, others: Sequence[tuple[int, np.ndarray]] = (), object_id: int = 6, worlds: bool = True
) -> Path:  # fmt: skip
    """One scene as BOP has T-LESS. others: (object id, obj_T_other (4, 4)) that stand beside the object."""
    ids = {object_id, *(other for other, _ in others)}
    low, size = views.vertices.min(0), np.ptp(views.vertices, axis=0)
    diameter = float(np.linalg.norm(views.vertices[:, None] - views.vertices[None], axis=2).max())
    info = {f"min_{a}": float(v) for a, v in zip("xyz", low, strict=True)}
    info |= {f"size_{a}": float(v) for a, v in zip("xyz", size, strict=True)} | {"diameter": diameter}
    for one in ids:
        write_mesh(root / "models_cad" / f"obj_{one:06d}.ply", views)
    write_text(root / "models_cad" / "models_info.json", json.dumps({str(one): info for one in ids}))
    scene = root / "test_primesense" / "000001"
    cameras: dict[str, Any] = {}
    truth, shares = {}, {}
    for number, (image, matrix, pose) in enumerate(zip(views.images, views.matrices, views.poses, strict=True)):
        write_image(scene / "rgb" / f"{number:06d}.png", image)
        cameras[str(number)] = {"cam_K": matrix.ravel().tolist(), "depth_scale": 0.1}
        if worlds:  # the world is the first pose's object frame
            cam_T_world = pose @ inverse(views.poses[0])
            cameras[str(number)] |= {
                "cam_R_w2c": cam_T_world[:3, :3].ravel().tolist(), "cam_t_w2c": cam_T_world[:3, 3].tolist()
            }  # fmt: skip
        truth[str(number)] = [pose_entry(pose, object_id)] + [pose_entry(pose @ at, other) for other, at in others]
        shares[str(number)] = [{"visib_fract": 1.0} for _ in truth[str(number)]]
    for name, content in (("scene_camera", cameras), ("scene_gt", truth), ("scene_gt_info", shares)):
        write_text(scene / f"{name}.json", json.dumps(content))
    return root


def _lines(views: Views) -> list[str]:
    numbers = [[*pose[:3, :3].ravel(), *pose[:3, 3]] for pose in views.poses]
    return ["\t".join(repr(float(value)) for value in row) for row in numbers]


def write_bcot(root: Path, views: Views, body: str = "Lego", sequence: str = "easy_static_trans") -> Path:
    """One body in one sequence as BCOT has it; all images share the first K."""
    write_mesh(root / "models" / f"{body}.obj", views)
    for number, image in enumerate(views.images):
        write_image(root / sequence / body / f"{number:04d}.png", image)
    write_text(root / sequence / body / "pose.txt", "\t\n".join(_lines(views)) + "\t\n")
    inside = ", ".join(repr(float(value)) for value in views.matrices[0].ravel())
    write_text(root / sequence / "K.txt", f"Matx33f K = Matx33f({inside});\n")
    return root


def write_rbot(root: Path, views: Views, body: str = "cat", sequence: str = "a_regular") -> Path:
    """One body in one sequence as RBOT has it; all images share the first K."""
    write_mesh(root / body / f"{body}.obj", views)
    for number, image in enumerate(views.images):
        write_image(root / body / "frames" / f"{sequence}{number:04d}.png", image)
    write_text(root / "poses_first.txt", "r00\tr01\t…\tt2\n" + "\n".join(_lines(views)) + "\n")
    k = views.matrices[0]
    values = (k[0, 0], k[1, 1], k[0, 2] + 0.5, k[1, 2] + 0.5, 0.0, 0.0)
    line = "\t".join(repr(float(value)) for value in values)
    write_text(root / "camera_calibration.txt", f"fx fy cx cy k1 k2\n{line}\n")
    return root
