"""Seeded synthetic sequences of metal parts with exact truth, in the BOP layout.

    python -m data_recipes.metal_sequences --out DIR [--parts ...] [--kinds ...] [--frames N] [--seed N] ...
    python -m data_recipes.metal_sequences --sample            re-creates the sample that ships with acp_lab

Sequence k shows part k, kind k and edge break k of the lists given, each list starting over at its end. The same
options give the same truth to the byte, and on one machine the same pictures.
"""

from __future__ import annotations

import os

# One thread: the matrices here are tall and thin, and threads would only spin. Before NumPy is imported.
for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import argparse  # noqa: E402
import sys  # noqa: E402
import time  # noqa: E402
from collections.abc import Sequence  # noqa: E402
from dataclasses import dataclass  # noqa: E402
from itertools import pairwise  # noqa: E402
from pathlib import Path  # noqa: E402
from typing import Protocol  # noqa: E402

import numpy as np  # noqa: E402

from acp_lab.geometry.pose import rotation_angle_deg  # noqa: E402
from data_recipes.bop_writer import (  # noqa: E402
    Model,
    new_dataset,
    visibility,
    write_image,
    write_json,
    write_models,
    write_scene,
)
from data_recipes.command import Parser, count, names_of, note, positive, run, whole  # noqa: E402
from data_recipes.contact_sheet import contact_sheet, save_picture  # noqa: E402
from data_recipes.metal.cad_parts import FIRST_PARTS, PARTS, CadPart, make_part  # noqa: E402
from data_recipes.metal.path_traced import SPP, path_tracer  # noqa: E402
from data_recipes.metal.render import Picture, Renderer  # noqa: E402
from data_recipes.metal.scene import KINDS, Scene, SceneConfig, make_scene  # noqa: E402
from data_recipes.metal.sensor import make_sensor  # noqa: E402

SIZES = ("640x512", "1224x1024")
FPS = 30.0
SAMPLE_FOLDER = Path(__file__).resolve().parents[1] / "acp_lab" / "sample" / "data"


@dataclass(frozen=True)
class Plan:
    """One sequence of a data set: which part (by name) and what happens to it."""

    part: str
    config: SceneConfig


# The shipped sample. Change it only together with the files under acp_lab/sample/data.
SAMPLE = Plan(
    "l_bracket",
    SceneConfig(
        kind="regular", frames=40, width=640, height=512, seed=277, edge_break_mm=0.25, rot_deg=1.5, trans_mm=2.0,
        table="wood", metal="aluminium", finish="milled", clutter=9, rest=0,
    ),
)  # fmt: skip


def render_dataset(
    out: Path, plans: Sequence[Plan], suffix: str, force: bool = False, spp: int | None = None
) -> None:
    """Render all planned sequences into the BOP data set `out`.

    suffix: ".jpg" or ".png". spp: samples per pixel of a path tracer; None for our own renderer. Raises InputFileError
    when `out` exists and force is not set, and when there is no path tracer.
    """
    names = list(dict.fromkeys(plan.part for plan in plans))
    parts = {name: make_part(name) for name in names}
    with new_dataset(out, force) as root:
        write_models(root, {number: _model(part) for number, part in enumerate(parts.values(), start=1)})
        for number, plan in enumerate(plans, start=1):
            folder = root / "test" / f"{number:06d}"
            (folder / "rgb").mkdir(parents=True)
            start = time.perf_counter()
            scene = make_scene(parts[plan.part], plan.config)
            renderer = Renderer(scene) if spp is None else path_tracer(scene, spp)
            _render_scene(folder, scene, renderer, names.index(plan.part) + 1, suffix)
            write_json(folder / "scene_meta.json", _meta(scene, number, names.index(plan.part) + 1, parts[plan.part]))
            each = (time.perf_counter() - start) / plan.config.frames
            note(f"scene {number}: {plan.part}, {plan.config.kind}, {each:.1f} s per frame")


def _model(part: CadPart) -> Model:
    return Model(part.vertices, part.faces, part.diameter, {"group": part.group, "name": part.name})


class FrameRenderer(Protocol):
    """What turns a scene into pictures."""

    def frame(self, index: int) -> Picture:
        """Render one frame."""


def _render_scene(folder: Path, scene: Scene, renderer: FrameRenderer, object_id: int, suffix: str) -> None:
    sensor, seen = None, []
    for frame in range(scene.config.frames):
        picture = renderer.frame(frame)
        if sensor is None:
            sensor = make_sensor(np.random.default_rng([scene.config.seed, 20]), picture.image, picture.part_seen)
        noise = np.random.default_rng([scene.config.seed, 21, frame])
        write_image(folder / "rgb" / f"{frame:06d}{suffix}", sensor.expose(picture.image, noise))
        seen.append(visibility(picture.part_alone, picture.part_seen))
    write_scene(folder, [scene.camera.matrix] * scene.config.frames, object_id, scene.truth.poses, seen)


def _meta(scene: Scene, scene_id: int, object_id: int, part: CadPart) -> dict[str, object]:
    config = scene.config
    return {
        "scene_id": scene_id,
        "obj_id": object_id,
        "part": part.name,
        "group": part.group,
        "kind": config.kind,
        "seed": config.seed,
        "edge_break_mm": config.edge_break_mm,
        "material": scene.names[0],
        "table": scene.table.kind,
        "moving": "part" if scene.held else "camera",
        "light_moves": scene.lights is not None,
        "frames": config.frames,
        "fps": FPS,
        "width": config.width,
        "height": config.height,
        "exposure_frames": round(scene.exposure_frames, 4),
        "motion": motion_statistics(scene.truth.poses),
    }


def motion_statistics(cam_T_obj: np.ndarray) -> dict[str, object]:
    """Rotation (deg) and translation (mm) per frame, and the range of distances (mm), of poses (n, 4, 4)."""
    pairs = list(pairwise(cam_T_obj))
    turn = np.array([rotation_angle_deg(a[:3, :3], b[:3, :3]) for a, b in pairs] or [0.0])
    step = np.array([float(np.linalg.norm(b[:3, 3] - a[:3, 3])) for a, b in pairs] or [0.0])
    return {
        "rot_deg_mean": round(float(turn.mean()), 3),
        "rot_deg_max": round(float(turn.max()), 3),
        "trans_mm_mean": round(float(step.mean()), 3),
        "trans_mm_max": round(float(step.max()), 3),
        "dist_mm": [round(float(cam_T_obj[:, 2, 3].min()), 1), round(float(cam_T_obj[:, 2, 3].max()), 1)],
    }


def make_plans(args: argparse.Namespace) -> list[Plan]:
    """The sequences that the options ask for."""
    count = args.sequences or max(len(args.parts), len(args.kinds), len(args.edge_break))
    width, height = args.size
    return [
        Plan(
            args.parts[k % len(args.parts)],
            SceneConfig(
                kind=args.kinds[k % len(args.kinds)],
                frames=args.frames,
                width=width,
                height=height,
                seed=1000 * args.seed + k,
                edge_break_mm=args.edge_break[k % len(args.edge_break)],
                rot_deg=args.rot_deg_per_frame,
                trans_mm=args.trans_mm_per_frame,
                clutter=args.clutter,
            ),
        )
        for k in range(count)
    ]


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    if not (width.isdigit() and height.isdigit() and int(width) >= 32 and int(height) >= 32):
        raise argparse.ArgumentTypeError(f"size {text!r}; give WIDTHxHEIGHT, such as {' or '.join(SIZES)}")
    return int(width), int(height)


def _breaks(text: str) -> list[float]:
    try:
        values = [float(v) for v in text.split(",")]
    except ValueError:
        raise argparse.ArgumentTypeError(f"edge break {text!r}; give mm, such as 0 or 0,0.2,0.4") from None
    if not all(0 <= v <= 1 for v in values):
        raise argparse.ArgumentTypeError(f"edge break {text!r}; give 0 to 1 mm")
    return values


def build_parser() -> Parser:
    """The command's options."""
    parser = Parser(prog="python -m data_recipes.metal_sequences", description=__doc__.split("\n\n")[0])  # type: ignore[union-attr]
    parser.add_argument("--out", type=Path, help="data set folder to write")
    parser.add_argument("--sample", action="store_true", help="the shipped sample; only --out and --force count")
    parser.add_argument(
        "--parts", type=names_of(tuple(PARTS), "part"), default=list(FIRST_PARTS),
        help=f"{', '.join(PARTS)} (all but v_block)",
    )  # fmt: skip
    parser.add_argument("--kinds", type=names_of(KINDS, "kind"), default=["regular"], help=", ".join(KINDS))
    parser.add_argument("--sequences", type=count, help="how many (default: the longest list)")
    parser.add_argument("--frames", type=count, default=40, help="frames per sequence (40)")
    parser.add_argument("--size", type=_size, default=(640, 512), help=" or ".join(SIZES) + " (the first)")
    parser.add_argument("--edge-break", type=_breaks, default=[0.0], help="mm, one or a list; 0 (default) = sharp")
    parser.add_argument("--seed", type=whole, default=0, help="same seed, same truth (0)")
    parser.add_argument("--rot-deg-per-frame", type=positive, help="mean; default: by kind, 1.5 to 3.8")
    parser.add_argument("--trans-mm-per-frame", type=positive, help="mean; default: by kind, 1.5 to 4.5")
    parser.add_argument("--clutter", type=whole, help="things that lie about (default: 9 to 13)")
    parser.add_argument("--image-format", choices=("jpg", "png"), default="jpg", help="jpg (default) or png")
    parser.add_argument("--contact-sheet", type=Path, metavar="PNG", help="also write a picture of what was made")
    parser.add_argument("--path-traced", action="store_true", help="render with Mitsuba: truer pictures, far slower")
    parser.add_argument("--spp", type=count, default=SPP, help=f"with --path-traced: samples per pixel ({SPP})")
    parser.add_argument("--force", action="store_true", help="replace an existing data set")
    return parser


def make(args: argparse.Namespace) -> None:
    """Render what the options describe."""
    out: Path = args.out or SAMPLE_FOLDER
    plans = [SAMPLE] if args.sample else make_plans(args)
    suffix = ".jpg" if args.sample else f".{args.image_format}"
    render_dataset(out, plans, suffix, args.force, spp=args.spp if args.path_traced else None)
    if args.contact_sheet is not None:
        save_picture(args.contact_sheet, contact_sheet(out, edges=True))


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    parser = build_parser()
    args = parser.parse_args(argv)
    if args.out is None and not args.sample:
        parser.error("--out is missing; name the data set folder to write")
    return run(make, parser, argv)


if __name__ == "__main__":
    sys.exit(main())
