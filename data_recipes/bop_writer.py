"""Writing a data set in the BOP layout, all or nothing.

Everything goes into a temporary folder beside the target, which takes the target's name when the last file is
written; an interrupted recipe leaves no partial data set. Convention: BOP's `cam_R_m2c` (row by row) and
`cam_t_m2c` (mm) take model to camera coordinates, OpenCV axes, pixel (0, 0) = centre of the top-left pixel.
Source: BOP toolkit, docs/bop_datasets_format.md.
"""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
import trimesh

from acp_lab.errors import InputFileError
from data_recipes.command import warn

JPEG_QUALITY = 91
TOP_LEVEL = ("models", "test", "CAMERA.json", "POSE.json", "POSES.csv")
"""All that recipes write into the folder of a data set."""


@dataclass(frozen=True, eq=False)
class Model:
    """One object: vertices (n, 3) mm, faces (m, 3), diameter mm, and more entries of models_info.json."""

    vertices: np.ndarray
    faces: np.ndarray
    diameter: float
    extra: Mapping[str, object] = field(default_factory=dict)


def check_out(out: Path, force: bool) -> None:
    """InputFileError where a data set cannot become `out`: to be asked before anything is made that takes long.

    Without `force` nothing may be there. With it `out` may be an empty folder or an old data set: a real folder, not
    the working directory, that holds nothing but TOP_LEVEL.
    """
    if not os.path.lexists(out):
        return
    if not force:
        raise InputFileError(f"{out} exists; give another --out, or --force to replace it")
    fix = "--force replaces a data set only: give another --out"
    if out.is_symlink() or not out.is_dir():
        raise InputFileError(f"{out}: is {'a link' if out.is_symlink() else 'no folder'}: {fix}")
    if out.resolve() in (Path.cwd(), *Path.cwd().parents) or os.path.ismount(out):
        raise InputFileError(f"{out}: is or holds the working directory, or is a disk of its own: {fix}")
    for path in sorted(out.iterdir()):
        if path.name not in TOP_LEVEL:
            raise InputFileError(f"{path.parent}: holds {path.name}, which no recipe writes: {fix}")


@contextmanager
def new_dataset(out: Path, force: bool) -> Iterator[Path]:
    """A temporary folder that becomes `out` at the end, and vanishes when anything fails.

    With `force` the old one is replaced only when the new one is complete. Raises InputFileError as `check_out`.
    """
    check_out(out, force)
    out.parent.mkdir(parents=True, exist_ok=True)
    work = Path(tempfile.mkdtemp(prefix=f".{out.name}.", dir=out.parent))
    work.chmod(0o755)
    # Not hidden: should the program be killed in between, it is found.
    old = out.with_name(f"{work.name.removeprefix('.')}.old")
    try:
        yield work
        if force and out.exists():
            os.replace(out, old)
        try:
            os.replace(work, out)
        except BaseException:
            if old.exists():
                os.replace(old, out)
            raise
        _remove_old(old)
    finally:
        shutil.rmtree(work, ignore_errors=True)


def _remove_old(old: Path) -> None:
    """Remove an old data set, if there is one. What came into it meanwhile stays; what cannot be removed is told."""
    for name in TOP_LEVEL:
        if (old / name).is_dir() and not (old / name).is_symlink():
            shutil.rmtree(old / name, ignore_errors=True)
        else:
            with suppress(OSError):
                (old / name).unlink()
    with suppress(OSError):
        old.rmdir()
    if old.exists():
        warn(f"{old}: what is left of the old data set cannot be removed: remove it yourself")


def write_models(root: Path, models: Mapping[int, Model]) -> None:
    """`models/obj_00000N.ply` and `models_info.json` of models by object id."""
    folder = root / "models"
    folder.mkdir()
    info: dict[str, dict[str, object]] = {}
    for object_id, model in sorted(models.items()):
        mesh = trimesh.Trimesh(model.vertices, model.faces, process=False)
        mesh.export(folder / f"obj_{object_id:06d}.ply", vertex_normal=False)
        low, size = model.vertices.min(0), np.ptp(model.vertices, axis=0)
        box = {f"min_{a}": float(v) for a, v in zip("xyz", low, strict=True)}
        box |= {f"size_{a}": float(v) for a, v in zip("xyz", size, strict=True)}
        info[str(object_id)] = {"diameter": model.diameter, **model.extra, **box}
    write_json(folder / "models_info.json", info)


def write_image(path: Path, image: np.ndarray) -> None:
    """RGB uint8 (h, w, 3) to PNG or JPEG, by the suffix."""
    options = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY] if path.suffix == ".jpg" else [cv2.IMWRITE_PNG_COMPRESSION, 6]
    if not cv2.imwrite(str(path), image[..., ::-1], options):
        raise InputFileError(f"{path} cannot be written; check the disk")


def write_scene(
    folder: Path,
    matrices: Mapping[int, np.ndarray],
    object_id: int,
    cam_T_obj: Mapping[int, np.ndarray],
    seen: Mapping[int, Mapping[str, object]] | None = None,
) -> None:
    """`scene_camera.json` and `scene_gt.json`, and `scene_gt_info.json` where it is known.

    All by frame id; gaps in the ids tell where frames were left out. matrices: K (3, 3) of each frame. cam_T_obj: poses
    (4, 4) of the frames whose truth is known. seen: see `visibility`.
    """
    cameras = {str(i): {"cam_K": _listed(k), "depth_scale": 1.0} for i, k in matrices.items()}
    write_json(folder / "scene_camera.json", cameras)
    truth = {str(i): [pose_entry(pose, object_id)] for i, pose in cam_T_obj.items()}
    if truth:
        write_json(folder / "scene_gt.json", truth)
    if seen is not None:
        write_json(folder / "scene_gt_info.json", {str(i): [dict(one)] for i, one in seen.items()})


def pose_entry(cam_T_obj: np.ndarray, object_id: int) -> dict[str, object]:
    """An entry of scene_gt.json: a pose (4, 4) of an object."""
    return {"cam_R_m2c": _listed(cam_T_obj[:3, :3]), "cam_t_m2c": _listed(cam_T_obj[:3, 3]), "obj_id": object_id}


def visibility(alone: np.ndarray, seen: np.ndarray) -> dict[str, object]:
    """BOP's gt_info entry from two masks (h, w): the part without occluders, and the part as seen."""
    all_, visible = int(alone.sum()), int(seen.sum())
    return {
        "px_count_all": all_,
        "px_count_visib": visible,
        "visib_fract": round(visible / all_, 6) if all_ else 0.0,
        "bbox_obj": _bounds(alone),
        "bbox_visib": _bounds(seen),
    }


def write_json(path: Path, content: object) -> None:
    """JSON with a line per top-level entry, readable and small. NaN and infinity, which are none, raise ValueError."""
    if isinstance(content, dict):
        lines = [f"{json.dumps(key)}: {json.dumps(value, allow_nan=False)}" for key, value in content.items()]
        path.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")
    else:
        path.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def _listed(values: np.ndarray) -> list[float]:
    return [float(value) for value in np.asarray(values).ravel()]


def _bounds(mask: np.ndarray) -> list[int]:
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    if len(rows) == 0:
        return [-1, -1, -1, -1]
    x, y = int(columns[0]), int(rows[0])
    return [x, y, int(columns[-1]) - x + 1, int(rows[-1]) - y + 1]
