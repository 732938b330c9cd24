"""What one part, one rendered frame and one tracked frame cost: what plans of large runs are made of.

CPU seconds of this process, so that other work on the machine does not count. Parts must have been prepared by this
version, which counts the time of each stage.

Example: acp-lab prepare dataset/models/*.ply --out out/parts/dataset
         python -m benchmarks.unit_costs path/to/dataset --parts out/parts [--record]
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

from acp_lab.commands import machine

# Before NumPy is imported: its linear algebra reads the number of threads once.
machine.limit_threads(1)

import numpy as np  # noqa: E402

METHODS = ("acp", "region", "slet")
RENDERED_FRAMES = 4
UNITS = {
    "cpu_s": "CPU seconds",
    "per_frame_ms": "CPU milliseconds per frame of a whole run: opening, decoding, tracking, scoring",
    "kB": "kilobytes of one run's file, per frame",
    "MB": "megabytes that the process held at most",
    "parts": "prepared parts that the mean is over",
}


def preparing(parts: Path) -> dict[str, dict[str, float]]:
    """CPU seconds per part, the mean over the prepared parts of a folder, by what is prepared."""
    from acp_lab.prepared_part import PreparedPart

    spent = [PreparedPart.load(header.parent).cpu_s for header in sorted(parts.glob("*/part.json"))]
    wanted = {
        "prepare, templates": ("edges", "templates", "views"),
        "prepare, both": ("edges", "templates", "views", "networks"),
    }
    found = {}
    for name, stages in wanted.items():
        known = [sum(times[stage] for stage in stages) for times in spent if set(stages) <= set(times)]
        if known:
            found[name] = {"cpu_s": float(np.mean(known)), "parts": len(known)}
    return found


def tracking(dataset: Path, parts: Path) -> dict[str, dict[str, float]]:
    """CPU milliseconds per frame, and kilobytes per frame that are kept, of every method on every sequence."""
    from acp_lab.bench.protocol import Variant, task_of
    from acp_lab.bench.runner import run_task, sequences_of
    from acp_lab.machine import peak_memory_mb
    from acp_lab.tracking.method import method_named

    found = {}
    keys = sequences_of(dataset, "test")
    for name in METHODS:
        per_frame_ms, size = [], []
        for number, key in enumerate([keys[0], *keys]):
            task = task_of(dataset, "test", parts, key, method_named(name), Variant())
            begin_s = time.process_time()
            answer = run_task(task.to_json())
            spent_s, frames = time.process_time() - begin_s, _frames(answer)
            if number:  # the first run reads compiled loops
                per_frame_ms.append(1e3 * spent_s / frames)
                size.append(len(answer) / 1e3 / frames)
        found[f"track, {name}"] = {
            "per_frame_ms": float(np.mean(per_frame_ms)), "kB": float(np.mean(size)), "MB": peak_memory_mb() or 0.0
        }  # fmt: skip
    return found


def rendering() -> dict[str, dict[str, float]]:
    """CPU seconds per frame of the recipe of synthetic sequences, 640 x 512, opening the scene included."""
    from data_recipes.metal.dataset import render_dataset
    from data_recipes.metal.plan import Plan, SceneConfig

    config = SceneConfig(kind="regular", frames=RENDERED_FRAMES, width=640, height=512, seed=5, edge_break_mm=0.25)
    with tempfile.TemporaryDirectory() as folder:
        begin_s = time.process_time()
        render_dataset(Path(folder) / "made", [Plan("l_bracket", config)], ".jpg")
        spent_s = time.process_time() - begin_s
        size = sum(path.stat().st_size for path in (Path(folder) / "made" / "test").rglob("*.jpg"))
    return {"render": {"cpu_s": spent_s / RENDERED_FRAMES, "kB": size / 1e3 / RENDERED_FRAMES}}


def _frames(answer: str) -> int:
    from acp_lab.bench.record import Run

    return len(Run.from_json(answer, "the run").frame_ids) + 1


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", type=Path, help="in the BOP layout, with truth")
    parser.add_argument("--parts", type=Path, required=True, help="prepared parts, one folder per data set")
    parser.add_argument("--record", action="store_true", help="write into docs/measured.json")
    options = parser.parse_args()
    parts = options.parts / options.dataset.name
    values = {**preparing(parts), **rendering(), **tracking(options.dataset, parts)}
    for name, row in values.items():
        print(f"{name:22}", ", ".join(f"{key} {value:.3g}" for key, value in row.items()))
    if options.record:
        from benchmarks.measured import record

        about = "what one part, one rendered frame and one tracked frame cost, CPU, one thread"
        record("unit_costs", about, UNITS, options.dataset.name, values)


if __name__ == "__main__":
    main()
