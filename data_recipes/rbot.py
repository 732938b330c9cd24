"""RBOT, the region-tracking benchmark of 18 objects, as its authors distribute it, into the BOP layout.

    python -m data_recipes.rbot RBOT_dataset.zip --bodies cat,cube --sequences a_regular --out DATASET

What is looked for, at any depth of the sources:

    camera_calibration.txt           a heading, then fx fy cx cy …; the pixel's corner is (0, 0)
    poses_first.txt                  a heading, then a line per frame: nine numbers of R row by row, three of t in mm
    cat/cat.obj                      mm
    cat/frames/a_regular0000.png …   640 x 512; also b_dynamiclight, c_noisy, d_occlusion

All bodies and sequences share the poses. In d_occlusion a second body (poses_second.txt) passes in front, which is not
tracked here. The frames are rendered by OpenGL over real video, whose pixel centres are at half pixels: the principal
point is moved by half a pixel, as the trackers that are measured on this set do.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from acp_lab.errors import InputFileError, SequenceError
from acp_lab.sequences.image_file import read_rgb
from data_recipes.archives import Source
from data_recipes.command import Parser, names_of, note, run
from data_recipes.convert import Found, add_arguments, camera_of, convert
from data_recipes.meshes import load_mesh, model_of
from data_recipes.text_poses import read_poses, table_of
from data_recipes.tracks import Track, View

PAGE = "https://www.mi.hs-rm.de/~schwan/research/RBOT/"
SEQUENCES = ("a_regular", "b_dynamiclight", "c_noisy", "d_occlusion")
BODIES = (
    "ape", "bakingsoda", "benchviseblue", "broccolisoup", "cam", "can", "cat", "clown", "cube", "driller", "duck",
    "eggbox", "glue", "iron", "koalacandy", "lamp", "phone", "squirrel",
)  # fmt: skip
"""Object ids count from 1 in this order."""


def find(source: Source, args: argparse.Namespace) -> Found:
    """Models and tracks of the bodies and sequences asked for."""
    poses_path = source.one(r"poses_first\.txt", "no poses_first.txt: give the folder of the whole data set")
    root = poses_path.parent
    poses = read_poses(poses_path, heading=True)
    camera_path = root / "camera_calibration.txt"
    fx, fy, cx, cy = table_of(camera_path, heading=True, columns=None)[0][:4]
    matrix = np.array([[fx, 0.0, cx - 0.5], [0.0, fy, cy - 0.5], [0.0, 0.0, 1.0]])
    there = [body for body in BODIES if (root / body / f"{body}.obj").is_file()]
    bodies = tuple(dict.fromkeys(args.bodies or there))
    if not bodies:
        raise SequenceError(f"{root}: holds none of its bodies ({BODIES[0]}/{BODIES[0]}.obj): unpack it again")
    models, tracks = {}, []
    for body in bodies:
        object_id = BODIES.index(body) + 1
        mesh = load_mesh(root / body / f"{body}.obj", "mm")
        models[object_id] = model_of(mesh)
        for sequence in dict.fromkeys(args.sequences):
            images = _images(root / body / "frames", sequence, len(poses))
            height, width = read_rgb(images[0]).shape[:2]
            camera = camera_of(matrix, width, height, str(camera_path))
            views = [
                View(number, image, camera, pose)
                for number, (image, pose) in enumerate(zip(images, poses, strict=False))
            ]
            tracks.append(Track(f"{body}, {sequence}", object_id, tuple(views)))
    return Found(models, tracks)


def _images(folder: Path, sequence: str, count: int) -> list[Path]:
    """The frames of one sequence, from 0 without a gap; InputFileError when some are missing."""
    images: list[Path] = []
    while len(images) < count and (path := folder / f"{sequence}{len(images):04d}.png").is_file():
        images.append(path)
    last = len(list(folder.glob(f"{sequence}*.png"))) if folder.is_dir() else 0
    if last > len(images) == count:
        raise InputFileError(
            f"{folder}: {sequence} has {last} images, but poses_first.txt {count} poses: unpack or download it again"
        )
    if not images or last > len(images):
        missing = folder / f"{sequence}{len(images):04d}.png"
        raise InputFileError(f"{missing}: no such image: unpack or download it again")
    if len(images) < count:
        note(f"{folder}: {sequence} has {len(images)} of {count} images")
    return images


def build_parser() -> Parser:
    """The command's options."""
    parser = Parser(prog="python -m data_recipes.rbot", description=__doc__.split("\n\n")[0])  # type: ignore[union-attr]
    add_arguments(parser, PAGE)
    parser.add_argument("--bodies", type=names_of(BODIES, "body"), help=f"some of {', '.join(BODIES)}; all by default")
    parser.add_argument(
        "--sequences", type=names_of(SEQUENCES, "sequence"), default=list(SEQUENCES), help=", ".join(SEQUENCES)
    )
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    return run(lambda args: convert(args, find), build_parser(), argv)


if __name__ == "__main__":
    sys.exit(main())
