"""Runs in which a tracker is told something that is not so, of its camera or of its part.

Then the same image means another pose, so errors are to the pose that explains the image best with what was told.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from acp_lab.evaluation.part_metric import PartMetric
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import disturb_pose
from acp_lab.sequences.bop import BopDataset, BopScene
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.method import Method, method_named
from acp_lab.tracking.tracker import Tracker
from benchmarks import measured
from benchmarks.robustness import SPLITS, is_in_split
from benchmarks.runs import LOST, STARTS, part_name, readable_frames, visible_frames

STARTS_TOLD = ("truth", "5")
UNIT = {
    "@*": "share of frames with ADD (ADD-S) below 2, 5% of the diameter, to the pose that explains the image best",
    "lost": "runs in which that was ever above 30%",
    "runs": "runs",
    "moved": "ADD (ADD-S) of the pose that explains the image best, to the truth, as a share of the diameter, median",
}


RECALLS = {
    "@*": "share of frames with ADD (ADD-S) below 2, 5% of the diameter",
    "lost": "runs in which that was ever above 30%",
    "runs": "runs",
}


@dataclass(frozen=True)
class TrueFrame:
    """A frame as it was taken: truth, (4, 4) cam_T_obj in mm; counts: whether enough of the part is visible."""

    frame: Frame
    truth: FloatArray
    counts: bool


@dataclass(frozen=True)
class Told:
    """A frame as it is told: best, (4, 4) cam_T_obj in mm, explains it; counts as in `TrueFrame`."""

    frame: Frame
    best: FloatArray
    counts: bool


@dataclass(frozen=True)
class ToldRun:
    """A run in which something was told wrong, the first frame left out.

    told: what; errors: of the frames that count; moved: of all of them. ADD(-S) as a share of the diameter.
    """

    told: str
    start: str
    errors: FloatArray
    moved: FloatArray


Run = TypeVar("Run", bound=ToldRun)


def arguments(doc: str | None) -> argparse.ArgumentParser:
    """The command line of a benchmark of such runs."""
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("datasets", nargs="+", type=Path)
    parser.add_argument("--parts", type=Path, required=True)
    parser.add_argument("--method", default="acp")
    parser.add_argument("--split", choices=SPLITS, default="all")
    parser.add_argument("--record", metavar="KEY")
    return parser


def rows_of(
    args: argparse.Namespace, runs_of: Callable[[BopScene], Iterator[Run]], row: Callable[[list[Run]], dict[str, float]]
) -> dict[str, dict[str, float]]:
    """Run all scenes of the split and print what comes of it; a row by what was told and the start."""
    runs = dict[str, list[Run]]()
    for root in args.datasets:
        for scene_id in BopDataset(root).scenes():
            scene = BopDataset(root).open_scene(scene_id)
            if is_in_split(part_name(root, scene.object_ids[0]), args.split):
                new = {f"{run.told}, {run.start}": run for run in runs_of(scene)}
                errors = [f"{name}: {100 * np.median(run.errors):.1f}%" for name, run in new.items()]
                print(root.name, scene_id, *errors, sep="  ", flush=True)
                for name, run in new.items():
                    runs.setdefault(name, []).append(run)
    rows = {name: row(some) for name, some in runs.items()}
    for name, values in rows.items():
        print(name, values)
    return rows


def record(
    args: argparse.Namespace, key: str, what: str, unit: dict[str, str], rows: dict[str, dict[str, float]]
) -> None:
    """Store rows, where that was asked for. what: that was told."""
    if args.record:
        about = f"{what}; tracker {args.method}, forwards, parts for {args.split}"
        measured.record(f"{key}.{args.record}", about, unit, ", ".join(root.name for root in args.datasets), rows)


def main_of_recalls(
    doc: str | None, key: str, what: str, runs_of: Callable[[BopScene, Path, Method], Iterator[ToldRun]]
) -> None:
    """The main program of a benchmark whose rows are recalls; key, what: see `record`; runs_of: of a scene, parts."""
    args = arguments(doc).parse_args()
    method = method_named(args.method)
    rows = rows_of(args, lambda scene: runs_of(scene, args.parts, method), lambda runs: recalls(r.errors for r in runs))
    record(args, key, what, RECALLS, rows)


def row_of(runs: Sequence[ToldRun]) -> dict[str, float]:
    """Recalls and how far poses moved, over runs."""
    moved = float(np.median(np.concatenate([run.moved for run in runs])))
    return recalls(run.errors for run in runs) | {"moved": moved}


def true_frames(scene: BopScene) -> list[TrueFrame]:
    """Of a scene's first object, from the first frame that counts onwards."""
    object_id = scene.object_ids[0]
    frames = readable_frames(scene)
    truths = {f.index: truth for f in frames if (truth := scene.truth(f.index, object_id)) is not None}
    counts = visible_frames(scene.folder, object_id, truths)
    true = [TrueFrame(f, truths[f.index], counts[f.index]) for f in frames if f.index in truths]
    return true[next(number for number, one in enumerate(true) if one.counts) :]


def as_taken(frames: Iterable[TrueFrame]) -> list[Told]:
    """Frames of which nothing is told wrong."""
    return [Told(one.frame, one.truth, one.counts) for one in frames]


def follow(
    told: Sequence[Told], tracker: Tracker, metric: PartMetric, start: str, seed: Sequence[int], times: float = 1.0
) -> FloatArray:
    """ADD(-S) as a share of the diameter, of the frames that count but for the first.

    start: one of `STARTS`; times: by which its mm are multiplied.
    """
    rng, (angle_deg, shift_mm) = np.random.default_rng(seed), STARTS[start]
    tracker.start(told[0].frame, disturb_pose(told[0].best, tracker.part.box_centre, angle_deg, times * shift_mm, rng))
    errors = list[float]()
    for one in told[1:]:
        result = tracker.track(one.frame)
        if one.counts:
            errors.append(metric.share(result.cam_T_obj, one.best))
    return np.array(errors)


def recalls(errors: Iterable[FloatArray]) -> dict[str, float]:
    """Means over runs, and how many of these were ever lost; errors: of each, ADD(-S) as a share of the diameter."""
    runs = list(errors)
    return {
        "@2": float(np.mean([(run < 0.02).mean() for run in runs])),
        "@5": float(np.mean([(run < 0.05).mean() for run in runs])),
        "lost": sum(bool((run > LOST).any()) for run in runs),
        "runs": len(runs),
    }
