"""A part that is half covered for a while: how it is tracked meanwhile, and whether its pose is right afterwards.

    python -m benchmarks.half_covered metal_hard metal_dev --parts out/parts --split checking --record checking

Frames go forwards and backwards over a scene as often as needed. From the 13th on, for 30 frames, a share of the box
around the part is covered by a board that moves with it, plain or with the picture of another place of the image; from
each of four sides, in a run of its own. Then it is free for 40 frames. Tracking starts from truth, with defaults, and
without the second thoughts of `acp_lab.tracking.second_thoughts`.

A run is back in time when, from one of the first ten free frames on, the state is tracking and ADD below 10% of the
diameter for five frames. Astray are those of the free frames, from the eleventh on, with an ADD above 10%, whatever
the state. False: the longest row of frames with state tracking and ADD above 30%. PARTS holds prepared parts, or one
folder of them per data set. CPU ms: mean over all covered frames.
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

from acp_lab.cad.part import box_corners  # noqa: E402
from acp_lab.evaluation.part_metric import PartMetric  # noqa: E402
from acp_lab.geometry.arrays import FloatArray  # noqa: E402
from acp_lab.machine import short_collections  # noqa: E402
from acp_lab.sequences.bop import BopDataset, BopScene  # noqa: E402
from acp_lab.sequences.frame import Frame  # noqa: E402
from acp_lab.tracking.frame_view import crop_box  # noqa: E402
from acp_lab.tracking.method import ACP  # noqa: E402
from acp_lab.tracking.recovery import WayBack  # noqa: E402
from acp_lab.tracking.result import TrackState  # noqa: E402
from acp_lab.tracking.tracker import Tracker  # noqa: E402
from benchmarks import measured  # noqa: E402
from benchmarks.faulty_frames import covered  # noqa: E402
from benchmarks.recovery import LOST, RIGHT, STEADY, longest  # noqa: E402
from benchmarks.robustness import SPLITS, is_in_split  # noqa: E402
from benchmarks.runs import part_name, prepared_part_of, readable_frames  # noqa: E402

SHARES = (0.4, 0.5, 0.65)
SEEN, COVERED, FREE, WAIT = 12, 30, 40, 10
METHODS = {"acp": ACP, "without second thoughts": replace(ACP, way_back=WayBack(poor_frames=0))}
UNIT = {
    "runs": "runs",
    "@5": "share of covered frames with ADD below 5% of the diameter",
    "tracking": "share of covered frames with state tracking",
    "back": "share of runs in which the part is back in time",
    "astray": "share of later free frames with ADD above 10%",
    "false": "most frames in a row with state tracking and ADD above 30%",
    "ms": "mean CPU ms of covered frames",
}


@dataclass(frozen=True)
class HalfCovered:
    """What came of a run. errors: (n,) ADD over the diameter; tracking: (n,) states; ms: of covered frames."""

    errors: FloatArray
    tracking: tuple[bool, ...]
    ms: tuple[float, ...]

    @property
    def is_back(self) -> bool:
        """Whether it is back in time."""
        right = [error < RIGHT and tracking for error, tracking in zip(self.errors, self.tracking, strict=True)]
        since = SEEN + COVERED
        return any(all(right[k : k + STEADY]) for k in range(since, since + WAIT))


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("datasets", nargs="+", type=Path)
    parser.add_argument("--parts", type=Path, required=True)
    parser.add_argument("--split", choices=SPLITS, default="all", help="which half of the parts")
    parser.add_argument("--record", metavar="KEY")
    args = parser.parse_args()
    runs: dict[str, list[HalfCovered]] = {f"{share:g}, {name}": [] for name in METHODS for share in SHARES}
    for root in args.datasets:
        for scene_id in BopDataset(root).scenes():
            scene = BopDataset(root).open_scene(scene_id)
            if not is_in_split(part_name(root, scene.object_ids[0]), args.split):
                continue
            with short_collections():
                for row, run in _runs(scene, args.parts):
                    runs[row].append(run)
            print(root.name, scene_id, flush=True)
    values = {row: _row(of_row) for row, of_row in runs.items()}
    for row, numbers in values.items():
        print(row, numbers)
    if args.record:
        names = ", ".join(root.name for root in args.datasets) + ("" if args.split == "all" else f" ({args.split})")
        about = "runs in which a share of the part was covered for 30 frames; tracker acp, from truth"
        measured.record(f"half_covered.{args.record}", about, UNIT, names, values)


def _runs(scene: BopScene, parts: Path) -> Iterator[tuple[str, HalfCovered]]:
    object_id, model = scene.object_ids[0], prepared_part_of(scene, parts)
    frames = readable_frames(scene)
    truths = [scene.truth(frame.index, object_id) for frame in frames]
    known = [(frame, truth) for frame, truth in zip(frames, truths, strict=True) if truth is not None]
    path = [*range(len(known)), *range(len(known) - 2, 0, -1)]
    walk = [known[path[k % len(path)]] for k in range(SEEN + COVERED + FREE)]
    metric, corners = PartMetric(model.part, 500), box_corners(model.part)
    for share in SHARES:
        for side in range(4):
            shown = list[tuple[Frame, FloatArray]]()
            for number, (frame, truth) in enumerate(walk):
                if SEEN <= number < SEEN + COVERED:
                    box = board(crop_box(corners, truth, frame.camera, 15.0), share, side)
                    frame = covered(frame, box, plain=(scene.scene_id + side // 2) % 2 == 0)
                shown.append((frame, truth))
            for name, method in METHODS.items():
                yield f"{share:g}, {name}", _play(shown, Tracker(model, method), metric)


def board(box: tuple[int, int, int, int] | None, share: float, side: int) -> tuple[int, int, int, int] | None:
    """A share of a box (x0, y0, x1, y1) px, from its left, upper, right or lower side: 0 to 3; None without a box."""
    if box is None:
        return None
    x0, y0, x1, y1 = box
    across, down = round(share * (x1 - x0)), round(share * (y1 - y0))
    return ((x0, y0, x0 + across, y1), (x0, y0, x1, y0 + down), (x1 - across, y0, x1, y1), (x0, y1 - down, x1, y1))[
        side
    ]


def _play(shown: list[tuple[Frame, FloatArray]], tracker: Tracker, metric: PartMetric) -> HalfCovered:
    errors, tracking, ms = list[float](), list[bool](), list[float]()
    for number, (frame, truth) in enumerate(shown):
        begin = time.process_time()
        result = tracker.track(frame) if number else tracker.start(frame, truth)
        if SEEN <= number < SEEN + COVERED:
            ms.append(1e3 * (time.process_time() - begin))
        errors.append(metric.share(result.cam_T_obj, truth))
        tracking.append(result.state is TrackState.TRACKING)
    return HalfCovered(np.array(errors), tuple(tracking), tuple(ms))


def _row(runs: list[HalfCovered]) -> dict[str, float]:
    during, later = slice(SEEN, SEEN + COVERED), slice(SEEN + COVERED + WAIT, None)
    wrong = [
        longest([error > LOST and tracking for error, tracking in zip(run.errors, run.tracking, strict=True)])
        for run in runs
    ]
    return {
        "runs": len(runs),
        "@5": float(np.mean([run.errors[during] < 0.05 for run in runs])),
        "tracking": float(np.mean([run.tracking[during] for run in runs])),
        "back": float(np.mean([run.is_back for run in runs])),
        "astray": float(np.mean([run.errors[later] > RIGHT for run in runs])),
        "false": max(wrong),
        "ms": float(np.mean([run.ms for run in runs])),
    }


if __name__ == "__main__":
    main()
