"""Your own part and your own camera: everything that `acp-lab track` needs.

    python -m data_recipes.own_video clip.mp4 --mesh bracket.stl --views boards/ --chessboard 9x6 --square-mm 25 \\
        --pose POSE.json --out DATASET
    python -m data_recipes.own_video 0 --max-frames 300 --mesh bracket.step --camera CAMERA.json --out DATASET

FRAMES is a video, a folder of images or the number of a live camera. The camera comes from pictures of a chessboard or
a ChArUco board (a folder or a video), from a CAMERA.json, or from numbers. DATASET then holds

    CAMERA.json                        intrinsics and distortion of FRAMES; the reprojection error is printed
    models/obj_000001.ply              the mesh in mm; its unit, if not told, is guessed from its size, and printed
    test/000001/rgb/000000.png …       the frames, undistorted, with scene_camera.json
    POSE.json                          the start pose, and
    scene_gt.json                      the same as the truth of the first frame alone, where the pose was given, or
    POSES.csv                          as a row of results, where it was found in the image, which makes it no truth

so that both `acp-lab track DATASET` and `acp-lab track --video FRAMES --camera DATASET/CAMERA.json …` run.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from acp_lab.cad.mesh_file import UNITS_MM, says_its_unit
from acp_lab.errors import GeometryError, InputFileError, SequenceError
from acp_lab.geometry.arrays import ByteImage, FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import transform
from acp_lab.pasted import quoted
from acp_lab.sequences.calibration import (
    DICTIONARIES,
    Board,
    CharucoBoard,
    Chessboard,
    board_images,
    calibrate,
)
from acp_lab.sequences.frame import Frame
from acp_lab.sequences.images import CameraDevice, ImageFolder, VideoFile, first_size
from acp_lab.sequences.json_file import read_pose, was_found, write_pose
from acp_lab.sequences.pixel_coding import BAYER_CODES, FILE_NAME, PixelCoding
from acp_lab.sequences.results_csv import ResultRow, ResultsWriter
from data_recipes.bop_writer import check_out, new_dataset, write_image, write_models, write_scene
from data_recipes.command import Parser, at_most, count, note, pair, positive, run, warn
from data_recipes.convert import camera_of, check_apart
from data_recipes.meshes import load_mesh, model_of
from data_recipes.tracks import box_corners

_FEWEST_PX = 25.0
"""A part that looks smaller than that at its start pose is more likely a pose in metres."""
_SCORE_OF_FOUND = 0.9
"""Of a start pose that was found: below 1, which would be exact, and high enough not to be doubted."""


def make(args: argparse.Namespace) -> None:
    """Write the data set that the options describe."""
    given = (Path(args.frames), args.mesh, args.views, args.camera, args.pose)
    check_apart([path for path in given if path is not None], args.out)
    check_out(args.out, args.force)
    mesh = load_mesh(args.mesh, args.unit)
    model = model_of(mesh)
    guessed = "as the file says" if says_its_unit(args.mesh) else "by its size; --unit overrules it"
    said = "as told" if args.unit else guessed
    print(f"{args.mesh}: in {mesh.unit} ({said}), diameter {model.diameter:.1f} mm")
    camera = _camera(args)
    pose = None if args.pose is None else read_pose(args.pose)
    found = args.pose is not None and was_found(args.pose)
    if pose is not None:
        _check_pose(pose, box_corners(model.vertices), camera, args.pose)
    with new_dataset(args.out, args.force) as root:
        camera.to_json(root / "CAMERA.json")
        write_models(root, {1: model})
        folder = root / "test" / "000001"
        (folder / "rgb").mkdir(parents=True)
        matrices = dict[int, FloatArray]()
        for number, image in _frames(args, camera):
            write_image(folder / "rgb" / f"{number:06d}.{args.image_format}", image)
            matrices[number] = camera.matrix
        if not matrices:
            raise SequenceError(f"{args.frames}: gave no frame that can be read: check it")
        first = next(iter(matrices))
        write_scene(folder, matrices, 1, {} if pose is None or found else {first: pose})
        if pose is not None:
            write_pose(root / "POSE.json", pose, found)
        if pose is not None and found:
            with ResultsWriter(root / "POSES.csv") as starts:
                starts.append(ResultRow(1, first, 1, _SCORE_OF_FOUND, pose))
    print(f"{args.out}: {len(matrices)} frames written")
    _print_next_steps(args, pose is not None, found)


def _camera(args: argparse.Namespace) -> Camera:
    """The camera, from what the options give; its image size is that of the frames."""
    if args.camera is not None:
        return Camera.from_json(args.camera)
    if args.intrinsics is not None:
        return _camera_of_numbers(args)
    board: Board
    if args.chessboard is not None:
        columns, rows = args.chessboard
        board = Chessboard(columns, rows, args.square_mm)
    else:
        columns, rows = args.charuco
        marker_mm = args.marker_mm or 0.75 * args.square_mm
        board = CharucoBoard(columns, rows, args.square_mm, marker_mm, args.dictionary)
        if args.marker_mm is None:
            note(f"--marker-mm not given: {0.75 * args.square_mm:g} mm taken, three quarters of a square")
    found = calibrate(board, board_images(args.views, args.every_view), str(args.views))
    print(found)
    for warning in found.warnings:
        warn(warning)
    return found.camera


def _camera_of_numbers(args: argparse.Namespace) -> Camera:
    fx, fy, cx, cy, *dist = args.intrinsics
    width, height = first_size(args.frames, _coding(args))
    where = f"--intrinsics {','.join(f'{value:g}' for value in args.intrinsics)}"
    camera = camera_of(np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]), width, height, where)
    try:
        return Camera(width, height, camera.fx, camera.fy, camera.cx, camera.cy, tuple(dist) or (0.0,) * 5)
    except GeometryError as error:
        raise InputFileError(f"{where}: {error}") from None


def _frames(args: argparse.Namespace, camera: Camera) -> Iterator[tuple[int, ByteImage]]:
    """The frames without distortion by number; of those that cannot be read, which a warning tells, a gap is left."""
    source: ImageFolder | VideoFile | CameraDevice
    path = Path(args.frames)
    if path.is_dir():
        source = ImageFolder(path, camera, _coding(args))
    elif _is_device(args.frames):
        source = CameraDevice(int(args.frames), camera)
        note(f"{source.name}: recording {args.max_frames} frames")
    else:
        source = VideoFile(path, camera)
    taken = 0
    for frame in source.frames():
        if frame.index % args.every:
            continue
        if isinstance(frame, Frame):
            yield frame.index // args.every, frame.image
            taken += 1
        else:
            warn(f"{frame.reason}: left out")
        if taken == args.max_frames:
            return


def _coding(args: argparse.Namespace) -> PixelCoding | None:
    """How pixel values are meant, when the options tell; what they leave open, or all of it, a pixels.json may say."""
    if not (args.bits or args.bayer):
        return None
    beside = PixelCoding.beside(Path(args.frames))
    return PixelCoding(args.bits or beside.bits, args.bayer or beside.bayer, "the options")


def _is_device(frames: str) -> bool:
    return frames.isdecimal() and not Path(frames).exists()


def _check_pose(cam_T_obj: FloatArray, corners_obj: FloatArray, camera: Camera, path: Path) -> None:
    """InputFileError for a start pose that shows nothing of the part, a warning for one that shows it tiny."""
    pixels = camera.project(transform(cam_T_obj, corners_obj))
    if np.isnan(pixels).any():
        raise InputFileError(f"{path}: the part is at or behind the camera: cam_t_m2c is in mm, z in front of it")
    low, high = pixels.min(0), pixels.max(0)
    if (high < 0).any() or (low > (camera.width - 1, camera.height - 1)).any():
        raise InputFileError(f"{path}: the part is outside the picture: check cam_t_m2c (mm, x right, y down)")
    size = float(np.linalg.norm(high - low))
    if size < _FEWEST_PX:
        warn(f"{path}: the part would be {size:.0f} px wide at this pose: is cam_t_m2c in mm?")


def _print_next_steps(args: argparse.Namespace, has_pose: bool, found: bool) -> None:
    out, mesh = quoted(args.out), quoted(args.out / "models" / "obj_000001.ply")
    print(f"acp-lab prepare {mesh} --out PARTS_DIR")
    if not has_pose:
        for init, what in (("auto", "find the start pose"), ("POSES.csv", "give the start pose")):
            print(f"acp-lab track {out} --parts PARTS_DIR --init {init} --out results.csv     # {what}")
        return
    start = f" --init {quoted(args.out / 'POSES.csv')}" if found else ""
    print(f"acp-lab track {out} --parts PARTS_DIR{start} --out results.csv")
    coding = _coding(args)
    if coding is not None and coding != PixelCoding.beside(Path(args.frames)):
        values = {"bits": coding.bits, "bayer": coding.bayer}
        told = json.dumps({key: value for key, value in values.items() if value is not None})
        print(f"echo {quoted(told)} > {quoted(Path(args.frames) / FILE_NAME)}     # the same as the options")
    print(
        f"acp-lab track --video {quoted(args.frames)} --mesh {mesh} --camera {quoted(args.out / 'CAMERA.json')} "
        f"--init {quoted(args.out / 'POSE.json')} --parts PARTS_DIR --out results.csv"
    )


def _intrinsics(text: str) -> tuple[float, ...]:
    try:
        values = tuple(float(word) for word in text.split(","))
    except ValueError:
        values = ()
    if len(values) not in (4, 9) or not all(math.isfinite(value) for value in values):
        raise argparse.ArgumentTypeError(f"{text!r}; give fx,fy,cx,cy or fx,fy,cx,cy,k1,k2,p1,p2,k3")
    return values


def build_parser() -> Parser:
    """The command's options."""
    parser = Parser(prog="python -m data_recipes.own_video", description=__doc__.split("\n\n")[0])  # type: ignore[union-attr]
    parser.add_argument("frames", metavar="FRAMES", help="video, folder of images, or number of a live camera")
    parser.add_argument("--mesh", type=Path, required=True, help="CAD model: PLY, OBJ, STL or STEP")
    parser.add_argument("--unit", choices=tuple(UNITS_MM), help="unit of the mesh (default: guessed from its size)")
    parser.add_argument("--pose", type=Path, metavar="POSE.json", help="pose in the first frame")
    parser.add_argument("--out", type=Path, required=True, help="data set folder to write")
    parser.add_argument("--force", action="store_true", help="replace an existing data set")
    parser.add_argument("--every", type=count, default=1, metavar="N", help="take every Nth frame (1)")
    parser.add_argument("--max-frames", type=count, metavar="N", help="stop after N; a live camera needs it")
    parser.add_argument("--image-format", choices=("png", "jpg"), default="png", help="of the frames written (png)")
    parser.add_argument("--bits", type=count, help="real range of 16-bit images, such as 12")
    parser.add_argument("--bayer", choices=tuple(BAYER_CODES), help="the images are raw; their Bayer pattern")
    camera = parser.add_mutually_exclusive_group(required=True)
    camera.add_argument("--camera", type=Path, metavar="CAMERA.json", help="the camera, when it is known")
    camera.add_argument(
        "--intrinsics", type=_intrinsics, metavar="fx,fy,cx,cy[,k1,k2,p1,p2,k3]", help="the same as numbers, px"
    )
    camera.add_argument("--chessboard", type=pair, metavar="CxR", help="inner corners of the chessboard in --views")
    camera.add_argument("--charuco", type=pair, metavar="CxR", help="squares of the ChArUco board in --views")
    parser.add_argument("--views", type=Path, help="folder or video of the board, 10 views or more, tilted")
    parser.add_argument("--every-view", type=count, default=15, metavar="N", help="of a video, every Nth frame (15)")
    parser.add_argument("--square-mm", type=at_most(1000, positive), metavar="MM", help="side of a square")
    parser.add_argument("--marker-mm", type=at_most(1000, positive), metavar="MM", help="side of a ChArUco marker")
    parser.add_argument(
        "--dictionary", choices=DICTIONARIES, default="5X5_100", metavar="NAME",
        help="of the ChArUco markers, such as 4X4_50 (5X5_100)",
    )  # fmt: skip
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    parser = build_parser()
    args = parser.parse_args(argv)
    if (args.chessboard or args.charuco) and not (args.views and args.square_mm):
        parser.error("a board needs --views and --square-mm")
    if (args.bits or args.bayer) and (_is_device(args.frames) or Path(args.frames).is_file()):
        parser.error("--bits and --bayer are for a folder of images: leave them out")
    if _is_device(args.frames) and args.max_frames is None:
        parser.error("a live camera has no end: give --max-frames")
    return run(make, parser, argv)


if __name__ == "__main__":
    sys.exit(main())
