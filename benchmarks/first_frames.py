"""How far off may a start be? The first frame alone, begun in many frames of each sequence from poses that are off.

    python -m benchmarks.first_frames metal_dev metal_hard --parts out/parts --split checking --record checking

Every tenth frame in which the part is seen is begun once from each distance, so many degrees and as many mm off, in a
random direction. The pose that the tracker begins at counts; nothing is tracked.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from acp_lab.commands.machine import limit_threads

limit_threads(1)  # before NumPy is imported

import numpy as np  # noqa: E402

from acp_lab.errors import TrackingError  # noqa: E402
from acp_lab.evaluation.part_metric import PartMetric  # noqa: E402
from acp_lab.geometry.pose import disturb_pose  # noqa: E402
from acp_lab.sequences.bop import BopDataset, BopScene  # noqa: E402
from acp_lab.tracking.learning.knowledge import Off  # noqa: E402
from acp_lab.tracking.method import METHODS, Method, method_named  # noqa: E402
from acp_lab.tracking.start import TrustedStart  # noqa: E402
from acp_lab.tracking.tracker import Tracker  # noqa: E402
from benchmarks import measured  # noqa: E402
from benchmarks.robustness import SPLITS, is_in_split  # noqa: E402
from benchmarks.runs import part_name, prepared_part_of, readable_frames, visible_frames  # noqa: E402

OFF = (0.5, 2.0, 5.0, 10.0, 15.0, 20.0, 30.0, 45.0, 60.0)
"""Degrees and mm."""
EVERY = 10
UNIT = {
    "frames": "frames that were begun in",
    "@2": "share of begun frames with an ADD below 2% of the diameter",
    "@5": "the same, 5%",
    "@10": "the same, 10%",
    "ms": "CPU ms of a first frame, median",
    "most ms": "CPU ms of a first frame, most",
}


@dataclass(frozen=True)
class Begun:
    """A first frame.

    off: how far off it started, degrees and mm. error: ADD as a share of the diameter where it began, infinite for
    nowhere. ms: CPU time.
    """

    off: float
    error: float
    ms: float


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("datasets", nargs="+", type=Path)
    parser.add_argument("--parts", type=Path, required=True)
    parser.add_argument("--split", choices=SPLITS, default="all")
    parser.add_argument("--method", choices=sorted(METHODS), default="acp")
    parser.add_argument("--clouds", type=int, help="search at most so many, not as many as the method does")
    parser.add_argument("--alone", action="store_true", help="without the detector's second opinion")
    parser.add_argument("--record", metavar="KEY")
    args = parser.parse_args()
    method, begun = method_named(args.method), list[Begun]()
    start = method.start
    if args.clouds is not None:
        if not isinstance(start, TrustedStart) or args.clouds < 1:
            parser.error(f"--clouds {args.clouds}: give 1 or more, and a method that searches its first frame")
        start = replace(start, clouds=args.clouds)
    if args.alone:
        if not isinstance(start, TrustedStart):
            parser.error(f"--alone: {args.method} asks nobody anyway")
        start = replace(start, second_opinion=Off())
    method = replace(method, start=start)
    for root in args.datasets:
        for scene_id in BopDataset(root).scenes():
            scene = BopDataset(root).open_scene(scene_id)
            if is_in_split(part_name(root, scene.object_ids[0]), args.split):
                begun += _begun(scene, args.parts, method)
                print(root.name, scene_id, len(begun), flush=True)
    rows = {f"{off:g}": _row([one for one in begun if one.off == off]) for off in OFF}
    for off, row in rows.items():
        print(off, {field: round(value, 3) for field, value in row.items()})
    if args.record:
        clouds = "" if args.clouds is None else f", at most so many clouds: {args.clouds}"
        alone = ", without a second opinion" if args.alone else ""
        about = f"first frames of {args.method}, begun from poses that are off, parts for {args.split}{clouds}{alone}"
        names = ", ".join(root.name for root in args.datasets)
        measured.record(f"first_frames.{args.record}", about, UNIT, names, rows)


def _begun(scene: BopScene, parts: Path, method: Method) -> Iterator[Begun]:
    object_id, model = scene.object_ids[0], prepared_part_of(scene, parts)
    metric, tracker = PartMetric(model.part, 500), Tracker(model, method)
    frames = readable_frames(scene)[::EVERY]
    visible = visible_frames(scene.folder, object_id, [frame.index for frame in frames])
    for frame in frames:
        truth = scene.truth(frame.index, object_id)
        if truth is None or not visible[frame.index]:
            continue
        for off in OFF:
            rng = np.random.default_rng([scene.scene_id, object_id, frame.index, round(10 * off)])
            start, begin_s = disturb_pose(truth, model.part.box_centre, off, off, rng), time.process_time()
            try:
                error = metric.share(tracker.start(frame, start).cam_T_obj, truth)
            except TrackingError:
                error = float("inf")
            yield Begun(off, error, 1e3 * (time.process_time() - begin_s))


def _row(begun: list[Begun]) -> dict[str, float]:
    errors, ms = np.array([one.error for one in begun]), [one.ms for one in begun]
    shares = {f"@{limit}": float((errors < limit / 100).mean()) for limit in (2, 5, 10)}
    return {"frames": len(begun), **shares, "ms": float(np.median(ms)), "most ms": max(ms)}


if __name__ == "__main__":
    main()
