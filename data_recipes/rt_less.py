"""RT-Less (reflective texture-less metal parts), as its authors distribute it, into the BOP layout.

    python -m data_recipes.rt_less CADmodels.zip "Testing images(512#512).zip" --group 1 --out DATASET

What is looked for, at any depth of the sources:

    ply/obj1.ply …            CAD models, in metres or mm (guessed from their size)
    scene1/gt.yml             per image number a list of poses: cam_R_m2c, cam_t_m2c (or m2c_R, m2c_T), obj_id
    scene1/Intrinsic.yml      Intrinsic: the camera matrix, 3 x 3
    scene1/rgb/1.png …        images, named by their numbers

Poses are in metres or mm, guessed from the distances. Each part of each scene becomes a sequence of its own, its images
ordered by nearest pose. Parts 1, 2, 5, 14, 17, 18, 24, 26, 29 and 33 are symmetric: their symmetries
are found from the mesh and written to models_info.json, so that they are scored with ADD-S.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from acp_lab.errors import GeometryError, InputFileError, SequenceError
from acp_lab.geometry.pose import check_rotation, make_pose
from acp_lab.input_file import LARGEST_NUMBER
from acp_lab.sequences.image_file import IMAGE_SUFFIXES, read_rgb
from acp_lab.sequences.json_file import shown
from acp_lab.sequences.scene_truth import as_id
from data_recipes.archives import Source
from data_recipes.bop_writer import Model
from data_recipes.command import Parser, note, run
from data_recipes.convert import (
    Found,
    add_arguments,
    add_ordering_arguments,
    asked_objects,
    camera_of,
    convert,
    wanted,
)
from data_recipes.meshes import load_mesh, model_of
from data_recipes.symmetries import find_symmetry
from data_recipes.tracks import Track, View

PAGE = "http://www.zju-rtl.cn/RTL/ (CAD models and testing images)"
GROUPS = {1: (1, 2), 2: (3, 4, 6), 3: (15, 17, 34), 4: (13, 14, 18)}
"""The paper's four groups, of increasing complexity (its experiments, "Dataset")."""
SYMMETRIC = frozenset((1, 2, 5, 14, 17, 18, 24, 26, 29, 33))
"""Parts that the authors' own evaluation scores with ADD-S."""
_ROTATION_KEYS, _TRANSLATION_KEYS = ("cam_R_m2c", "m2c_R"), ("cam_t_m2c", "m2c_T")
_METRES_BELOW = 10.0
"""Median distance: nobody photographs a part from 10 mm."""


def find(source: Source, args: argparse.Namespace) -> Found:
    """Models and tracks of the scenes and objects asked for."""
    objects = asked_objects(args, GROUPS)
    meshes = _meshes(source)
    scenes = _scenes(source)
    chosen = wanted(args.scenes, sorted(scenes), "scene", source.name)
    tracks: list[Track] = []
    for scene_id in chosen:
        tracks += _tracks(scenes[scene_id], scene_id, objects)
    shown_ids = sorted({track.object_id for track in tracks})
    if not shown_ids:
        raise SequenceError(f"{source.name}: none of its {len(chosen)} scenes shows one of the objects asked for")
    return Found({i: _model(i, meshes) for i in shown_ids}, tracks)


def _meshes(source: Source) -> dict[int, Path]:
    found = {
        int("".join(filter(str.isdigit, path.stem))): path
        for path in source.files(r"(obj_?)?\d+\.ply")
        if path.parent.name.lower() in ("ply", "models")
    }
    if not found:
        raise InputFileError(f"{source.name}: no CAD models (ply/obj1.ply): give the CAD models' download too")
    return found


def _model(object_id: int, meshes: dict[int, Path]) -> Model:
    if object_id not in meshes:
        listed = ", ".join(map(str, sorted(meshes)))
        raise InputFileError(f"no CAD model of object {object_id}: there are {listed}: download the CAD models again")
    mesh = load_mesh(meshes[object_id])
    if object_id not in SYMMETRIC:
        return model_of(mesh)
    symmetry = find_symmetry(mesh.part)
    if symmetry:
        return model_of(mesh, **symmetry.as_info())
    # The authors call some parts partially symmetric: nearly the same after half a turn.
    note(
        f"object {object_id} is symmetric to within {100 * symmetry.best_error:.1f}% of its diameter: "
        "the best half turn is used"
    )
    turn = [float(v) for v in symmetry.best_half_turn.ravel()]
    return model_of(mesh, symmetries_discrete=[turn])


def _scenes(source: Source) -> dict[int, Path]:
    folders = [path.parent for path in source.files(r"gt\.yml")]
    scenes: dict[int, Path] = {}
    for folder in folders:
        digits = "".join(filter(str.isdigit, folder.name))
        if folder.name.lower().startswith("obj") or not digits:
            continue  # the training images: one part on a turntable each
        other = scenes.setdefault(int(digits), folder)
        if other != folder:
            raise InputFileError(f"{source.name}: scene {int(digits)} is in {other} and {folder}: give one of them")
    if not scenes:
        raise InputFileError(f"{source.name}: no scenes (scene1/gt.yml): give the testing images' download too")
    return scenes


def _tracks(folder: Path, scene_id: int, objects: Sequence[int] | None) -> list[Track]:
    poses = _poses(folder / "gt.yml", objects)
    if not poses:
        return []
    images = _images(folder / "rgb")
    height, width = read_rgb(next(iter(images.values()))).shape[:2]
    camera = camera_of(_intrinsics(folder / "Intrinsic.yml"), width, height, str(folder / "Intrinsic.yml"))
    scale = _millimetres(np.array([pose[:3, 3] for of in poses.values() for pose in of.values()]))
    tracks = []
    for object_id, of in sorted(poses.items()):
        views = []
        for image_id, pose in sorted(of.items()):
            if image_id not in images:
                raise InputFileError(f"{folder / 'rgb'}: image {image_id} is missing: unpack or download it again")
            cam_T_obj = make_pose(pose[:3, :3], scale * pose[:3, 3])
            views.append(View(image_id, images[image_id], camera, cam_T_obj))
        tracks.append(Track(f"scene {scene_id}, object {object_id}", object_id, tuple(views)))
    return tracks


def _poses(path: Path, objects: Sequence[int] | None) -> dict[int, dict[int, np.ndarray]]:
    """cam_T_obj (4, 4), in the file's unit, by object and image id."""
    poses: dict[int, dict[int, np.ndarray]] = {}
    for key, entries in _read_yaml(path).items():
        image_id = as_id(key, f"{path}: the image number")
        if not isinstance(entries, list):
            raise InputFileError(f"{path}: image {image_id} has no list of poses: download it again")
        for entry in entries:
            where = f"{path}: image {image_id}"
            if not isinstance(entry, dict) or "obj_id" not in entry:
                raise InputFileError(f"{where} has a pose without obj_id: download it again")
            object_id = as_id(entry["obj_id"], f"{where}: obj_id")
            if objects is not None and object_id not in objects:
                continue
            where = f"{where}, object {object_id}"
            rotation = _numbers(_either(entry, _ROTATION_KEYS, where), 9, f"{where}: rotation").reshape(3, 3)
            translation = _numbers(_either(entry, _TRANSLATION_KEYS, where), 3, f"{where}: translation")
            if image_id in poses.setdefault(object_id, {}):
                raise InputFileError(f"{where}: is there twice, nothing says which is meant: leave it out by --objects")
            try:
                poses[object_id][image_id] = make_pose(check_rotation(rotation, where), translation)
            except GeometryError as error:
                raise InputFileError(str(error)) from None
    return poses


def _intrinsics(path: Path) -> np.ndarray:
    content = _read_yaml(path)
    if "Intrinsic" not in content:
        raise InputFileError(f"{path}: has no entry Intrinsic: download it again")
    return _numbers(content["Intrinsic"], 9, f"{path}: Intrinsic").reshape(3, 3)


def _images(folder: Path) -> dict[int, Path]:
    if not folder.is_dir():
        raise InputFileError(f"{folder}: no such folder: it holds the images: unpack or download it again")
    found = {
        int(path.stem): path
        for path in folder.iterdir()
        if path.suffix.lower() in IMAGE_SUFFIXES and path.stem.isascii() and path.stem.isdigit()
    }
    if not found:
        raise InputFileError(f"{folder}: holds no images named by number: unpack or download it again")
    return dict(sorted(found.items()))


def _millimetres(translations: np.ndarray) -> float:
    """What turns translations (n, 3) into mm."""
    return 1000.0 if float(np.median(np.abs(translations[:, 2]))) < _METRES_BELOW else 1.0


def _read_yaml(path: Path) -> dict[Any, Any]:
    import yaml

    try:
        # The C parser, where PyYAML has it: these files have tens of thousands of lines.
        content = yaml.load(path.read_bytes(), Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))
    except FileNotFoundError:
        raise InputFileError(f"{path}: no such file: unpack or download it again") from None
    except (yaml.YAMLError, ValueError) as error:
        reason = " ".join(str(error).split())[:100]
        raise InputFileError(f"{path}: not valid YAML ({reason}): unpack or download it again") from None
    if not isinstance(content, dict):
        raise InputFileError(f"{path}: is empty or cut short: unpack or download it again")
    return content


def _either(entry: dict[str, Any], keys: tuple[str, ...], where: str) -> object:
    for key in keys:
        if key in entry:
            return entry[key]
    raise InputFileError(f"{where}: has neither {' nor '.join(keys)}: download it again")


def _numbers(values: object, size: int, where: str) -> np.ndarray:
    """(size,) finite numbers of a list, nested or not."""
    try:
        found = np.asarray(values, dtype=np.float64).ravel()
    except (TypeError, ValueError):
        found = np.zeros(0)
    if found.size != size or not (np.abs(found) <= LARGEST_NUMBER).all():
        raise InputFileError(f"{where} is {shown(values)}: must be {size} finite numbers: download it again")
    return found


def build_parser() -> Parser:
    """The command's options."""
    parser = Parser(prog="python -m data_recipes.rt_less", description=__doc__.split("\n\n")[0])  # type: ignore[union-attr]
    add_arguments(parser, PAGE)
    add_ordering_arguments(parser, GROUPS)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    return run(lambda args: convert(args, find), build_parser(), argv)


if __name__ == "__main__":
    sys.exit(main())
