"""Parts tracked from where the detector finds them.

    python -m benchmarks.found_starts toothed_tuning toothed_checking --parts PARTS --record toothed
    python -m benchmarks.found_starts metal_hard metal_dev own_checking --parts PARTS --split checking --accepted \
        --record checking

In the first frame of each sequence, and in every sixth after it while twelve more follow, the detector's best
hypothesis is taken for a start, whatever its score or only where it is accepted, and tracked to the end: as a pose that
was found in the frame, with the first frame asked at every turn by a tooth (`turns.start_evidence`) and without, and as
one that somebody gave. PARTS holds prepared parts, or one folder of them per data set. Times are CPU ms
of the first frame.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from acp_lab.commands.machine import limit_threads

limit_threads(1)  # before NumPy is imported

import numpy as np  # noqa: E402

from acp_lab.evaluation.part_metric import PartMetric  # noqa: E402
from acp_lab.geometry.arrays import FloatArray  # noqa: E402
from acp_lab.sequences.bop import BopDataset  # noqa: E402
from acp_lab.tracking.find import Finder  # noqa: E402
from acp_lab.tracking.method import ACP, Method  # noqa: E402
from acp_lab.tracking.tracker import Tracker  # noqa: E402
from acp_lab.tracking.turn_check import TurnCheck  # noqa: E402
from benchmarks import measured  # noqa: E402
from benchmarks.robustness import SPLITS, is_in_split  # noqa: E402
from benchmarks.runs import part_name, prepared_part_of  # noqa: E402
from benchmarks.told_wrong import TrueFrame, true_frames  # noqa: E402

EVERY, LEAST_FRAMES = 6, 12
WITHIN = 0.05
WAYS = {
    "found": (ACP, True),
    "found, not asked": (replace(ACP, turns=TurnCheck(start_evidence=1e9)), True),
    "given": (ACP, False),
}
"""The method, and whether it is told that the start was found in the frame."""
UNIT = {
    "runs": "runs",
    "begins": "share of runs whose first frame has an ADD(-S) below 5% of the diameter",
    "@2": "share of all frames with an ADD(-S) below 2%, mean over runs",
    "@5": "below 5%",
    "ends": "share of runs whose last frame has such an ADD(-S)",
    "ms": "CPU ms of the first frame, median",
}


@dataclass(frozen=True, eq=False)
class Run:
    """errors: (n,) ADD(-S) of each frame as a share of the diameter. begin_ms: CPU time of the first one."""

    errors: FloatArray
    begin_ms: float


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("datasets", nargs="+", type=Path)
    parser.add_argument("--parts", type=Path, required=True)
    parser.add_argument("--split", choices=SPLITS, default="all")
    parser.add_argument("--accepted", action="store_true", help="only hypotheses that the detector accepts")
    parser.add_argument("--record", metavar="KEY")
    args = parser.parse_args()
    rows = dict[str, dict[str, float]]()
    for root in args.datasets:
        runs: dict[str, list[Run]] = {name: [] for name in WAYS}
        for scene_id in BopDataset(root).scenes():
            scene = BopDataset(root).open_scene(scene_id)
            if not is_in_split(part_name(root, scene.object_ids[0]), args.split):
                continue
            finder = Finder(prepared_part_of(scene, args.parts))
            frames = true_frames(scene)
            for first in range(0, max(1, len(frames) - LEAST_FRAMES), EVERY):
                found = finder.find(frames[first].frame)
                if found and (found[0].is_accepted or not args.accepted):
                    for name, (method, is_found) in WAYS.items():
                        runs[name].append(follow(frames[first:], finder, found[0].cam_T_obj, method, is_found))
            print(root.name, scene_id, {name: row(some)["@5"] for name, some in runs.items()}, flush=True)
        rows |= {f"{root.name}, {name}": row(some) for name, some in runs.items()}
    for name, values in rows.items():
        print(name, values)
    if args.record:
        about = "tracked from the detector's best hypothesis"
        measured.record(f"found_starts.{args.record}", about, UNIT, ", ".join(r.name for r in args.datasets), rows)


def follow(
    frames: Sequence[TrueFrame], finder: Finder, start: FloatArray, method: Method, is_found: bool = True
) -> Run:
    """Track to the end from a pose (4, 4)."""
    metric, tracker = PartMetric(finder.model.part), Tracker(finder.model, method)
    begin_s = time.thread_time()
    results = [tracker.start(frames[0].frame, start, is_found)]
    begin_ms = 1e3 * (time.thread_time() - begin_s)
    results += (tracker.track(one.frame) for one in frames[1:])
    errors = [metric.share(result.cam_T_obj, one.truth) for result, one in zip(results, frames, strict=True)]
    return Run(np.array(errors), begin_ms)


def row(runs: Sequence[Run]) -> dict[str, float]:
    """See `UNIT`."""
    return {
        "runs": len(runs),
        "begins": float(np.mean([run.errors[0] < WITHIN for run in runs])),
        "@2": float(np.mean([(run.errors < 0.02).mean() for run in runs])),
        "@5": float(np.mean([(run.errors < WITHIN).mean() for run in runs])),
        "ends": float(np.mean([run.errors[-1] < WITHIN for run in runs])),
        "ms": float(np.median([run.begin_ms for run in runs])),
    }


if __name__ == "__main__":
    main()
