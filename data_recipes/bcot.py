"""BCOT, the benchmark of real videos of 20 objects, as its authors distribute it, into the BOP layout.

    python -m data_recipes.bcot BCOT_dataset --bodies Cat,Lego --sequences easy_static_suspension --out DATASET

What is looked for, at any depth of the sources:

    models/Cat.obj                            mm
    easy_static_suspension/K.txt              the camera matrix: nine numbers, or a line of C++ that holds them
    easy_static_suspension/Cat/pose.txt       a line per image: nine numbers of R row by row, three of t in mm
    easy_static_suspension/Cat/0000.png …     row i of pose.txt belongs to the image of number i
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from acp_lab.errors import InputFileError, SequenceError
from acp_lab.sequences.image_file import read_rgb
from data_recipes.archives import Source
from data_recipes.command import Parser, names, names_of, note, run
from data_recipes.convert import Found, add_arguments, camera_of, convert
from data_recipes.meshes import load_mesh, model_of
from data_recipes.text_poses import read_poses
from data_recipes.tracks import Track, View

PAGE = "https://ar3dv.github.io/BCOT-Benchmark/"
BODIES = (
    "3D Touch", "Ape", "Auto GPS", "Bracket", "Cat", "Deadpool", "Driller", "FlashLight", "Jack", "Lamp Clamp", "Lego",
    "RJ45 Clip", "RTI Arm", "Squirrel", "Standtube", "Stitch", "Teapot", "Tube", "Vampire Queen", "Wall Shelf",
)  # fmt: skip
"""Object ids count from 1 in this order."""
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"


def find(source: Source, args: argparse.Namespace) -> Found:
    """Models and tracks of the bodies and sequences asked for."""
    scenes: dict[str, Path] = {}
    for folder in (path.parent for path in source.files(r"K\.txt")):
        other = scenes.setdefault(folder.name, folder)
        if other != folder:
            raise InputFileError(f"{source.name}: sequence {folder.name} is in {other} and {folder}: give one of them")
    if not scenes:
        raise InputFileError(f"{source.name}: no sequences (easy_static_suspension/K.txt): give the whole data set")
    chosen = tuple(dict.fromkeys(args.sequences or scenes))
    for name in chosen:
        if name not in scenes:
            raise SequenceError(f"{source.name}: no sequence {name}: there are {', '.join(scenes)}")
    tracks = []
    for name in chosen:
        matrix = _matrix(scenes[name] / "K.txt")
        for body in dict.fromkeys(args.bodies or BODIES):
            if (scenes[name] / body).is_dir():  # not every body is in every sequence
                tracks.append(_track(scenes[name] / body, matrix, name, body))
            elif args.bodies:
                note(f"{scenes[name]}: has no {body}: left out")
    if not tracks:
        raise SequenceError(f"{source.name}: none of the bodies asked for is in the sequences asked for")
    meshes = {path.stem: path for path in source.files(r".+\.obj") if path.parent.name == "models"}
    models = {}
    for object_id in sorted({track.object_id for track in tracks}):
        body = BODIES[object_id - 1]
        if body not in meshes:
            raise InputFileError(f"{source.name}: no models/{body}.obj: give the models' download too")
        models[object_id] = model_of(load_mesh(meshes[body], "mm"))
    return Found(models, tracks)


def _track(folder: Path, matrix: np.ndarray, sequence: str, body: str) -> Track:
    poses = read_poses(folder / "pose.txt")
    images = {int(path.stem): path for path in folder.glob("*.png") if path.stem.isascii() and path.stem.isdigit()}
    if not images:
        raise InputFileError(f"{folder}: holds no images (0000.png): unpack or download it again")
    first, last = min(images), max(images)
    missing = next((number for number in range(first, last + 1) if number not in images), None)
    if missing is not None:
        raise InputFileError(f"{folder / f'{missing:04d}.png'}: no such image: unpack or download it again")
    if last >= len(poses):
        raise InputFileError(f"{folder / 'pose.txt'}: has {len(poses)} lines for image {last}: download it again")
    if len(images) < len(poses):
        note(f"{folder}: has {len(images)} images, but pose.txt {len(poses)} lines")
    height, width = read_rgb(images[first]).shape[:2]
    camera = camera_of(matrix, width, height, str(folder.parent / "K.txt"))
    views = [View(number, images[number], camera, poses[number]) for number in sorted(images)]
    return Track(f"{body}, {sequence}", BODIES.index(body) + 1, tuple(views))


def _matrix(path: Path) -> np.ndarray:
    """K (3, 3): nine numbers, or `Matx33f K = Matx33f(…);` as some copies have it."""
    text = path.read_text(encoding="utf-8", errors="replace")
    inside = re.search(r"\(([^()]*)\)", text)
    values = [float(word) for word in re.findall(_NUMBER, inside.group(1) if inside else text)]
    if len(values) != 9:
        raise InputFileError(f"{path}: holds {len(values)} numbers: must be a camera matrix of 9: download it again")
    return np.array(values).reshape(3, 3)


def build_parser() -> Parser:
    """The command's options."""
    parser = Parser(prog="python -m data_recipes.bcot", description=__doc__.split("\n\n")[0])  # type: ignore[union-attr]
    add_arguments(parser, PAGE)
    parser.add_argument("--bodies", type=names_of(BODIES, "body"), help=f"some of {', '.join(BODIES)}; all by default")
    parser.add_argument("--sequences", type=names, help="names of sequences; all by default")
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    return run(lambda args: convert(args, find), build_parser(), argv)


if __name__ == "__main__":
    sys.exit(main())
