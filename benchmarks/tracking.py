"""Track every scene of BOP data sets from truth and from disturbed starts; print Markdown tables.

One process, one thread, the tracker's defaults. Frames are decoded before the clock of a frame starts.
Example: python -m benchmarks.tracking path/to/dataset --parts out/parts --noise 0.5,0.5 --noise 5,5 --seeds 10
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import mean, median
from typing import TYPE_CHECKING

from acp_lab.commands import machine

if TYPE_CHECKING:
    import numpy as np

    from acp_lab.prepared_part import PreparedPart
    from acp_lab.sequences.bop import BopDataset, BopScene

RECALLS = ("recall_2", "recall_5", "recall_10")
UNITS = {
    "@*": "share of frames with ADD (ADD-S for symmetric parts) below 2, 5, 10% of the diameter",
    "add": "ADD (ADD-S for symmetric parts), % of the diameter: the median over a run's frames, mean over runs",
    "lost": "runs with ADD above 30% of the diameter in any frame",
    "runs": "runs",
    "ms": "ms per frame by the clock: the median over a run's frames, median over runs",
}


@dataclass(frozen=True)
class Row:
    """One scene's scores: recalls in [0, 1], medians, ms per frame; lost: ADD ever above 30% of the diameter."""

    name: str
    size: str
    recall_2: float
    recall_5: float
    recall_10: float
    add_percent: float
    ms: float
    lost: bool


def track_scene(dataset: BopDataset, scene: BopScene, model: PreparedPart, object_id: int, start: np.ndarray) -> Row:
    """Track one object of one scene from a start pose (4, 4) and score it."""
    from acp_lab.evaluation import evaluate
    from acp_lab.tracking.tracker import Tracker

    run = Tracker(model).run(scene, start, object_id=object_id)
    scored = evaluate(run, scene).objects[0]
    scores = scored.scores
    camera = scene.camera(scene.frame_ids[0])
    return Row(
        name=f"{dataset.name}/{scene.scene_id}",
        size=f"{camera.width}x{camera.height}",
        recall_2=scores.recall_2,
        recall_5=scores.recall_5,
        recall_10=scores.recall_10,
        add_percent=100.0 * median(map(float, scored.errors.distance)),
        ms=1e3 * scores.time_s_median,
        lost=scores.frames_until_lost < scores.frames,
    )


def print_table(title: str, rows: list[Row]) -> None:
    """A Markdown table with a mean row."""
    print(f"\n**{title}**\n")
    print("| scene | size | @2% | @5% | @10% | median ADD, % of diameter | lost | median ms |")
    print("|---|---|---|---|---|---|---|---|")
    for row in rows:
        print(
            f"| {row.name} | {row.size} | {row.recall_2:.2f} | {row.recall_5:.2f} | {row.recall_10:.2f} | "
            f"{row.add_percent:.2f} | {'yes' if row.lost else 'no'} | {row.ms:.1f} |"
        )
    print(
        f"| mean of {len(rows)} | | {_recalls(rows, ' | ')} | {mean(row.add_percent for row in rows):.2f} | "
        f"{sum(row.lost for row in rows)} | {median(row.ms for row in rows):.1f} |"
    )


def kept(rows: list[Row]) -> dict[str, float]:
    """Several runs as fields of an entry of measured numbers: means, and the median time."""
    scores = {key.replace("recall_", "@"): mean(getattr(row, key) for row in rows) for key in RECALLS}
    add, ms = mean(row.add_percent for row in rows), median(row.ms for row in rows)
    return {**scores, "add": add, "lost": sum(row.lost for row in rows), "runs": len(rows), "ms": ms}


def keep(
    dataset: BopDataset, noise: tuple[float, float] | None, edge_break_mm: float | None, by_scene: dict[str, list[Row]]
) -> None:
    """Store the runs from one kind of start, per scene and over all."""
    from acp_lab.sample import sample_dataset
    from benchmarks.measured import record

    name = "sample" if dataset.root.samefile(sample_dataset()) else dataset.name
    everything = [row for rows in by_scene.values() for row in rows]
    values = {scene: kept(rows) for scene, rows in by_scene.items()} | {"all": kept(everything)}
    start = f"poses {noise[0]:g} degrees and {noise[1]:g} mm off" if noise else "the true first pose"
    about = f"acp from {start}, per scene and over all runs; first frame left out, no resets"
    data = f"{name}: {len(by_scene)} sequence(s), {len(everything) // len(by_scene)} start(s) each"
    key = f"acp.{name}"
    if noise:
        key += f".{noise[0]:g}deg{noise[1]:g}mm"
    if edge_break_mm is not None:
        key += f".break{edge_break_mm:g}mm"
        about += f"; --edge-break {edge_break_mm:g}"
    record(key, about, UNITS, data, values)


def _recalls(rows: list[Row], separator: str) -> str:
    return separator.join(f"{mean(getattr(row, key) for row in rows):.2f}" for key in RECALLS)


def _noise(text: str) -> tuple[float, float]:
    degrees, mm = map(float, text.split(","))
    return degrees, mm


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("datasets", nargs="+", type=Path)
    parser.add_argument("--parts", type=Path, required=True, help="folder for prepared parts, one folder per data set")
    parser.add_argument("--generator", default="both", choices=("templates", "both"))
    parser.add_argument(
        "--noise", type=_noise, action="append", default=[], metavar="DEG,MM", help="more runs, from starts so far off"
    )
    parser.add_argument("--edge-break", type=float, help="mm, in place of what the parts were prepared with")
    parser.add_argument("--seeds", type=int, default=10, help="directions of each noise")
    parser.add_argument("--record", action="store_true", help="write to docs/measured.json")
    options = parser.parse_args()
    # Before NumPy is imported: its linear algebra reads the number of threads once.
    machine.limit_threads(1)
    import numpy as np

    from acp_lab.geometry.pose import disturb_pose
    from acp_lab.preparation import prepare
    from acp_lab.prepared_part import PrepareOptions
    from acp_lab.sequences.bop import BopDataset

    print(f"CPU: {machine.cpu_model()}; one thread")
    for root in options.datasets:
        dataset = BopDataset(root)
        runs: dict[tuple[float, float] | None, dict[str, list[Row]]] = {None: {}}
        for scene_id in dataset.scenes():
            scene = dataset.open_scene(scene_id)
            for object_id, pose in scene.first_poses.items():
                part = dataset.part(object_id)
                model = prepare(part, PrepareOptions(generator=options.generator), out=options.parts / dataset.name)
                if options.edge_break is not None:
                    model = replace(model, edge_break_mm=options.edge_break)
                name = f"{scene_id}" if len(scene.first_poses) == 1 else f"{scene_id}, {object_id}"
                runs[None][name] = [track_scene(dataset, scene, model, object_id, pose)]
                for noise in options.noise:
                    rows = runs.setdefault(noise, {}).setdefault(name, [])
                    for seed in range(options.seeds):
                        rng = np.random.default_rng([seed, scene_id, object_id])
                        start = disturb_pose(pose, part.box_centre, noise[0], noise[1], rng)
                        rows.append(track_scene(dataset, scene, model, object_id, start))
        for noise, by_scene in runs.items():
            title = f"starts {noise[0]:g} degrees and {noise[1]:g} mm off" if noise else "started from truth"
            print_table(f"{dataset.name}, {title}", [row for found in by_scene.values() for row in found])
            if options.record:
                keep(dataset, noise, options.edge_break, by_scene)
    print(f"\nPeak memory of this process: {machine.peak_memory_mb():.0f} MB")


if __name__ == "__main__":
    main()
