"""From tracks to a data set: what all converters share.

A converter finds models and tracks in a download; here they are ordered, checked and written. Images are not encoded
anew but linked (or copied where the disk cannot link), so they stay identical to the originals. Each output scene is
one part in one run of images; `scene_meta.json` says where it came from.
"""

from __future__ import annotations

import argparse
import os
import shutil
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from acp_lab.errors import GeometryError, InputFileError, SequenceError
from acp_lab.geometry.camera import Camera
from acp_lab.pasted import quoted
from acp_lab.sequences import pixel_coding
from acp_lab.sequences.image_file import image_damage
from data_recipes.archives import Source, open_sources
from data_recipes.bop_writer import Model, check_out, new_dataset, write_json, write_models, write_scene
from data_recipes.command import Parser, count, ids, note, positive
from data_recipes.tracks import Track, box_corners, longer_than, motion, ordered

Groups = Mapping[int, tuple[int, ...]]
MAX_STEP_PX, MAX_STEP_DEG = 60.0, 15.0
MIN_FRAMES = 5


@dataclass(frozen=True, eq=False)
class Found:
    """What a converter found: models by object id, and tracks in the order of their images."""

    models: Mapping[int, Model]
    tracks: Sequence[Track]


def add_arguments(parser: Parser, page: str) -> None:
    """The options that all converters have. page: where the data set can be downloaded."""
    parser.epilog = f"Nothing is downloaded: get the data set from {page}"
    parser.add_argument("sources", type=Path, nargs="+", metavar="SOURCE", help="folder or archive of the download")
    parser.add_argument("--out", type=Path, help="data set folder to write; without it, only check")
    parser.add_argument("--max-frames", type=count, help="stop each sequence after so many frames")
    parser.add_argument("--min-frames", type=count, default=MIN_FRAMES, help=f"leave out shorter ones ({MIN_FRAMES})")
    parser.add_argument("--force", action="store_true", help="replace an existing data set")


def add_ordering_arguments(parser: Parser, groups: Groups) -> None:
    """The options of data sets whose images show several parts, in no order. groups: the paper's, of object ids."""
    listed = "; ".join(f"{name}: {', '.join(map(str, of))}" for name, of in groups.items())
    objects = parser.add_mutually_exclusive_group()
    objects.add_argument("--objects", type=ids, help="only these object ids, such as 3,4,6")
    objects.add_argument("--group", type=int, choices=tuple(groups), help=f"the paper's groups of objects ({listed})")
    parser.add_argument("--scenes", type=ids, help="only these scene ids")
    parser.add_argument(
        "--order", choices=("nearest", "file"), default="nearest",
        help="nearest: by nearest pose, cut where the part moves too far (default); file: by file name",
    )  # fmt: skip
    parser.add_argument(
        "--max-step-px", type=positive, default=MAX_STEP_PX, metavar="PX",
        help=f"with nearest: cut where the corners of the part's box move farther on average ({MAX_STEP_PX:g})",
    )  # fmt: skip
    parser.add_argument(
        "--max-step-deg", type=positive, default=MAX_STEP_DEG, metavar="DEG",
        help=f"with nearest: cut where the part turns farther ({MAX_STEP_DEG:g})",
    )  # fmt: skip


def convert(args: argparse.Namespace, find: Callable[[Source, argparse.Namespace], Found]) -> None:
    """Open the sources, find what is in them and write it to args.out; without one, print what would be written.

    Raises InputFileError, SequenceError or PartError for whatever is wrong with the sources; nothing is left of
    an output that is not whole.
    """
    out: Path | None = args.out
    if out is not None:
        check_apart(args.sources, out)
        check_out(out, args.force)
        out.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".unpacked.", dir=None if out is None else out.parent) as work:
        found = find(open_sources(args.sources, Path(work)), args)
        tracks = _arranged(found, args)
        if out is None:
            for number, track in enumerate(tracks, start=1):
                for view in track.views:
                    _check_image(view.image)
                print(_described(number, track, found.models[track.object_id]))
            return
        with new_dataset(out, args.force) as root:
            used = {track.object_id for track in tracks}
            write_models(root, {i: model for i, model in found.models.items() if i in used})
            for number, track in enumerate(tracks, start=1):
                model = found.models[track.object_id]
                write_track(root / "test" / f"{number:06d}", track, model)
                print(_described(number, track, model))
    models = f"{quoted(out / 'models')}/*.ply"
    print(f"{out}: written; acp-lab prepare {models} --out PARTS_DIR, then acp-lab track {quoted(out)}")


def write_track(folder: Path, track: Track, model: Model) -> None:
    """One scene folder in the BOP layout; InputFileError for an image that is missing or damaged."""
    (folder / "rgb").mkdir(parents=True)
    for view in track.views:
        _check_image(view.image)
        place(view.image, folder / "rgb" / f"{view.number:06d}{view.image.suffix.lower()}")
    coding = track.views[0].image.parent / pixel_coding.FILE_NAME
    if coding.exists():
        place(coding, folder / "rgb" / coding.name)
    matrices = {view.number: view.camera.matrix for view in track.views}
    write_scene(folder, matrices, track.object_id, {view.number: view.cam_T_obj for view in track.views})
    meta = {
        "source": track.source,
        "obj_id": track.object_id,
        "motion": motion(track.views, box_corners(model.vertices)),
        "images": [f"{view.image.parent.name}/{view.image.name}" for view in track.views],
    }
    write_json(folder / "scene_meta.json", meta)


def place(source: Path, target: Path) -> None:
    """Make a file appear at target too: by a hard link, else by a copy."""
    try:
        os.link(os.path.realpath(source), target)
    except OSError:
        shutil.copyfile(source, target)


def camera_of(matrix: np.ndarray, width: int, height: int, where: str) -> Camera:
    """The camera of K (3, 3) and an image size; InputFileError when they do not fit each other."""
    try:
        camera = Camera.from_matrix(matrix, width, height)
    except GeometryError as error:
        raise InputFileError(f"{where}: {error}") from None
    if not (0 <= camera.cx <= width - 1 and 0 <= camera.cy <= height - 1):
        raise InputFileError(
            f"{where}: principal point ({camera.cx:g}, {camera.cy:g}) lies outside the image of {width} x {height} px: "
            "give the intrinsics of these images"
        )
    return camera


def check_apart(sources: Sequence[Path], out: Path) -> None:
    """InputFileError when writing `out` could touch a source."""
    target = out.resolve()
    for source in sources:
        here = source.resolve()
        if here == target or target in here.parents:
            raise InputFileError(f"{out}: holds the source {source}: give another --out")


def asked_objects(args: argparse.Namespace, groups: Groups) -> tuple[int, ...] | None:
    """The object ids of --group or --objects; None for all."""
    chosen: tuple[int, ...] | None = groups[args.group] if args.group else args.objects
    return chosen


def wanted(asked: Sequence[int] | None, there: Sequence[int], what: str, where: str) -> tuple[int, ...]:
    """Those of the ids that are there, all for None; SequenceError naming the first that is not."""
    for one in asked or ():
        if one not in there:
            listed = ", ".join(map(str, there))
            raise SequenceError(f"{where}: no {what} {one}: there are {listed or 'none'}")
    return tuple(there) if asked is None else tuple(dict.fromkeys(asked))


def _check_image(path: Path) -> None:
    damage = image_damage(path)
    if damage is not None:
        raise InputFileError(f"{path}: {damage}: unpack or download it again")


def _arranged(found: Found, args: argparse.Namespace) -> list[Track]:
    tracks = list(found.tracks)
    if getattr(args, "order", "file") == "nearest":
        corners = {i: box_corners(model.vertices) for i, model in found.models.items()}
        limits = args.max_step_px, args.max_step_deg
        tracks = [piece for track in tracks for piece in ordered(track, corners[track.object_id], *limits)]
    tracks, left_out = longer_than(tracks, args.min_frames)
    if left_out:
        note(f"{left_out} images are in no sequence of at least {args.min_frames} frames, and left out")
    if not tracks:
        raise SequenceError(f"no sequence of at least {args.min_frames} frames: ask for other objects, or --min-frames")
    if args.max_frames:
        tracks = [Track(track.source, track.object_id, track.views[: args.max_frames]) for track in tracks]
    return tracks


def _described(number: int, track: Track, model: Model) -> str:
    moves = motion(track.views, box_corners(model.vertices))
    return (
        f"scene {number}: {track.source}, {moves['frames']} frames, {moves['rot_deg_mean']} degrees and "
        f"{moves['step_px_mean']} px per frame (at most {moves['rot_deg_max']} and {moves['step_px_max']})"
    )
