"""A data set at a glance: a row of frames per scene, with the CAD model's edges drawn at the true poses.

    python -m data_recipes.contact_sheet DATASET --out sheet.png [--edges] [--columns 3] [--width 240]

Works on any data set in the BOP layout, made by a recipe or not. With --edges every picture is repeated with
the edges that the part should show at its true pose. Where they miss the picture's edges, poses, intrinsics, units or
the mesh are wrong.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path

import cv2
import numpy as np

from acp_lab.cad.edges import sample_edges, visible_samples
from acp_lab.cad.part import Part
from acp_lab.cad.raycast import EmbreeCaster
from acp_lab.errors import InputFileError, SequenceError
from acp_lab.files import check_place, write_whole
from acp_lab.geometry.arrays import ByteImage, FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import inverse, transform
from acp_lab.sequences import BopDataset, BopScene, Frame
from data_recipes.command import Parser, at_most, count, ids, run

EDGE_COLOUR = (255, 140, 0)
_OFFSET_SHARE = 0.002  # of the diameter: how far off the surface visibility rays start
_GAP = 2
_COLOURS = 128
_FORMATS = {".png": "PNG", ".jpg": "JPEG", ".jpeg": "JPEG"}
_MARK = "contact sheet of data_recipes"
"""A comment in the file, near its beginning: any other picture is somebody's own."""
_MARK_WITHIN = 1024


def contact_sheet(
    root: Path, columns: int = 3, width: int = 240, edges: bool = False, scenes: Sequence[int] | None = None,
    split: str = "test",
) -> ByteImage:  # fmt: skip
    """The sheet as RGB (h, w, 3): per scene `columns` frames from first to last, each `width` px wide.

    Raises InputFileError or SequenceError for a data set that cannot be read.
    """
    dataset = BopDataset(root)
    rows = []
    for scene_id in scenes or dataset.scenes(split):
        scene = dataset.open_scene(scene_id, split)
        chosen = np.linspace(0, len(scene.frame_ids) - 1, columns).round().astype(int)
        cells = []
        for k in dict.fromkeys(chosen.tolist()):
            frame = scene.frame(scene.frame_ids[k])
            if not isinstance(frame, Frame):
                raise SequenceError(frame.reason)
            pictures = [frame.image, *([with_edges(dataset, scene, frame)] if edges else [])]
            cells += [_small(picture, width) for picture in pictures]
        rows.append(np.hstack([np.pad(cell, ((0, _GAP), (0, _GAP), (0, 0)), constant_values=255) for cell in cells]))
    widest = max(row.shape[1] for row in rows)
    full = [np.pad(row, ((0, 0), (0, widest - row.shape[1]), (0, 0)), constant_values=255) for row in rows]
    return np.asarray(np.vstack(full)[:-_GAP, :-_GAP])


def with_edges(dataset: BopDataset, scene: BopScene, frame: Frame) -> ByteImage:
    """A copy of a frame with the visible CAD edges of its objects at their true poses."""
    image = frame.image.copy()
    truth = {} if scene.ground_truth is None else scene.ground_truth.in_frame(frame.index)
    for object_id, cam_T_obj in truth.items():
        draw_edges(image, dataset.part(object_id), cam_T_obj, frame.camera)
    return image


def draw_edges(image: ByteImage, part: Part, cam_T_obj: FloatArray, camera: Camera) -> None:
    """Draw the edges that a part shows at a pose (4, 4) into an RGB image, as points between pixels too."""
    edges = sample_edges(part)
    caster = EmbreeCaster(part.vertices, part.faces)
    shows = visible_samples(edges, caster, inverse(cam_T_obj)[:3, 3], _OFFSET_SHARE * part.diameter)
    pixels = camera.project(transform(cam_T_obj, edges.points_obj[shows]))
    for x, y in np.rint(16.0 * pixels[np.isfinite(pixels).all(1)]).astype(int):
        cv2.circle(image, (int(x), int(y)), 9, EDGE_COLOUR, -1, cv2.LINE_AA, shift=4)


def check_sheet(path: Path, root: Path, option: str) -> None:
    """InputFileError where no sheet can be put at `path`: to be asked before anything is made that takes long.

    Its suffix must be that of a picture, it may not lie in the data set `root`, which need not be there yet, and what
    it replaces must be a sheet, or empty. option: that names the path, such as "--out".
    """
    if path.suffix.lower() not in _FORMATS:
        raise InputFileError(f"{path}: cannot be written: give a .png or .jpg file as {option}")
    if path.is_dir():
        raise InputFileError(f"{path}: is a folder: {option} needs a file name")
    check_place(path, option)
    if root.resolve() in path.resolve().parents:
        raise InputFileError(f"{path}: lies in the data set: choose another place for {option}")
    if path.exists():
        with path.open("rb") as file:
            start = file.read(_MARK_WITHIN)
        if start and _MARK.encode() not in start:
            raise InputFileError(f"{path}: {option} would replace a file that is no contact sheet: choose another name")


def save_sheet(path: Path, sheet: ByteImage) -> None:
    """Write a sheet whole or not at all; as PNG with few colours, which is a third of the size.

    InputFileError when it cannot be.
    """
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    picture, content = Image.fromarray(sheet), BytesIO()
    if _FORMATS[path.suffix.lower()] == "PNG":
        mark = PngInfo()
        mark.add_text("Comment", _MARK)
        picture = picture.quantize(_COLOURS, dither=Image.Dither.FLOYDSTEINBERG)
        picture.save(content, "PNG", optimize=True, pnginfo=mark)
    else:
        picture.save(content, "JPEG", optimize=True, comment=_MARK)
    write_whole(path, content.getvalue(), "the contact sheet")


def _small(image: ByteImage, width: int) -> ByteImage:
    height = max(1, round(image.shape[0] * width / image.shape[1]))
    return np.asarray(cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA), dtype=np.uint8)


def make(args: argparse.Namespace) -> None:
    """Write the sheet that the options describe."""
    check_sheet(args.out, args.dataset, "--out")
    sheet = contact_sheet(args.dataset, args.columns, args.width, args.edges, args.scenes, args.split)
    save_sheet(args.out, sheet)
    print(f"{args.out}: written, {sheet.shape[1]} x {sheet.shape[0]} px")


def build_parser() -> Parser:
    """The command's options."""
    parser = Parser(prog="python -m data_recipes.contact_sheet", description=__doc__.split("\n\n")[0])  # type: ignore[union-attr]
    parser.add_argument("dataset", type=Path, metavar="DATASET", help="a data set in the BOP layout")
    parser.add_argument("--out", type=Path, required=True, metavar="PNG", help="picture to write, .png or .jpg")
    parser.add_argument("--edges", action="store_true", help="also with the CAD model's edges drawn at the true pose")
    parser.add_argument("--columns", type=at_most(50, count), default=3, help="frames per scene (3)")
    parser.add_argument("--width", type=at_most(2000, count), default=240, help="px per picture (240)")
    parser.add_argument("--scenes", type=ids, help="only these scene ids")
    parser.add_argument("--split", default="test", help="the folder of scenes (test)")
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    return run(make, build_parser(), argv)


if __name__ == "__main__":
    sys.exit(main())
