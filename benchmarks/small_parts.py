"""Is a small part found, and does a start set by hand snap to it?

    python -m benchmarks.small_parts metal_hard metal_dev own_checking --parts PARTS --split checking --record checking

Three frames of each sequence, the third, the middle one and the third from the end, are scaled down until the part's
diameter appears as long as it is told here; "as it is": not scaled. Find: the best hypothesis without a pose. Snap:
from 8 degrees and 8 mm off. Frames whose part is smaller as they are do without.

PARTS holds prepared parts, or one folder of them per data set. Times are CPU seconds of one thread, templates are made
before.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from acp_lab.commands.machine import limit_threads

limit_threads(1)  # before NumPy is imported

import numpy as np  # noqa: E402

from acp_lab.errors import TrackingError  # noqa: E402
from acp_lab.evaluation.part_metric import PartMetric  # noqa: E402
from acp_lab.geometry.pose import disturb_pose  # noqa: E402
from acp_lab.sequences.bop import BopDataset, BopScene  # noqa: E402
from acp_lab.tracking.find import ACCEPTED, Finder  # noqa: E402
from acp_lab.tracking.magnification import appears_px  # noqa: E402
from acp_lab.tracking.snap import SnapConfig, snap  # noqa: E402
from benchmarks import measured  # noqa: E402
from benchmarks.part_sizes import scaled  # noqa: E402
from benchmarks.robustness import SPLITS, is_in_split  # noqa: E402
from benchmarks.runs import part_name, prepared_part_of, readable_frames  # noqa: E402

SIZES_PX = (None, 120, 80, 50, 35)
HOW = "find", "snap"
OFF_DEG, OFF_MM = 8.0, 8.0
UNIT = {
    "frames": "frames",
    "@*": "share of frames with ADD (ADD-S for symmetric parts) below 2, 5, 10% of the diameter",
    "accepted": "share of frames whose pose is accepted, by its score or quality",
    "right": "share of these with ADD below 10%",
    "time": "median CPU s per frame",
}


@dataclass(frozen=True)
class Found:
    """One pose: how, the part's size, ADD(-S) as a share of the diameter, infinite for none; and what was said."""

    how: str
    size_px: int | None
    error: float
    accepted: bool
    time_s: float


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("datasets", nargs="+", type=Path)
    parser.add_argument("--parts", type=Path, required=True)
    parser.add_argument("--split", choices=SPLITS, default="all")
    parser.add_argument("--record", metavar="KEY")
    args = parser.parse_args()
    found: list[Found] = []
    for root in args.datasets:
        for scene_id in BopDataset(root).scenes():
            scene = BopDataset(root).open_scene(scene_id)
            if is_in_split(part_name(root, scene.object_ids[0]), args.split):
                new = list(_in_scene(scene, args.parts))
                told = [f"{how} {100 * np.median([f.error for f in new if f.how == how]):.1f}%" for how in HOW]
                print(root.name, scene_id, *told, sep="  ", flush=True)
                found += new
    values = {}
    for how in HOW:
        for size_px in SIZES_PX:
            members = [one for one in found if (one.how, one.size_px) == (how, size_px)]
            if members:
                values[f"{how}, {'as it is' if size_px is None else f'{size_px} px'}"] = _row(members)
    for name, row in values.items():
        print(name, row)
    if args.record:
        names = ", ".join(root.name for root in args.datasets)
        about = f"small parts in single frames, found and snapped to, parts for {args.split}"
        measured.record(f"small_parts.{args.record}", about, UNIT, names, values)


def _in_scene(scene: BopScene, parts: Path) -> Iterator[Found]:
    object_id, model = scene.object_ids[0], prepared_part_of(scene, parts)
    finder, metric = Finder(model), PartMetric(model.part, 500)
    finder.prepare()
    frames = readable_frames(scene)
    for number in (2, len(frames) // 2, len(frames) - 3):
        truth = scene.truth(frames[number].index, object_id)
        if truth is None:
            continue
        now_px = appears_px(model.part, frames[number].camera, truth)
        for size_px in SIZES_PX:
            if size_px is not None and size_px > now_px:
                continue
            frame = frames[number] if size_px is None else scaled(frames[number], size_px / now_px)
            begin = time.process_time()
            best = next(iter(finder.find(frame, 1)), None)
            time_s = time.process_time() - begin
            error = np.inf if best is None else metric.share(best.cam_T_obj, truth)
            yield Found("find", size_px, error, best is not None and best.score >= ACCEPTED, time_s)
            rng = np.random.default_rng([number, scene.scene_id])
            start = disturb_pose(truth, model.part.box_centre, OFF_DEG, OFF_MM, rng)
            begin = time.process_time()
            try:
                snapped = snap(model, frame, start)
            except TrackingError:  # the part shows too little there
                yield Found("snap", size_px, np.inf, False, time.process_time() - begin)
                continue
            time_s = time.process_time() - begin
            good = snapped.quality >= SnapConfig().good_quality
            yield Found("snap", size_px, metric.share(snapped.cam_T_obj, truth), good, time_s)


def _row(found: list[Found]) -> dict[str, float]:
    errors = np.array([one.error for one in found])
    accepted = errors[[one.accepted for one in found]]
    return {
        "frames": len(found),
        "@2": float((errors < 0.02).mean()),
        "@5": float((errors < 0.05).mean()),
        "@10": float((errors < 0.1).mean()),
        "accepted": len(accepted) / len(found),
        "right": float((accepted < 0.1).mean()) if len(accepted) else 0.0,
        "time": float(np.median([one.time_s for one in found])),
    }


if __name__ == "__main__":
    main()
