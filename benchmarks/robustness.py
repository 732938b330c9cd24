"""Every scene of BOP data sets, forwards, backwards and with frames left out, from exact and disturbed starts.

Prints one Markdown table per method: recalls at 2, 5 and 10% of the diameter with 95% bootstrap intervals over
sequences, runs that were ever lost, and CPU time per frame; then one line per sequence, and a paired comparison when
there are two methods. Runs are kept in --results; what is there is not run again as long as neither the method nor
the sources that track changed. Times are of one thread's CPU, which other work on the machine lengthens far less than
wall time; still, quote those of a quiet machine.

Example: python -m benchmarks.robustness path/to/dataset --parts out/parts --split checking --results out/acp.jsonl
(parts prepared before: acp-lab prepare MESH --out out/parts/DATASET)
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

from acp_lab.commands import machine

# Before NumPy is imported: its linear algebra reads the number of threads once.
machine.limit_threads(1)

import numpy as np  # noqa: E402

from acp_lab.errors import AcpLabError  # noqa: E402
from acp_lab.evaluation.bootstrap import bootstrap_mean  # noqa: E402
from benchmarks.runs import ORDERS, STARTS, Job, Run, complete, part_name, read_runs  # noqa: E402

CHECKING = frozenset({
    "metal_dev/2", "metal_dev/4", "metal_dev/5", "metal_hard/1", "metal_hard/4", "metal_hard/8",
    "cover_plate", "flange_nut", "pillow_block", "port_block", "fork_end", "tee_fitting",
    "pump_housing", "helical_pinion", "crane_hook", "knurled_knob", "spanner", "impeller", "bent_bracket",
    "door_handle", "timing_pulley", "slotted_nut", "brake_disc", "milling_cutter",
})  # fmt: skip
"""Parts on which a change is accepted; all others are for tuning. Named as `part_name` does."""
SPLITS = ("tuning", "checking", "all")
LIMITS = {"@2": 0.02, "@5": 0.05, "@10": 0.10}
UNITS = {
    "@*": "share of frames with ADD (ADD-S for symmetric parts) below 2, 5, 10% of the diameter, mean over sequences",
    "lost": "runs with ADD above 30% of the diameter in any frame",
    "runs": "runs",
    "ms*": "CPU ms per frame while not lost, first frame left out",
}


def is_in_split(part: str, split: str) -> bool:
    """Whether a part (see `part_name`) belongs to "tuning", "checking" or "all"."""
    return split == "all" or (part in CHECKING) == (split == "checking")


def find_jobs(options: argparse.Namespace) -> list[Job]:
    """All that is asked for; what shares a sequence stands together, so that its frames are decoded once."""
    from acp_lab.sequences.bop import BopDataset
    from acp_lab.tracking.method import method_named
    from acp_lab.tracking.method_file import read_method

    methods = [*map(method_named, options.methods), *map(read_method, options.config)]
    variants = [
        (order, start, seed)
        for order in options.orders
        for start in options.starts
        for seed in range(1 if start == "truth" else options.seeds)
    ]
    data_sets = [BopDataset(root) for root in options.datasets]
    return [
        Job(data.root, options.parts / data.name, scene_id, object_id, method, *variant)
        for data in data_sets
        for scene_id in data.scenes()
        for object_id in data.open_scene(scene_id).object_ids
        if is_in_split(part_name(data.root, object_id), options.split)
        for method in methods
        for variant in variants
    ]


def within(runs: Iterable[Run], limit: float) -> dict[str, np.ndarray]:
    """By sequence: (n,) share of its runs, of one order, that are within the limit in each frame that counts."""
    by_sequence: dict[str, list[np.ndarray]] = {}
    for run in runs:
        by_sequence.setdefault(run.sequence, []).append(run.counted < limit)
    # Seeds of one sequence are not independent: the sequence is the unit, its seeds are averaged.
    return {name: np.mean(found, axis=0) for name, found in by_sequence.items()}


def summary(runs: list[Run]) -> dict[str, float]:
    """Recalls with their intervals, lost runs and times of one group, as fields of measured numbers."""
    fields: dict[str, float] = {}
    for name, limit in LIMITS.items():
        interval = bootstrap_mean(list(within(runs, limit).values()))
        fields |= {name: interval.mean, f"{name} low": interval.low, f"{name} high": interval.high}
    fields |= {"lost": sum(run.lost for run in runs), "runs": len(runs)}
    ms = [value for run in runs for value in run.ms_while_tracked] or [float("nan")]
    return fields | {"ms": float(np.median(ms)), "ms 95%": float(np.quantile(ms, 0.95)), "ms worst": max(ms)}


def grouped(runs: list[Run]) -> dict[tuple[str, str, str], list[Run]]:
    """By data, order and start; data is a data set, or "all" when there are several."""
    data_sets = list(dict.fromkeys(run.sequence.split("/")[0] for run in runs))
    groups: dict[tuple[str, str, str], list[Run]] = {}
    for order in ORDERS:
        for start in STARTS:
            for data in [*data_sets, *(["all"] if len(data_sets) > 1 else [])]:
                found = [
                    run for run in runs
                    if (run.order, run.start) == (order, start) and data in ("all", run.sequence.split("/")[0])
                ]  # fmt: skip
                if found:
                    groups[data, order, start] = found
    return groups


def print_summary(method: str, runs: list[Run]) -> None:
    """One line per data set, order and start."""
    print(f"\n**{method}**\n")
    print("| data (sequences) | order | start | @2 | @5 | @10 | lost / runs | CPU ms median / 95% / worst |")
    print("|---" * 8 + "|")
    for (data, order, start), members in grouped(runs).items():
        found = summary(members)
        shares = (f"{found[n]:.2f} [{found[f'{n} low']:.2f}, {found[f'{n} high']:.2f}]" for n in LIMITS)
        times = f"{found['ms']:.1f} / {found['ms 95%']:.1f} / {found['ms worst']:.1f}"
        count = len({run.sequence for run in members})
        cells = [f"{data} ({count})", order, start, *shares, f"{found['lost']} / {found['runs']}", times]
        print("| " + " | ".join(cells) + " |")


def print_sequences(method: str, runs: list[Run]) -> None:
    """One line per sequence: @2 / @5 of each order and start, and how many runs were lost, where any was."""
    variants = list(dict.fromkeys((order, start) for _, order, start in grouped(runs)))
    print(f"\n{method}, by sequence: @2 / @5, lost runs in brackets\n")
    print("| sequence | part | kind | " + " | ".join(f"{order}, {start}" for order, start in variants) + " |")
    print("|---" * (len(variants) + 3) + "|")
    for sequence in dict.fromkeys(run.sequence for run in runs):
        own = [run for run in runs if run.sequence == sequence]
        cells = [_cell([run for run in own if (run.order, run.start) == variant]) for variant in variants]
        print("| " + " | ".join([sequence, own[0].part, own[0].kind, *cells]) + " |")


def _cell(runs: list[Run]) -> str:
    if not runs:
        return ""
    shares = (np.mean([(run.counted < limit).mean() for run in runs]) for limit in (0.02, 0.05))
    lost = sum(run.lost for run in runs)
    return " / ".join(f"{share:.2f}" for share in shares) + (f" ({lost} of {len(runs)})" if lost else "")


def print_comparison(first: str, second: str, runs: list[Run]) -> None:
    """Second minus first on the runs that both have, in recall with 95% intervals of the paired differences."""
    done = {name: {run.key[2:]: run for run in runs if run.method == name} for name in (first, second)}
    shared = done[first].keys() & done[second].keys()
    print(f"\n**{second} minus {first}**: differences of recall; a star where the interval leaves out 0\n")
    print("| data (sequences) | order | start | @2 | @5 | @10 | lost |\n" + "|---" * 7 + "|")
    for (data, order, start), members in grouped([run for run in runs if run.key[2:] in shared]).items():
        pair = [[run for run in members if run.method == name] for name in (first, second)]
        cells = []
        for limit in LIMITS.values():
            before, after = (within(one, limit) for one in pair)
            gain = bootstrap_mean([after[name] - before[name] for name in before])
            star = " *" if gain.low > 0 or gain.high < 0 else ""
            cells.append(f"{gain.mean:+.3f} [{gain.low:+.3f}, {gain.high:+.3f}]{star}")
        lost = " to ".join(str(sum(run.lost for run in one)) for one in pair)
        count = len({run.sequence for run in members})
        print(f"| {data} ({count}) | {order} | {start} | " + " | ".join([*cells, lost]) + " |")


def keep(method: str, runs: list[Run], split: str, key: str) -> None:
    """Store the groups of one method in the file of measured numbers."""
    from benchmarks.measured import record

    values = {", ".join(group): summary(members) for group, members in grouped(runs).items()}
    sequences = len({run.sequence for run in runs})
    about = f"{method} by data, order of frames and start; no resets, frames below 30% visibility left out"
    record(f"robustness.{method}.{key}", about, UNITS, f"{sequences} sequences, parts for {split}", values)


def some_of(names: Iterable[str]) -> Callable[[str], list[str]]:
    """Type of a command-line option: some of these names, with commas between them."""

    def parse(text: str) -> list[str]:
        chosen = text.split(",")
        unknown = set(chosen) - set(names)
        if unknown:
            raise argparse.ArgumentTypeError(f"{', '.join(sorted(unknown))}: take some of {', '.join(names)}")
        return chosen

    return parse


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("datasets", nargs="+", type=Path)
    parser.add_argument("--parts", type=Path, required=True, help="prepared parts, one folder per data set")
    parser.add_argument("--results", type=Path, required=True, metavar="FILE.jsonl", help="runs: kept and taken up")
    parser.add_argument("--methods", type=lambda text: text.split(","), default=[], help="names: acp,direct-6dof")
    parser.add_argument("--config", nargs="*", type=Path, default=[], metavar="FILE.toml", help="methods as TOML")
    parser.add_argument("--against", type=Path, metavar="FILE.jsonl", help="runs of an earlier state, to compare with")
    parser.add_argument("--split", choices=SPLITS, default="all", help="which half of the parts")
    usual = ["forwards", "backwards", "second", "third"]
    parser.add_argument("--orders", type=some_of(ORDERS), default=usual, help=f"of {','.join(ORDERS)}")
    parser.add_argument("--starts", type=some_of(STARTS), default=list(STARTS), help=f"of {','.join(STARTS)}: deg, mm")
    parser.add_argument("--seeds", type=int, default=5, help="directions of each disturbed start")
    parser.add_argument("--jobs", type=int, default=1, help="processes, one thread each")
    parser.add_argument("--record", action="store_true", help="write to docs/measured.json")
    parser.add_argument("--key", help="what the record is called (default: as the split)")
    options = parser.parse_args()
    if not options.methods and not options.config:
        options.methods = ["acp"]
    if options.against is not None and not options.against.is_file():
        parser.error(f"--against {options.against}: no such file")
    runs: list[Run] = []
    try:
        earlier = [] if options.against is None else read_runs(options.against)
        jobs = find_jobs(options)
        for run in complete(jobs, options.results, options.jobs):
            runs.append(run)
            print(f"\r{len(runs)} of {len(jobs)} runs", end="", file=sys.stderr, flush=True)
    except AcpLabError as error:
        parser.exit(2, f"error: {error}\n")
    print(file=sys.stderr)
    print(f"CPU: {machine.cpu_model()}; {options.jobs} process(es) of one thread; parts: {options.split}")
    asked, ran = {run.key[2:] for run in runs}, {run.method for run in runs}
    comparable = (run for run in earlier if run.method in ran and run.key[2:] in asked)
    last = {(run.method, *run.key[2:]): run for run in comparable}
    runs += [replace(run, method=f"{run.method} of {options.against.stem}") for run in last.values()]
    methods = list(dict.fromkeys(run.method for run in runs))
    for method in methods:
        own = [run for run in runs if run.method == method]
        print_summary(method, own)
        print_sequences(method, own)
        if options.record and method in ran:
            keep(method, own, options.split, options.key or options.split)
    if len(methods) == 2:
        first, second = reversed(methods) if options.against else methods
        print_comparison(first, second, runs)


if __name__ == "__main__":
    main()
