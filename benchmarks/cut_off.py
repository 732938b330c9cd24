"""The image's border cuts the part off: is it kept, and does the tracker say so?

    python -m benchmarks.cut_off metal_hard metal_dev own_checking --parts out/parts --split checking --record checking

Of each picture only a box is left, whose border crosses the part, from the left, the right, the top or the bottom,
scene by scene in turn. "staying": the same box in all frames, chosen so that 40% of the silhouette lies beyond it in
the median of them, or as much as leaves none with more than 65% beyond it. "passing": a border that comes in until 60%
lies beyond it, in the middle of the sequence, and goes out again. Forwards and backwards, from truth and from 5 degrees
and 5 mm off, with defaults.

A frame counts when at least 30% of the part is in sight, by its visible share in the whole picture and by the share of
its silhouette in the box. Deep: less than 60% of the silhouette is in the box. PARTS holds prepared parts, or one
folder of them per data set.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from acp_lab.commands.machine import limit_threads

limit_threads(1)  # before NumPy is imported

import numpy as np  # noqa: E402

from acp_lab.bench.runner import follow  # noqa: E402
from acp_lab.cad.part import Part  # noqa: E402
from acp_lab.cad.raycast import hit_map, make_caster  # noqa: E402
from acp_lab.evaluation.part_metric import PartMetric  # noqa: E402
from acp_lab.geometry.pose import disturb_pose  # noqa: E402
from acp_lab.sequences.bop import BopDataset, BopScene  # noqa: E402
from acp_lab.sequences.frame import Frame  # noqa: E402
from acp_lab.tracking.method import Method, method_named  # noqa: E402
from acp_lab.tracking.tracker import Tracker  # noqa: E402
from benchmarks import measured  # noqa: E402
from benchmarks.faulty_frames import Box  # noqa: E402
from benchmarks.robustness import SPLITS, is_in_split  # noqa: E402
from benchmarks.runs import LOST, STARTS, VISIBLE, part_name, prepared_part_of, readable_frames, visible_shares  # noqa: E402

SIDES = ("left", "right", "top", "bottom")
MEDIAN_BEYOND, MOST_BEYOND, PASSING_BEYOND = 0.4, 0.65, 0.6
DEEP = 0.6
KINDS = ("staying", "passing")
UNIT = {
    "@*": "share of frames with ADD (ADD-S for symmetric parts) below 2, 5% of the diameter, mean over runs",
    "lost": "runs in which ADD was ever above 30%",
    "runs": "runs",
    "deep": "frames of which less than 60% of the silhouette is in the picture",
    "deep quality": "mean quality of these",
    "deep there": "share of these with ADD below 10%",
}


@dataclass(frozen=True)
class CutFrame:
    """A frame of which only a box is left. shown: share of the silhouette in it; counts: see the module's head."""

    frame: Frame
    shown: float
    counts: bool


@dataclass(frozen=True)
class CutRun:
    """A run, the first frame left out. errors: ADD(-S) as a share of the diameter; shown, counts: of its frames."""

    kind: str
    start: str
    errors: np.ndarray
    qualities: np.ndarray
    shown: np.ndarray
    counts: np.ndarray


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("datasets", nargs="+", type=Path)
    parser.add_argument("--parts", type=Path, required=True)
    parser.add_argument("--method", default="acp")
    parser.add_argument("--split", choices=SPLITS, default="all")
    parser.add_argument("--record", metavar="KEY")
    args = parser.parse_args()
    runs: list[CutRun] = []
    scenes = [BopDataset(root).open_scene(scene_id) for root in args.datasets for scene_id in BopDataset(root).scenes()]
    for number, scene in enumerate(scenes):
        root = scene.dataset.root
        if is_in_split(part_name(root, scene.object_ids[0]), args.split):
            new = list(_runs(scene, args.parts, method_named(args.method), SIDES[number % len(SIDES)]))
            told = [f"{run.kind}, {run.start}: worst {100 * run.errors[run.counts].max():.1f}%" for run in new]
            print(root.name, scene.scene_id, *told, sep="  ", flush=True)
            runs += new
    values = {
        f"{kind}, {start}": _row([run for run in runs if (run.kind, run.start) == (kind, start)])
        for kind in KINDS
        for start in ("truth", "5")
    }
    for name, row in values.items():
        print(name, row)
    if args.record:
        about = f"parts that the image's border cuts off; tracker {args.method}, defaults, parts for {args.split}"
        names = ", ".join(root.name for root in args.datasets)
        measured.record(f"cut_off.{args.record}", about, UNIT, names, values)


def _runs(scene: BopScene, parts: Path, method: Method, side: str) -> Iterator[CutRun]:
    object_id = scene.object_ids[0]
    model = prepared_part_of(scene, parts)
    metric = PartMetric(model.part)
    frames = readable_frames(scene)
    truths = {f.index: truth for f in frames if (truth := scene.truth(f.index, object_id)) is not None}
    frames = [frame for frame in frames if frame.index in truths]
    in_sight = visible_shares(scene.folder, object_id)
    beyond = np.array([_beyond(model.part, frame, truths[frame.index], side) for frame in frames])
    for kind in KINDS:
        borders = _staying(beyond) if kind == "staying" else _passing(beyond)
        cut = [
            _cut(frame, side, int(at), 1.0 - share[at], in_sight.get(frame.index, 1.0))
            for frame, at, share in zip(frames, borders, beyond, strict=True)
        ]
        for ordered in (cut, cut[::-1]):
            for start in ("truth", "5"):
                yield _run(kind, start, ordered, Tracker(model, method), metric, truths, (scene.scene_id, object_id))


def _beyond(part: Part, frame: Frame, cam_T_obj: np.ndarray, side: str) -> np.ndarray:
    """(n + 1,) share of the silhouette within the first 0, 1, ... n px from a side of the picture."""
    _, face = hit_map(part, make_caster(part), frame.camera, cam_T_obj)
    columns = (face >= 0).sum(0 if side in ("left", "right") else 1)
    if side in ("right", "bottom"):
        columns = columns[::-1]
    return np.concatenate([[0.0], np.cumsum(columns) / max(columns.sum(), 1)])


def _staying(beyond: np.ndarray) -> np.ndarray:
    """(k,) px from the side to the border, the same for all k frames."""
    allowed = np.flatnonzero(beyond.max(0) <= MOST_BEYOND)[::-1]  # the farthest of equals
    at = allowed[np.abs(np.median(beyond[:, allowed], axis=0) - MEDIAN_BEYOND).argmin()]
    return np.full(len(beyond), at)


def _passing(beyond: np.ndarray) -> np.ndarray:
    """(k,) px from the side to the border in each of k frames."""
    wanted = PASSING_BEYOND * np.sin(np.pi * np.arange(len(beyond)) / max(len(beyond) - 1, 1)) ** 2
    return np.array([np.searchsorted(row, share, side="right") - 1 for row, share in zip(beyond, wanted, strict=True)])


def _cut(frame: Frame, side: str, at: int, shown: float, in_sight: float) -> CutFrame:
    height, width = frame.image.shape[:2]
    box: Box = {
        "left": (at, 0, width, height),
        "right": (0, 0, width - at, height),
        "top": (0, at, width, height),
        "bottom": (0, 0, width, height - at),
    }[side]
    x0, y0, x1, y1 = box
    image = np.ascontiguousarray(frame.image[y0:y1, x0:x1])
    camera = frame.camera.cropped(x0, y0, x1 - x0, y1 - y0)
    return CutFrame(replace(frame, image=image, camera=camera), shown, in_sight * shown >= VISIBLE)


def _run(
    kind: str, start: str, cut: list[CutFrame], tracker: Tracker, metric: PartMetric, truths: dict[int, Any],
    seed: tuple[int, int],
) -> CutRun:  # fmt: skip
    begin = next(number for number, one in enumerate(cut) if one.counts)
    cut = cut[begin:]
    centre = tracker.model.part.box_centre
    pose = disturb_pose(truths[cut[0].frame.index], centre, *STARTS[start], np.random.default_rng([0, *seed]))
    steps = follow(tracker, [one.frame for one in cut], pose, truths.get, metric.share)
    found = [(metric.share(step.cam_T_obj, truths[step.frame_id]), step.quality) for step in steps][1:]
    errors, qualities = np.array(found).T
    shown, counts = np.array([one.shown for one in cut[1:]]), np.array([one.counts for one in cut[1:]])
    return CutRun(kind, start, errors, qualities, shown, counts)


def _row(runs: list[CutRun]) -> dict[str, float]:
    """Of runs of one kind and start, as a row of measured numbers."""
    counted = [run.errors[run.counts] for run in runs]
    deep = [(run.errors[here], run.qualities[here]) for run in runs for here in [run.counts & (run.shown < DEEP)]]
    errors, qualities = (np.concatenate(found) for found in zip(*deep, strict=True))
    return {
        "@2": float(np.mean([(one < 0.02).mean() for one in counted])),
        "@5": float(np.mean([(one < 0.05).mean() for one in counted])),
        "lost": sum(bool((one > LOST).any()) for one in counted),
        "runs": len(runs),
        "deep": len(errors),
        "deep quality": float(qualities.mean()),
        "deep there": float((errors < 0.1).mean()),
    }


if __name__ == "__main__":
    main()
