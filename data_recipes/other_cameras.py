"""A data set as other cameras would have taken it: softer, darker, noisier, without colours, with another tone curve.

    python -m data_recipes.other_cameras DATASET --out FOLDER [--cameras soft,dark] [--seed 0]

Writes one data set for each camera of `acp_lab.studies.other_cameras`, FOLDER/CAMERA/DATASET, with the same truth.
Its parts are those of DATASET: what is prepared for one serves all. To see what becomes of a tracker:
`python -m benchmarks.robustness FOLDER/dark/DATASET ...`.
"""

from __future__ import annotations

import argparse
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from acp_lab.errors import InputFileError, SequenceError
from acp_lab.input_file import is_measure, read_json_object
from acp_lab.sequences import BopDataset, BopScene, Frame
from acp_lab.studies.other_cameras import CAMERAS, OtherCamera
from data_recipes.bop_writer import check_out, new_dataset, write_image, write_json
from data_recipes.command import Parser, note, run, whole
from data_recipes.convert import check_apart

# Files of a scene that hold whichever camera takes its pictures.
_OF_ALL_CAMERAS = ("scene_gt.json", "scene_meta.json", "scene_look_alikes.json")
_OF_ANY_SIZE = ("visib_fract",)
_MEND = "mend it, or take it away"


def write_as_taken_by(dataset: BopDataset, camera: OtherCamera, out: Path, force: bool = False, seed: int = 0) -> None:
    """The data set as a camera would have taken it, whole or not at all.

    Raises InputFileError when `out` exists and `force` is not given, or a file cannot be read or written;
    SequenceError for an image that cannot be read.
    """
    with new_dataset(out, force) as root:
        shutil.copytree(dataset.root / "models", root / "models", copy_function=shutil.copyfile)
        for scene_id in dataset.scenes():
            _write_scene(dataset.open_scene(scene_id), camera, root / "test" / f"{scene_id:06d}", seed)


def _write_scene(scene: BopScene, camera: OtherCamera, folder: Path, seed: int) -> None:
    (folder / "rgb").mkdir(parents=True)
    cameras: dict[str, object] = {}
    for frame in scene.frames():
        if not isinstance(frame, Frame):
            raise SequenceError(f"{frame.reason}: a data set is taken anew as a whole: mend it first")
        taken = camera.take(frame, seed)
        # As they are: whatever the camera stores has been stored.
        write_image(folder / "rgb" / f"{frame.index:06d}.png", np.asarray(taken.image))
        cameras[str(frame.index)] = {"cam_K": taken.camera.matrix.ravel().tolist(), "depth_scale": 1.0}
    write_json(folder / "scene_camera.json", cameras)
    for name in _OF_ALL_CAMERAS:
        if (scene.folder / name).exists():
            shutil.copyfile(scene.folder / name, folder / name)
    seen = scene.folder / "scene_gt_info.json"
    if seen.exists():
        write_json(folder / seen.name, _visible_shares(seen))


def _visible_shares(path: Path) -> dict[str, object]:
    """What holds for pictures of any size of a scene_gt_info.json: of boxes and counts in px the visible share alone.

    Not all data sets tell it.
    """
    told = read_json_object(path, _MEND)
    for index, of_frame in told.items():
        if not isinstance(of_frame, list) or not all(isinstance(one, dict) for one in of_frame):
            raise InputFileError(f"{path}: image {index} has no list of objects: {_MEND}")
    return {
        index: [{key: one[key] for key in _OF_ANY_SIZE if is_measure(one.get(key))} for one in of_frame]
        for index, of_frame in told.items()
    }


def make(args: argparse.Namespace) -> None:
    """Write a data set for each camera."""
    dataset = BopDataset(args.dataset)
    check_apart([args.dataset], args.out)
    places = {name: args.out / name / dataset.name for name in args.cameras}
    for out in places.values():
        check_out(out, args.force)
    for name, out in places.items():
        write_as_taken_by(dataset, CAMERAS[name], out, args.force, args.seed)
        note(f"{out}: written")


def cameras(text: str) -> tuple[str, ...]:
    """Names of cameras, for an option."""
    names = tuple(dict.fromkeys(text.split(",")))
    for name in names:
        if name not in CAMERAS:
            raise argparse.ArgumentTypeError(f"no camera {name}: there are {', '.join(CAMERAS)}")
    return names


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    parser = Parser(prog="python -m data_recipes.other_cameras", description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("dataset", type=Path, metavar="DATASET", help="folder of a data set in the BOP layout")
    parser.add_argument("--out", type=Path, required=True, help="folder of folders, one for each camera")
    parser.add_argument("--cameras", type=cameras, default=tuple(CAMERAS), help=f"some of {','.join(CAMERAS)} (all)")
    parser.add_argument("--seed", type=whole, default=0, help="of the noise (0)")
    parser.add_argument("--force", action="store_true", help="replace existing data sets")
    return run(make, parser, argv)


if __name__ == "__main__":
    sys.exit(main())
