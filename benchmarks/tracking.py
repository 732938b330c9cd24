"""Track every scene of BOP data sets from truth and from disturbed starts; print Markdown tables.

One process, one thread, the tracker's defaults. Frames are decoded before the clock of a frame starts.
Example: python -m benchmarks.tracking path/to/dataset --parts out/parts --noise-seeds 10
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from statistics import mean, median
from typing import TYPE_CHECKING

from acp_lab.commands import machine

if TYPE_CHECKING:
    import numpy as np

    from acp_lab.prepared_part import PreparedPart
    from acp_lab.sequences.bop import BopDataset, BopScene

NOISE_DEG, NOISE_MM = 5.0, 5.0


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

    run = Tracker(model).run(scene, start)
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


def _recalls(rows: list[Row], separator: str) -> str:
    return separator.join(
        f"{mean(getattr(row, key) for row in rows):.2f}" for key in ("recall_2", "recall_5", "recall_10")
    )


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("datasets", nargs="+", type=Path)
    parser.add_argument("--parts", type=Path, required=True, help="folder for prepared parts, one folder per data set")
    parser.add_argument("--generator", default="both", choices=("templates", "both"))
    parser.add_argument("--noise-seeds", type=int, default=0, help="further runs from starts 5 deg and 5 mm off")
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
        exact: list[Row] = []
        noisy: dict[int, list[Row]] = {seed: [] for seed in range(options.noise_seeds)}
        for scene_id in dataset.scenes():
            scene = dataset.open_scene(scene_id)
            for object_id, pose in scene.first_poses.items():
                part = dataset.part(object_id)
                model = prepare(part, PrepareOptions(generator=options.generator), out=options.parts / dataset.name)
                exact.append(track_scene(dataset, scene, model, object_id, pose))
                for seed, rows in noisy.items():
                    rng = np.random.default_rng([seed, scene_id, object_id])
                    start = disturb_pose(pose, part.box_centre, NOISE_DEG, NOISE_MM, rng)
                    rows.append(track_scene(dataset, scene, model, object_id, start))
        print_table(f"{dataset.name}, started from truth", exact)
        if noisy:
            runs = [row for rows in noisy.values() for row in rows]
            lost = sum(row.lost for row in runs)
            print(
                f"\nStarted {NOISE_DEG:g} degrees and {NOISE_MM:g} mm off, seeds 0-{options.noise_seeds - 1}: "
                f"{len(runs) - lost} of {len(runs)} runs never lost; mean @2/5/10% {_recalls(runs, ' / ')}."
            )
    print(f"\nPeak memory of this process: {machine.peak_memory_mb():.0f} MB")


if __name__ == "__main__":
    main()
