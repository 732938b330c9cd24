"""T-LESS, and any other data set in the BOP layout: checked, reduced to some objects, ordered into sequences.

    python -m data_recipes.t_less tless_base.zip tless_models.zip tless_test_primesense_all.zip --group 1 --out DATASET

What is looked for, at any depth of the sources:

    models_cad/obj_000001.ply …, models_info.json     mm; or models/, or what --models names
    test_primesense/000001/scene_gt.json, scene_camera.json, rgb/ or gray/; scene_gt_info.json where there is one

Each part of each scene becomes a sequence of its own. The same object several times in a scene is told apart by where
it stands in the world (cam_R_w2c, cam_t_w2c in scene_camera.json), which needs a scene in which nothing moves; without
world poses such objects are left out. Intrinsics are those of each image: T-LESS crops its pictures, so the principal
point differs from one to the next.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from acp_lab.cad.part import Part, read_models_info
from acp_lab.errors import GeometryError, InputFileError, SequenceError
from acp_lab.geometry.pose import check_rotation, inverse, make_pose, rotation_angle_deg
from acp_lab.sequences.bop import image_files
from acp_lab.sequences.image_file import read_rgb
from acp_lab.sequences.json_file import numbers, pose_of, read_json_object
from acp_lab.sequences.pixel_coding import PixelCoding
from acp_lab.sequences.scene_truth import as_id
from data_recipes.archives import Source
from data_recipes.bop_writer import Model
from data_recipes.command import Parser, note, run, share
from data_recipes.convert import (
    Found,
    add_arguments,
    add_ordering_arguments,
    asked_objects,
    camera_of,
    convert,
    wanted,
)
from data_recipes.tracks import Track, View

PAGE = "https://bop.felk.cvut.cz/datasets/ (base archive, object models and test images)"
GROUPS = {1: (6, 7, 9), 2: (20, 23, 26)}
"""The paper's two groups of T-LESS objects."""
MODEL_FOLDERS = ("models_cad", "models")
_SAME_PLACE_MM, _SAME_PLACE_DEG = 20.0, 15.0
"""Two poses in the world that are nearer than that are one instance of a part that stands still."""
_AGAIN = "unpack or download it again"


@dataclass(frozen=True, eq=False)
class Seen:
    """One instance of an object in one image: poses (4, 4) mm; world_T_obj None when the world is not told."""

    image_id: int
    cam_T_obj: np.ndarray
    world_T_obj: np.ndarray | None
    visible: float


def find(source: Source, args: argparse.Namespace) -> Found:
    """Models and tracks of the scenes and objects asked for."""
    objects = asked_objects(args, GROUPS)
    scenes = _scenes(source, args.split)
    tracks: list[Track] = []
    for scene_id in wanted(args.scenes, sorted(scenes), "scene", source.name):
        tracks += _tracks(scenes[scene_id], scene_id, objects, args.min_visible)
    ids = sorted({track.object_id for track in tracks})
    if not ids:
        raise SequenceError(f"{source.name}: no scene shows one of the objects asked for: ask for others")
    return Found(_models(source, args.models, ids), tracks)


def _models(source: Source, folder: str | None, ids: Sequence[int]) -> dict[int, Model]:
    infos = source.files(r"models_info\.json")
    names = (folder,) if folder else MODEL_FOLDERS
    found = [path for name in names for path in infos if path.parent.name == name]
    if not found:
        there = ", ".join(sorted({path.parent.name for path in infos}))
        raise InputFileError(
            f"{source.name}: no {' or '.join(names)} with models_info.json (found: {there or 'none'}): give the object "
            "models' download too, or --models"
        )
    parts = read_models_info(found[0])
    entries = _entries(found[0])
    models = {}
    for object_id in ids:
        path = found[0].parent / f"obj_{object_id:06d}.ply"
        if object_id not in parts:
            raise InputFileError(f"{found[0]}: no object {object_id}: {_AGAIN}")
        part = Part.from_file(path, parts[object_id])
        extra = {key: value for key, value in entries[object_id].items() if key.startswith("symmetries_")}
        models[object_id] = Model(part.vertices, part.faces, part.diameter, extra)
    return models


def _scenes(source: Source, split: str | None) -> dict[int, Path]:
    """Scene folders by id, of one split."""
    folders = [path.parent for path in source.files(r"scene_gt\.json") if path.parent.name.isdigit()]
    if not folders:
        raise InputFileError(f"{source.name}: no scene with scene_gt.json: give the images' download too")
    splits = sorted({folder.parent.name for folder in folders})
    chosen = [name for name in splits if name == split or (split is None and name.startswith("test"))]
    if len(chosen) != 1:
        listed = ", ".join(splits) or "none"
        raise InputFileError(f"{source.name}: has the splits {listed}: name one of them with --split")
    scenes: dict[int, Path] = {}
    for folder in folders:
        if folder.parent.name == chosen[0] and scenes.setdefault(int(folder.name), folder) != folder:
            raise InputFileError(f"{source.name}: holds {scenes[int(folder.name)]} and {folder}: give one of them")
    return scenes


def _tracks(folder: Path, scene_id: int, objects: Sequence[int] | None, min_visible: float) -> list[Track]:
    cameras = _entries(folder / "scene_camera.json")
    seen = _seen(folder, cameras, objects)
    if not seen:
        return []
    images = image_files(folder)
    first = next(iter(images.values()))
    height, width = read_rgb(first, PixelCoding.beside(first.parent)).shape[:2]
    tracks = []
    absent = {one.image_id for all_of in seen.values() for one in all_of} - set(images)
    if absent:
        note(f"{first.parent}: {len(absent)} of the images listed in scene_gt.json are missing")
    for object_id, all_of in sorted(seen.items()):
        instances = told_apart(all_of)
        if not instances:
            note(f"scene {scene_id}: object {object_id} is there more than once; world poses would tell which is which")
        for number, instance in enumerate(instances, start=1):
            views = []
            for one in instance:
                if one.visible < min_visible or one.image_id in absent:
                    continue
                where = f"{folder / 'scene_camera.json'}: image {one.image_id}"
                matrix = numbers(cameras[one.image_id].get("cam_K"), 9, f"{where}: cam_K").reshape(3, 3)
                camera = camera_of(matrix, width, height, where)
                views.append(View(one.image_id, images[one.image_id], camera, one.cam_T_obj))
            which = f" ({number})" if len(instances) > 1 else ""
            tracks.append(Track(f"scene {scene_id}, object {object_id}{which}", object_id, tuple(views)))
    return tracks


def _seen(folder: Path, cameras: Mapping[int, Any], objects: Sequence[int] | None) -> dict[int, list[Seen]]:
    """What scene_gt.json says, by object, image ids rising."""
    path = folder / "scene_gt.json"
    visible = _visible_shares(folder / "scene_gt_info.json")
    seen: dict[int, list[Seen]] = {}
    for image_id, entries in sorted(_entries(path).items()):
        if image_id not in cameras:
            raise InputFileError(f"{folder / 'scene_camera.json'}: image {image_id} is missing: {_AGAIN}")
        cam_T_world = _world(cameras[image_id], f"{folder / 'scene_camera.json'}: image {image_id}")
        if not isinstance(entries, list):
            raise InputFileError(f"{path}: image {image_id} has no list of poses: {_AGAIN}")
        for place, entry in enumerate(entries):
            where = f"{path}: image {image_id}"
            if not isinstance(entry, dict) or "obj_id" not in entry:
                raise InputFileError(f"{where} has a pose without obj_id: {_AGAIN}")
            object_id = as_id(entry["obj_id"], f"{where}: obj_id")
            if objects is not None and object_id not in objects:
                continue
            pose = pose_of(entry, f"{where}, object {object_id}")
            in_world = None if cam_T_world is None else inverse(cam_T_world) @ pose
            share_seen = visible.get((image_id, place), 1.0)
            seen.setdefault(object_id, []).append(Seen(image_id, pose, in_world, share_seen))
    return seen


def told_apart(seen: Sequence[Seen]) -> list[list[Seen]]:
    """The instances of one object, each with what was seen of it; none when they cannot be told apart."""
    images = [one.image_id for one in seen]
    if len(set(images)) == len(images):
        return [list(seen)]
    instances: list[list[Seen]] = []
    for one in seen:
        if one.world_T_obj is None:
            return []
        for instance in instances:
            if _same_place(instance[0].world_T_obj, one.world_T_obj):
                instance.append(one)
                break
        else:
            instances.append([one])
    still = all(len({one.image_id for one in instance}) == len(instance) for instance in instances)
    return instances if still else []


def _same_place(first: np.ndarray | None, second: np.ndarray | None) -> bool:
    if first is None or second is None:
        return False
    near = float(np.linalg.norm(first[:3, 3] - second[:3, 3])) < _SAME_PLACE_MM
    return near and rotation_angle_deg(first[:3, :3], second[:3, :3]) < _SAME_PLACE_DEG


def _world(camera: Any, where: str) -> np.ndarray | None:
    """cam_T_world (4, 4), None when it is not told."""
    if not isinstance(camera, dict):
        raise InputFileError(f"{where}: is no camera: {_AGAIN}")
    if "cam_R_w2c" not in camera or "cam_t_w2c" not in camera:
        return None
    rotation = numbers(camera["cam_R_w2c"], 9, f"{where}: cam_R_w2c").reshape(3, 3)
    translation = numbers(camera["cam_t_w2c"], 3, f"{where}: cam_t_w2c")
    try:
        return make_pose(check_rotation(rotation, f"{where}: cam_R_w2c"), translation)
    except GeometryError as error:
        raise InputFileError(str(error)) from None


def _visible_shares(path: Path) -> dict[tuple[int, int], float]:
    """Visible share by image id and place in the list; empty without the file, which not all data sets have."""
    if not path.exists():
        return {}
    shares = {}
    for image_id, entries in _entries(path).items():
        for place, entry in enumerate(entries if isinstance(entries, list) else ()):
            value = entry.get("visib_fract") if isinstance(entry, dict) else None
            if isinstance(value, int | float):
                shares[image_id, place] = float(value)
    return shares


def _entries(path: Path) -> dict[int, Any]:
    content = read_json_object(path, _AGAIN)
    return {as_id(key, f"{path}: the image id"): value for key, value in content.items()}


def build_parser() -> Parser:
    """The command's options."""
    parser = Parser(prog="python -m data_recipes.t_less", description=__doc__.split("\n\n")[0])  # type: ignore[union-attr]
    add_arguments(parser, PAGE)
    add_ordering_arguments(parser, GROUPS)
    parser.add_argument("--split", help="the folder of scenes (the only one whose name begins with test)")
    parser.add_argument("--models", help=f"the folder of models ({' or '.join(MODEL_FOLDERS)})")
    parser.add_argument(
        "--min-visible", type=share, default=0.3, help="leave out images that show less of the part (0.3)"
    )
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    return run(lambda args: convert(args, find), build_parser(), argv)


if __name__ == "__main__":
    sys.exit(main())
