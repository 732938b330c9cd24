"""What each part of `acp` is worth: it is switched off, alone, and the rest runs as it is.

    python -m benchmarks.terms DATASET... --parts out/parts --results out/terms.jsonl --split checking --record checking

Forwards and every second frame, if not told otherwise, from truth and from 5 degrees and 5 mm off. Reported are the
recalls of `acp`, and what is lost without each part: differences of recall with 95% bootstrap intervals over
sequences, in percentage points, and runs that were lost. Runs are kept as `benchmarks.robustness` keeps them.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from acp_lab.commands import machine

# Before NumPy is imported: its linear algebra reads the number of threads once.
machine.limit_threads(1)

import numpy as np  # noqa: E402

from acp_lab.errors import AcpLabError  # noqa: E402
from acp_lab.evaluation.bootstrap import bootstrap_mean  # noqa: E402
from acp_lab.sequences.bop import BopDataset  # noqa: E402
from benchmarks import measured  # noqa: E402
from benchmarks.robustness import LIMITS, SPLITS, is_in_split, some_of, within  # noqa: E402
from benchmarks.runs import ORDERS, Job, Run, complete, part_name  # noqa: E402

if TYPE_CHECKING:
    from acp_lab.tracking.method import Method

STARTS = ("truth", "5")
UNIT = {
    "@*": "share of frames with ADD (ADD-S) below 2, 5% of the diameter; without a part: the difference to all of acp",
    "lost": "runs with an ADD above 30% at any time",
    "runs": "runs",
}


def without() -> dict[str, Method]:
    """By the name of what is missing: `acp` without it, named so; "nothing" is `acp` itself."""
    from acp_lab.tracking.confidence import EDGES_ALONE
    from acp_lab.tracking.learning.contour_offsets import OffsetConfig
    from acp_lab.tracking.learning.edge_profiles import ProfileConfig
    from acp_lab.tracking.learning.knowledge import Off, SampleLearning
    from acp_lab.tracking.method import ACP
    from acp_lab.tracking.prediction import ConstantVelocityPrediction
    from acp_lab.tracking.priors import ControlPointDamping
    from acp_lab.tracking.recovery import Alternatives
    from acp_lab.tracking.start import TrustedStart
    from acp_lab.tracking.targets.normals import NormalSearch

    edges, *others = ACP.targets
    assert isinstance(edges, NormalSearch)
    no_prior = (ControlPointDamping(),)
    methods = {
        "nothing": ACP,
        "colours beside edges": replace(ACP, targets=(edges,), confidence=EDGES_ALONE),
        "the motion prior": replace(ACP, priors=no_prior),
        "the Kalman filter": replace(
            ACP, priors=no_prior, prediction=ConstantVelocityPrediction(), sight=Off(), uncertainty=Off()
        ),
        "the part's last picture": replace(ACP, sight=Off()),
        "the memory of edges": replace(ACP, learning=SampleLearning(memory=Off())),
        "expected offsets": replace(ACP, learning=SampleLearning(offsets=Off())),
        "edge profiles": replace(ACP, learning=SampleLearning(profiles=Off())),
        "what edges have in common": replace(
            ACP, learning=SampleLearning(profiles=ProfileConfig(evidence_share=0.0))
        ),
        "motion blur": replace(ACP, learning=SampleLearning(blur=Off())),
        "offsets that follow": replace(ACP, learning=SampleLearning(offsets=OffsetConfig(follow_rate=0.0))),
        "reliability": replace(ACP, learning=SampleLearning(reliability=Off())),
        "shifts to the bright side": replace(ACP, learning=SampleLearning(polarity=Off())),
        "shared image edges": replace(ACP, targets=(replace(edges, sharing=Off()), *others)),
        "linear light": replace(ACP, targets=(replace(edges, search=replace(edges.search, gamma=1.0)), *others)),
        "sharpening": replace(ACP, targets=(replace(edges, search=replace(edges.search, sharpening=0.0)), *others)),
        "the lens learnt": replace(ACP, learning=SampleLearning(lens=Off())),
        "less asked of faint pictures": replace(
            ACP, targets=(replace(edges, search=replace(edges.search, faint_below=0.0)), *others)
        ),
        "the trusted start": replace(ACP, start=Off()),
        "agreement both ways": replace(ACP, start=TrustedStart(both_ways=False)),
        "alternatives": replace(ACP, recovery=Off()),
        "the wide cloud": replace(ACP, recovery=Alternatives(wide_below=0.0)),
        "the way back": replace(ACP, way_back=Off()),
        "the check of turns": replace(ACP, turns=Off()),
        "matched tones": replace(ACP, tones=Off()),
    }
    return {name: replace(method, name=f"without {name}") for name, method in methods.items()}


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("datasets", nargs="+", type=Path)
    parser.add_argument("--parts", type=Path, required=True, help="prepared parts, one folder per data set")
    parser.add_argument("--results", type=Path, required=True, metavar="FILE.jsonl", help="runs: kept and taken up")
    parser.add_argument("--split", choices=SPLITS, default="all")
    parser.add_argument("--jobs", type=int, default=1, help="processes, one thread each")
    parser.add_argument("--orders", type=some_of(ORDERS), default=["forwards", "second"], help=f"of {','.join(ORDERS)}")
    parser.add_argument("--seeds", type=int, default=1, help="directions of each disturbed start")
    parser.add_argument("--only", action="append", metavar="PART", help="switch off this one; may be given repeatedly")
    parser.add_argument("--record", metavar="KEY")
    options = parser.parse_args()
    methods = without()
    for name in options.only or ():
        if name not in methods:
            parser.error(f"--only {name}: give one of {', '.join(methods)}")
    if options.only:
        methods = {name: methods[name] for name in ("nothing", *options.only)}
    jobs, runs = _jobs(options, list(methods.values())), list[Run]()
    try:
        for run in complete(jobs, options.results, options.jobs):
            runs.append(run)
            print(f"\r{len(runs)} of {len(jobs)} runs", end="", file=sys.stderr, flush=True)
    except AcpLabError as error:
        parser.exit(2, f"error: {error}\n")
    rows = {name: _row([run for run in runs if run.method == f"without {name}"], runs) for name in methods}
    print("\n\n| without | " + " | ".join(next(iter(rows.values()))) + " |")
    for name, row in rows.items():
        print(f"| {name} | " + " | ".join(f"{value:.3f}" for value in row.values()) + " |")
    if options.record:
        data = f"{len({run.sequence for run in runs})} sequences, parts for {options.split}"
        about = f"acp with one part switched off, {', '.join(options.orders)}, from truth and 5 degrees, 5 mm"
        measured.record(f"terms.{options.record}", about, UNIT, data, rows)


def _jobs(options: argparse.Namespace, methods: list[Method]) -> list[Job]:
    """Scene by scene, since its frames are decoded once for all methods in a row."""
    found = []
    for root in options.datasets:
        data = BopDataset(root)
        for scene_id in data.scenes():
            for object_id in data.open_scene(scene_id).object_ids:
                if is_in_split(part_name(data.root, object_id), options.split):
                    found += [
                        Job(data.root, options.parts / data.name, scene_id, object_id, method, order, start, seed)
                        for method in methods
                        for start in STARTS
                        for seed in range(1 if start == "truth" else options.seeds)
                        for order in options.orders
                    ]
    return found


def _row(runs: list[Run], every: list[Run]) -> dict[str, float]:
    """Recall of `acp` itself; of the others the difference, by start."""
    whole = [run for run in every if run.method == "without nothing"]
    row: dict[str, float] = {}
    for start in STARTS:
        for name in ("@2", "@5"):
            found = _recalls(runs, start, LIMITS[name])
            if runs[0].method != "without nothing":
                of_acp = _recalls(whole, start, LIMITS[name])
                found = {sequence: recall - of_acp[sequence] for sequence, recall in found.items()}
            interval = bootstrap_mean([np.atleast_1d(value) for value in found.values()])
            row |= {f"{name} {start}": interval.mean, f"{name} {start} low": interval.low}
            row |= {f"{name} {start} high": interval.high}
    return row | {"lost": sum(run.lost for run in runs), "runs": len(runs)}


def _recalls(runs: list[Run], start: str, limit: float) -> dict[str, float]:
    """By sequence: mean of the recalls of its orders."""
    recalls: dict[str, list[float]] = {}
    for order in dict.fromkeys(run.order for run in runs):
        for sequence, shares in within([r for r in runs if (r.start, r.order) == (start, order)], limit).items():
            recalls.setdefault(sequence, []).append(float(shares.mean()))
    return {sequence: sum(found) / len(found) for sequence, found in recalls.items()}


if __name__ == "__main__":
    main()
