"""Seeded synthetic sequences of metal parts with exact truth, in the BOP layout.

    python -m data_recipes.metal_sequences --out DIR [--parts ...] [--kinds ...] [--frames N] [--seed N] ...
    python -m data_recipes.metal_sequences --sample            re-creates the sample that ships with acp_lab

Sequence k shows part k, kind k and edge break k of the lists given, each list repeated from its start. The same
options give the same truth to the byte, and on one machine the same pictures.
"""

from __future__ import annotations

import os

# One thread: the matrices here are tall and thin, and threads would only wait for each other. Before NumPy is imported.
for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import argparse  # noqa: E402
import sys  # noqa: E402
from collections.abc import Sequence  # noqa: E402
from itertools import islice  # noqa: E402
from pathlib import Path  # noqa: E402

from acp_lab.errors import ParameterError  # noqa: E402
from data_recipes.command import Parser, at_most, count, names_of, positive, run, share, whole  # noqa: E402
from data_recipes.metal.plan import FIRST_PARTS, KINDS, PART_NAMES, SPP, Plan, SceneConfig  # noqa: E402

SIZES = ("640x512", "1224x1024")
LEAST_PX, MOST_PX = 32, 4096
SAMPLE_FOLDER = Path(__file__).resolve().parents[1] / "acp_lab" / "sample" / "data"

# The shipped sample. Change it only together with the files under acp_lab/sample/data.
SAMPLE = Plan(
    "l_bracket",
    SceneConfig(
        kind="regular", frames=40, width=640, height=512, seed=277, edge_break_mm=0.25, rot_deg=1.5, trans_mm=2.0,
        table="wood", metal="aluminium", finish="milled", clutter=9, rest=0,
    ),
)  # fmt: skip


def make_plans(args: argparse.Namespace) -> list[Plan]:
    """The sequences that the options ask for."""
    listed = [] if args.random_parts is not None else args.parts
    count = args.sequences or max(len(listed), len(args.kinds), len(args.edge_break))
    parts = listed or _random_names(args.random_parts, count)
    width, height = args.size
    return [
        Plan(
            parts[k % len(parts)],
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
                look_alikes=args.look_alikes,
                shake_deg=args.shake_deg,
                readout=args.rolling_shutter,
            ),
        )
        for k in range(count)
    ]


def _random_names(first_seed: int, count: int) -> list[str]:
    # Imported late: it needs the `recipes` extra, the options do not.
    from data_recipes.metal.random_parts import asymmetric_parts

    return [part.name for part in islice(asymmetric_parts(first_seed), count)]


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    if not all(word.isascii() and word.isdigit() and len(word) < 10 for word in (width, height)):
        raise argparse.ArgumentTypeError(f"size {text[:40]!r}; give WIDTHxHEIGHT, such as {' or '.join(SIZES)}")
    if not all(LEAST_PX <= int(word) <= MOST_PX for word in (width, height)):
        raise argparse.ArgumentTypeError(f"size {text!r}; give {LEAST_PX} to {MOST_PX} px each way")
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
        "--parts", type=names_of(PART_NAMES, "part"), default=list(FIRST_PARTS),
        help=f"{', '.join(PART_NAMES)} (the first {len(FIRST_PARTS)})",
    )  # fmt: skip
    parser.add_argument(
        "--random-parts", type=whole, metavar="SEED", help="instead of --parts: others, that nobody drew"
    )
    parser.add_argument("--kinds", type=names_of(KINDS, "kind"), default=["regular"], help=", ".join(KINDS))
    parser.add_argument("--sequences", type=at_most(10_000, count), help="how many (default: the longest list)")
    parser.add_argument("--frames", type=at_most(5000, count), default=40, help="frames per sequence (40)")
    parser.add_argument("--size", type=_size, default=(640, 512), help=" or ".join(SIZES) + " (the first)")
    parser.add_argument("--edge-break", type=_breaks, default=[0.0], help="mm, one or a list; 0 (default) = sharp")
    parser.add_argument("--seed", type=whole, default=0, help="the same seed gives the same truth (0)")
    parser.add_argument(
        "--rot-deg-per-frame", type=at_most(20, positive), help="mean, up to 20; default: by kind, 1.5 to 3.8"
    )
    parser.add_argument(
        "--trans-mm-per-frame", type=at_most(100, positive), help="mean, up to 100; default: by kind, 1.5 to 4.5"
    )
    parser.add_argument(
        "--shake-deg", type=at_most(10, positive), default=0.0,
        help="of a camera in a hand, rms turn (0: a stand)",
    )  # fmt: skip
    parser.add_argument(
        "--rolling-shutter",
        type=share,
        default=0.0,
        metavar="SHARE",
        help="of the time between frames, in which rows are read one after another (0: all at once); our renderer only",
    )
    parser.add_argument(
        "--clutter", type=at_most(100, whole), help="number of other objects on the bench (default: 9 to 13)"
    )
    parser.add_argument(
        "--look-alikes", type=at_most(50, whole), default=0,
        help="number of other parts like the tracked one on the bench (0)",
    )  # fmt: skip
    parser.add_argument("--image-format", choices=("jpg", "png"), default="jpg", help="jpg (default) or png")
    parser.add_argument("--contact-sheet", type=Path, metavar="PNG", help="also write a picture of what was made")
    parser.add_argument("--path-traced", action="store_true", help="render with Mitsuba: more realistic, far slower")
    parser.add_argument(
        "--spp", type=at_most(4096, count), default=SPP, help=f"with --path-traced: samples per pixel ({SPP})"
    )
    parser.add_argument("--jobs", type=count, default=1, help="sequences rendered at a time, a process each (1)")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="render on a dask cluster, whose workers see --out")
    parser.add_argument("--force", action="store_true", help="replace an existing data set")
    return parser


def make(args: argparse.Namespace) -> None:
    """Render what the options describe."""
    # Imported late: they need the `recipes` extra, the options do not.
    from data_recipes.bop_writer import check_out
    from data_recipes.contact_sheet import check_sheet, contact_sheet, save_sheet
    from data_recipes.metal.dataset import render_dataset

    out: Path = args.out or SAMPLE_FOLDER
    check_out(out, args.force)
    if args.contact_sheet is not None:
        check_sheet(args.contact_sheet, out, "--contact-sheet")
    plans = [SAMPLE] if args.sample else make_plans(args)
    suffix = ".jpg" if args.sample else f".{args.image_format}"
    spp = args.spp if args.path_traced else None
    if args.path_traced and args.rolling_shutter:
        raise ParameterError(f"--rolling-shutter {args.rolling_shutter:g} is not for --path-traced: give one")
    render_dataset(out, plans, suffix, args.force, spp, args.jobs, args.scheduler)
    if args.contact_sheet is not None:
        save_sheet(args.contact_sheet, contact_sheet(out, edges=True))


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    parser = build_parser()
    args = parser.parse_args(argv)
    if args.out is None and not args.sample:
        parser.error("--out is missing; name the data set folder to write")
    return run(make, parser, argv)


if __name__ == "__main__":
    sys.exit(main())
