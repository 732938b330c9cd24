"""Finding parts without a first pose: how often the best hypothesis is right, and how often a part that is not there.

    python -m benchmarks.detection metal_hard --parts out/parts --frames 10 --absent --record metal_hard

Each scene gives frames that are spread evenly over it; a hypothesis is right when its ADD (ADD-S for symmetric parts)
is below 10% of the diameter. With --absent each frame is also searched for a part of another scene. PARTS holds
prepared parts, or one folder of them per data set. Times are CPU seconds of one thread; templates are made before.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from pathlib import Path

from acp_lab.commands.machine import limit_threads

limit_threads(1)  # before NumPy is imported

import numpy as np  # noqa: E402

from acp_lab.detection.config import DetectionConfig  # noqa: E402
from acp_lab.evaluation.part_metric import PartMetric  # noqa: E402
from acp_lab.sequences.bop import BopDataset, BopScene  # noqa: E402
from acp_lab.sequences.frame import Frame  # noqa: E402
from acp_lab.tracking.find import Finder  # noqa: E402
from benchmarks import measured  # noqa: E402
from benchmarks.runs import prepared_part_of  # noqa: E402

RIGHT = 0.1
UNIT = {
    "frames": "frames",
    "first": "share of frames whose best hypothesis has ADD below 10%",
    "best of 3": "share of frames with such a one among the first three",
    "accepted": "share of frames whose best hypothesis is accepted",
    "right": "share of these that are right",
    "time": "median CPU s per frame",
    "false": "frames",
    "absent": "frames",
}


@dataclass(frozen=True)
class Search:
    """One search of a part that the frame shows: which of its hypotheses are right, whether the best is accepted."""

    right: tuple[bool, ...]
    accepted: bool
    time_s: float


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("datasets", nargs="+", type=Path)
    parser.add_argument("--parts", type=Path, required=True)
    parser.add_argument("--frames", type=int, default=10)
    parser.add_argument("--scene", type=int, action="append")
    parser.add_argument("--absent", action="store_true")
    parser.add_argument("--record", metavar="KEY")
    args = parser.parse_args()
    scenes = [
        scene
        for root in args.datasets
        for scene_id in (args.scene or BopDataset(root).scenes())
        for scene in [BopDataset(root).open_scene(scene_id)]
    ]
    finders = {(scene.dataset.root, scene.object_ids[0]): _finder(scene, args.parts) for scene in scenes}
    values, everything, absent, false = {}, list[Search](), 0, 0
    for number, scene in enumerate(scenes):
        own = (scene.dataset.root, scene.object_ids[0])
        frames = _spread(scene, args.frames)
        searches = [_search(finders[own], scene, frame) for frame in frames]
        everything += searches
        values[f"{scene.dataset.name} {scene.scene_id}"] = _row(searches)
        print(scene.dataset.name, scene.scene_id, values[f"{scene.dataset.name} {scene.scene_id}"], flush=True)
        others = [key for key in finders if key != own]
        for turn, frame in enumerate(frames if args.absent and others else []):
            found = finders[others[(number + turn) % len(others)]].find(frame, 1)
            absent += 1
            false += bool(found) and found[0].is_accepted
    values["all"] = _row(everything)
    if absent:
        values["all"] |= {"absent": absent, "false": false}
    print("all", values["all"])
    if args.record:
        about = "hypotheses of acp_lab.detect on frames of each scene, depth 250 to 1200 mm, no pose given"
        names = ", ".join(root.name for root in args.datasets)
        measured.record(f"detection.{args.record}", about, UNIT, names, values)


def _finder(scene: BopScene, parts: Path) -> Finder:
    model = prepared_part_of(scene, parts)
    finder = Finder(model, DetectionConfig())
    finder.prepare()
    return finder


def _spread(scene: BopScene, count: int) -> list[Frame]:
    rows = np.linspace(0, len(scene.frame_ids) - 1, count + 2)[1:-1]
    frames = [scene.frame(scene.frame_ids[round(row)]) for row in rows]
    return [frame for frame in frames if isinstance(frame, Frame)]


def _search(finder: Finder, scene: BopScene, frame: Frame) -> Search:
    begin = time.process_time()
    found = finder.find(frame, 3)
    time_s = time.process_time() - begin
    truth = scene.truth(frame.index, scene.object_ids[0])
    assert truth is not None
    metric = PartMetric(finder.model.part, 500)
    right = tuple(metric.share(one.cam_T_obj, truth) < RIGHT for one in found)
    return Search(right, bool(found) and found[0].is_accepted, time_s)


def _row(searches: list[Search]) -> dict[str, float]:
    accepted = [search.right[0] for search in searches if search.accepted]
    return {
        "frames": len(searches),
        "first": float(np.mean([any(search.right[:1]) for search in searches])),
        "best of 3": float(np.mean([any(search.right) for search in searches])),
        "accepted": len(accepted) / len(searches),
        "right": float(np.mean(accepted)) if accepted else 0.0,
        "time": float(np.median([search.time_s for search in searches])),
    }


if __name__ == "__main__":
    main()
