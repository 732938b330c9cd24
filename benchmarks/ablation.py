"""The paper's ablation (Table III) on BOP data sets: control points, without control points, without their regression.

Each method gets the same search over its settings: alpha, fixed or annealed, with the same number of steps.
What a sequence is scored with is chosen on all the *other* sequences (leave one out), by the share of frames
within 5%. From truth, no resets, the first frame left out, one thread. Intervals are 95% from a hierarchical
block bootstrap.

Example: python -m benchmarks.ablation path/to/dataset --parts out/parts
(parts prepared before: acp-lab prepare MESH --out out/parts/DATASET --generator autoencoder)
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any, cast

from acp_lab.commands import machine

# Before NumPy is imported: its linear algebra reads the number of threads once.
machine.limit_threads(1)

import numpy as np  # noqa: E402

from acp_lab.evaluation.bootstrap import bootstrap_mean  # noqa: E402

if TYPE_CHECKING:
    from acp_lab.sequences.bop import BopScene
    from acp_lab.sequences.frame import Frame, UnreadableFrame
    from acp_lab.sequences.protocol import Sequence
    from acp_lab.tracking.method import Method

METHOD_NAMES = ("acp-paper", "direct-6dof", "unoptimised-points")
ALPHAS = (0.035, 0.05, 0.07, 0.10)
SCHEDULES = ((1.0,), (1.0, 0.6, 0.4))
STEPS = 12
LIMITS = (0.02, 0.05, 0.10)


@dataclass(frozen=True)
class Track:
    """One run: ADD as a share of the diameter per frame, and ms per frame."""

    sequence: str
    method: str
    setting: str
    errors: np.ndarray
    ms: float


class DecodedScene:
    """A scene whose frames are decoded once for all runs."""

    def __init__(self, scene: BopScene) -> None:
        self._scene = scene
        self._frames = list(scene.frames())

    def __getattr__(self, name: str) -> Any:
        return getattr(self._scene, name)

    def frames(self, max_frames: int | None = None) -> Iterator[Frame | UnreadableFrame]:
        return iter(self._frames[:max_frames])


def settings(method: Method) -> Iterator[tuple[str, Method]]:
    """The searched variants of a method, by name; the levels share the steps, so that all cost about the same."""
    from acp_lab.tracking.schedule import ShareSchedule

    own = method.schedule if isinstance(method.schedule, ShareSchedule) else ShareSchedule()
    for alpha, shares in product(ALPHAS, SCHEDULES):
        name = f"alpha {alpha:g}, {'annealed' if len(shares) > 1 else 'fixed'}"
        schedule, solver = replace(own, alpha=alpha, shares=shares), replace(method.solver, steps=STEPS // len(shares))
        yield name, replace(method, schedule=schedule, solver=solver)


def track(root: Path, parts: Path, methods: list[tuple[str, str, Method]]) -> Iterator[Track]:
    """Run (name, setting, method) on every scene of a data set whose part has an auto-encoder."""
    from acp_lab.errors import AcpLabError
    from acp_lab.evaluation import evaluate
    from acp_lab.prepared_part import PreparedPart
    from acp_lab.sequences.bop import BopDataset
    from acp_lab.tracking.tracker import Tracker

    dataset = BopDataset(root)
    for scene_id in dataset.scenes():
        scene = dataset.open_scene(scene_id)
        object_id = scene.object_ids[0]
        name = f"{dataset.name}/{scene_id}"
        try:
            model = PreparedPart.load(parts / dataset.name / f"obj_{object_id:06d}", dataset.part_path(object_id))
            decoded = cast("Sequence", DecodedScene(scene))
            for method_name, setting, method in methods:
                run = Tracker(model, method).run(decoded, scene.first_pose)
                scored = evaluate(run, scene).objects[0]
                errors = np.array(scored.errors.distance, float)
                ms = 1e3 * median(result.timings.total_s for result in run.results[object_id][1:])
                yield Track(name, method_name, setting, errors, ms)
        except AcpLabError as error:
            print(f"{name}: left out: {error}")


def chosen_without(sequence: str, tracks: list[Track]) -> str:
    """The setting with the most frames within 5%, mean over all sequences but one."""
    shares: dict[str, list[float]] = {}
    for item in tracks:
        if item.sequence != sequence:
            shares.setdefault(item.setting, []).append(float((item.errors < 0.05).mean()))
    return max(shares, key=lambda setting: float(np.mean(shares[setting])))


def print_table(tracks: list[Track]) -> dict[str, dict[str, list[float]]]:
    """Per method and data set: shares with intervals, by leave-one-out settings; also as rows to be recorded."""
    sequences = sorted({item.sequence for item in tracks})
    sets = {
        name: [s for s in sequences if s.startswith(name + "/")]
        for name in sorted({s.rsplit("/", 1)[0] for s in sequences})
    }
    if len(sets) > 1:
        sets["all"] = sequences
    print("\n| data | method | @2% | @5% | @10% | ms | settings chosen |")
    print("|---|---|---|---|---|---|---|")
    rows = {}
    for data, members in sets.items():
        for method in dict.fromkeys(item.method for item in tracks):
            own = [item for item in tracks if item.method == method]
            best = [next(t for t in own if t.sequence == s and t.setting == chosen_without(s, own)) for s in members]
            shares = [bootstrap_mean([(t.errors < limit).astype(float) for t in best]) for limit in LIMITS]
            rows[f"{data}: {method}"] = {
                f"@{100 * limit:g}": [share.mean, share.low, share.high]
                for limit, share in zip(LIMITS, shares, strict=True)
            }
            used = "; ".join(sorted({t.setting for t in best}))
            cells = [f"{data} ({len(members)})", method, *map(str, shares), f"{median(t.ms for t in best):.0f}", used]
            print("| " + " | ".join(cells) + " |")
    return rows


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("datasets", nargs="+", type=Path)
    parser.add_argument("--parts", type=Path, required=True, help="prepared parts, one folder per data set")
    parser.add_argument("--config", nargs="*", type=Path, default=[], help="further methods as TOML, searched likewise")
    parser.add_argument("--json", type=Path, help="also keep the errors of every frame")
    parser.add_argument("--record", action="store_true", help="write to docs/measured.json")
    options = parser.parse_args()
    from acp_lab.tracking.method import METHODS
    from acp_lab.tracking.method_file import read_method

    print(f"CPU: {machine.cpu_model()}; one thread")
    wanted = [*(METHODS[name] for name in METHOD_NAMES), *map(read_method, options.config)]
    methods = [(method.name, name, variant) for method in wanted for name, variant in settings(method)]
    tracks = [item for root in options.datasets for item in track(root, options.parts, methods)]
    if options.json is not None:
        kept = [{**vars(item), "errors": item.errors.round(5).tolist()} for item in tracks]
        options.json.write_text(json.dumps(kept))
    rows = print_table(tracks)
    if options.record:
        from benchmarks.measured import record

        unit = "share of frames with ADD below 2, 5, 10% of the diameter, and its 95% interval"
        about = "the paper's Table III: leave-one-out search over alpha and annealing, hierarchical block bootstrap"
        data = ", ".join(sorted({item.sequence for item in tracks}))
        record("ablation", about, {"@*": unit}, data, rows)


if __name__ == "__main__":
    main()
