"""Parts that are alike, as in a tray: how many of them does one picture tell, and are those that are accepted right?

    python -m benchmarks.each_part tray_checking --parts PARTS --record checking

Such sequences are made by `python -m data_recipes.metal_sequences --look-alikes COUNT`, with the poses of all parts.
Every tenth frame is searched, by `Finder.find_each` and, for comparison, by `Finder.find`, which asks for the one part
that is meant. A hypothesis is right when its ADD (ADD-S for symmetric parts) is below 10% of the diameter for one of
the parts. PARTS holds prepared parts, or one folder of them per data set. Times are CPU seconds of one thread;
templates are made before.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from acp_lab.commands.machine import limit_threads

limit_threads(1)  # before NumPy is imported

import numpy as np  # noqa: E402

from acp_lab.evaluation.part_metric import PartMetric  # noqa: E402
from acp_lab.geometry.arrays import BoolArray, FloatArray  # noqa: E402
from acp_lab.sequences.bop import BopDataset, BopScene  # noqa: E402
from acp_lab.sequences.json_file import pose_of  # noqa: E402
from acp_lab.tracking.find import Finder  # noqa: E402
from benchmarks import measured  # noqa: E402
from benchmarks.runs import prepared_part_of, readable_frames  # noqa: E402

LOOK_ALIKES = "scene_look_alikes.json"
"""As `data_recipes.metal.dataset` writes it."""
EVERY, RIGHT = 10, 0.1
SEEN = {"all of it": 0.95, "most of it": 0.7, "half of it": 0.5}
"""Of a part that counts, at least so much is neither hidden nor beyond the image's border."""
UNIT = {
    "parts": "parts in all frames",
    "found": "share of these that an accepted hypothesis is right for",
    "among": "share of these that some hypothesis is right for",
    "frames": "frames",
    "accepted": "accepted hypotheses in all frames",
    "right": "share of these that are right for some part",
    "first": "share of frames whose best hypothesis is right for some part",
    "some": "share of frames with one that is accepted and right",
    "time": "median CPU s per frame",
}


@dataclass(frozen=True, eq=False)
class Searched:
    """One frame. visible: (p,) share of each part. right: (h, p) of the hypotheses, best first. accepted: (h,)."""

    visible: FloatArray
    right: BoolArray
    accepted: BoolArray
    time_s: float


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("datasets", nargs="+", type=Path)
    parser.add_argument("--parts", type=Path, required=True)
    parser.add_argument("--record", metavar="KEY")
    args = parser.parse_args()
    each, one = list[Searched](), list[Searched]()
    for root in args.datasets:
        for scene_id in BopDataset(root).scenes():
            scene = BopDataset(root).open_scene(scene_id)
            found = search(scene, Finder(prepared_part_of(scene, args.parts)))
            each += (frame for frame, _ in found)
            one += (frame for _, frame in found)
            print(root.name, scene_id, _of_frames(each[-len(found) :]), flush=True)
    rows = {name: _of_parts(each, least) for name, least in SEEN.items()}
    rows |= {"each": _of_frames(each), "one": _of_frames(one)}
    for name, row in rows.items():
        print(name, row)
    if args.record:
        about = "parts that are alike in one picture"
        measured.record(f"each_part.{args.record}", about, UNIT, ", ".join(root.name for root in args.datasets), rows)


def search(scene: BopScene, finder: Finder) -> list[tuple[Searched, Searched]]:
    """Every tenth frame of a scene: searched for each part, and for one."""
    finder.prepare()
    object_id, metric = scene.object_ids[0], PartMetric(finder.model.part)
    others = json.loads((scene.folder / LOOK_ALIKES).read_text(encoding="utf-8"))
    info = json.loads((scene.folder / "scene_gt_info.json").read_text(encoding="utf-8"))
    found = []
    for frame in readable_frames(scene)[::EVERY]:
        entries, own = others[str(frame.index)], scene.truth(frame.index, object_id)
        assert own is not None
        truths = [own, *(pose_of(entry, f"{scene.folder / LOOK_ALIKES}: image {frame.index}") for entry in entries)]
        visible = np.array([one["visib_fract"] for one in (info[str(frame.index)][0], *entries)])
        results = []
        for look in (finder.find_each, finder.find):
            begin = time.process_time()
            hypotheses = look(frame)
            time_s = time.process_time() - begin
            errors = np.array([[metric.share(one.cam_T_obj, truth) for truth in truths] for one in hypotheses])
            accepted = np.array([one.is_accepted for one in hypotheses], bool)
            right = errors.reshape(len(hypotheses), len(truths)) < RIGHT
            results.append(Searched(visible, right, accepted, time_s))
        found.append((results[0], results[1]))
    return found


def _of_parts(searched: Sequence[Searched], least: float) -> dict[str, float]:
    """Of the parts that are seen by a least share."""
    seen = np.concatenate([one.visible for one in searched]) >= least
    found = np.concatenate([one.right[one.accepted].max(0, initial=False) for one in searched])[seen]
    among = np.concatenate([one.right.max(0, initial=False) for one in searched])[seen]
    return {"parts": len(found), "found": float(found.mean()), "among": float(among.mean())} if len(found) else {}


def _of_frames(searched: Sequence[Searched]) -> dict[str, float]:
    accepted = np.concatenate([one.right[one.accepted].max(1, initial=False) for one in searched])
    return {
        "frames": len(searched),
        "accepted": len(accepted),
        "right": float(accepted.mean()) if len(accepted) else 0.0,
        "first": float(np.mean([one.right[:1].any() for one in searched])),
        "some": float(np.mean([one.right[one.accepted].any() for one in searched])),
        "time": float(np.median([one.time_s for one in searched])),
    }


if __name__ == "__main__":
    main()
