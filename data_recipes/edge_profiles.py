"""Trains the network that says, by an edge's profile, where the CAD's edge lies beside it: acp_lab's `edge_profiles`.

    python -m data_recipes.edge_profiles --out FOLDER [--scenes 400] [--smeared 120] [--jobs 2] [--weights FILE]

Renders scenes into FOLDER, one file each; those that are there are kept, so that a run that was cut off goes on. Then
trains, tells how well the network does on every tenth scene, which it never saw, and writes its weights: into FOLDER,
or with --weights over those of the package.
"""

from __future__ import annotations

import os

# One thread: the matrices here are tall and thin, and threads would only wait for each other. Before NumPy is imported.
for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import argparse  # noqa: E402
import sys  # noqa: E402
from collections.abc import Sequence  # noqa: E402
from pathlib import Path  # noqa: E402

from data_recipes.command import Parser, at_most, count, note, run, whole  # noqa: E402

_HELD_OUT = 10


def scene_file(folder: Path, number: int) -> Path:
    """Where the views of a scene are kept."""
    return folder / f"scene_{number:05d}.npz"


def render_scene(path: str) -> str:
    """Render the scene that a file is named after; what a worker is asked for."""
    from data_recipes.profiles.stills import render_stills, write_stills

    file = Path(path)
    stills = render_stills(int(file.stem.rpartition("_")[2]))
    write_stills(file, stills)
    return f"{stills.part.name}, edges broken by {stills.edge_break_mm:g} mm"


def make(args: argparse.Namespace) -> None:
    """Render what is missing, train, write the weights."""
    # Imported late: they need the `recipes` extra, the options do not.
    from acp_lab.bench.workers import each
    from acp_lab.errors import ParameterError
    from acp_lab.tracking.learning.edge_profiles import save_network
    from data_recipes.profiles.examples import read_examples
    from data_recipes.profiles.stills import SMEARED
    from data_recipes.profiles.training import ProfileTraining, constant_loss, mean_loss, train

    numbers = [*range(args.scenes), *range(SMEARED, SMEARED + args.smeared)]
    if len(numbers) < 2:
        raise ParameterError(f"--scenes {args.scenes}: one of ten is held out, and none is left: give more")
    files = [scene_file(args.out, number) for number in numbers]
    args.out.mkdir(parents=True, exist_ok=True)
    missing = {file.stem: str(file.resolve()) for file in files if not file.exists()}
    for name, told in each(render_scene, missing, workers=args.jobs):
        note(f"{name}: {told}")
    examples = [read_examples(file) for file in files]
    held_out = [one for one in examples[::_HELD_OUT] if len(one)]
    shown = [one for place, one in enumerate(examples) if place % _HELD_OUT and len(one)]
    config = ProfileTraining(epochs=args.epochs, seed=args.seed)
    if not shown:
        raise ParameterError(f"--scenes {args.scenes}: no view shows enough of a part: give more")
    network = train(shown, config, lambda done, loss: note(f"epoch {done}: loss {loss:.3f}"))
    print(f"scenes {len(shown)}, candidates {sum(map(len, shown))}; held out: scenes {len(held_out)}")
    if held_out:
        found = sum(mean_loss(network, one) for one in held_out) / len(held_out)
        usual = sum(mean_loss(network, one, with_traits=False) for one in held_out) / len(held_out)
        constant = constant_loss(shown, held_out)
        print(f"loss on scenes held out: {found:.3f}; with no traits known: {usual:.3f}; of one shift: {constant:.3f}")
    path = args.weights or args.out / "edge_profiles.safetensors"
    save_network(network, path)
    print(path)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    parser = Parser(prog="python -m data_recipes.edge_profiles", description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--out", type=Path, required=True, help="folder for the rendered scenes, about 0.3 MB each")
    parser.add_argument("--scenes", type=at_most(100_000, count), default=400, help="how many, six views each (400)")
    parser.add_argument(
        "--smeared", type=at_most(100_000, whole), default=120, help="more of them, smeared by fast motion (120)"
    )
    parser.add_argument("--epochs", type=at_most(10_000, count), default=14, help="of the training (14)")
    parser.add_argument(
        "--seed", type=at_most(2**32 - 1, whole), default=0, help="of the training; scenes go by their numbers (0)"
    )
    parser.add_argument("--jobs", type=count, default=1, help="scenes rendered at a time, a process each (1)")
    parser.add_argument("--weights", type=Path, help="file to write (default: edge_profiles.safetensors in FOLDER)")
    return run(make, parser, argv)


if __name__ == "__main__":
    sys.exit(main())
