"""Finding parts without a first pose: how often the best hypothesis is right, and how often a part that is not there.

    python -m benchmarks.detection metal_public metal_hard --parts out/parts --frames 10 --absent 100 --record all
    python -m benchmarks.detection metal_public metal_hard --parts out/parts --auto --record auto

Each scene gives frames that are spread evenly over it; a hypothesis is right when its ADD (ADD-S for symmetric parts)
is below 10% of the diameter. Rows: each scene, each background and each size of image, and all. With --absent each
frame in turn is also searched for a part of another scene, until so many were; with --prior, for its own part near the
true pose turned by 15 degrees and 10% farther. With --auto the first ten frames are searched until the part is
accepted in one, as `acp-lab track --init auto` does. PARTS holds prepared parts, or one folder of them per data set.
Times are CPU seconds of one thread; templates are made before. Memory is the most that the process held.
"""

from __future__ import annotations

import argparse
import json
import resource
import time
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from acp_lab.commands.machine import limit_threads

limit_threads(1)  # before NumPy is imported

import numpy as np  # noqa: E402

from acp_lab.detection.config import DetectionConfig  # noqa: E402
from acp_lab.evaluation.part_metric import PartMetric  # noqa: E402
from acp_lab.geometry.arrays import FloatArray  # noqa: E402
from acp_lab.geometry.pose import transform  # noqa: E402
from acp_lab.geometry.pose_step import move_pose  # noqa: E402
from acp_lab.sequences.bop import BopDataset, BopScene  # noqa: E402
from acp_lab.sequences.frame import Frame  # noqa: E402
from acp_lab.tracking.find import Detection, Finder  # noqa: E402
from acp_lab.tracking.way_back import Reach  # noqa: E402
from benchmarks import measured  # noqa: E402
from benchmarks.runs import prepared_part_of  # noqa: E402

RIGHT = 0.1
AUTO_FRAMES = 10
PRIOR_DEG, PRIOR_DEPTH = 15.0, 1.1
PRIOR_REACH = Reach(25.0, 1.2)
UNIT = {
    "frames": "frames",
    "first": "share of frames whose best hypothesis has ADD below 10%",
    "best of 3": "share of frames with such a one among the first three",
    "accepted": "share of frames whose best hypothesis is accepted",
    "right": "share of these that are right",
    "time": "median CPU s per frame",
    "most": "largest CPU s of a frame",
    "false": "frames",
    "absent": "frames",
    "sequences": "sequences",
    "found": "sequences whose part is accepted within ten frames, with ADD below 10%",
    "wrong": "sequences whose part is accepted with a larger one",
    "memory": "MB",
}


@dataclass(frozen=True)
class Search:
    """One search of a part that the frame shows.

    right: of the hypotheses. accepted: the best one. labels: of the rows that it counts in.
    """

    right: tuple[bool, ...]
    accepted: bool
    time_s: float
    labels: tuple[str, ...]


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("datasets", nargs="+", type=Path)
    parser.add_argument("--parts", type=Path, required=True)
    parser.add_argument("--frames", type=int, default=10)
    parser.add_argument("--scene", type=int, action="append")
    parser.add_argument("--absent", type=int, default=0, metavar="FRAMES")
    parser.add_argument("--prior", action="store_true")
    parser.add_argument("--auto", action="store_true")
    parser.add_argument("--record", metavar="KEY")
    args = parser.parse_args()
    scenes = [
        scene
        for root in args.datasets
        for scene_id in (args.scene or BopDataset(root).scenes())
        for scene in [BopDataset(root).open_scene(scene_id)]
    ]
    finders = {(scene.dataset.root, scene.object_ids[0]): _finder(scene, args.parts) for scene in scenes}
    values = _auto(scenes, finders) if args.auto else _table(scenes, finders, args)
    values["all"]["memory"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    for label, row in values.items():
        print(label, row)
    if args.record:
        about = "hypotheses of acp_lab.detect on frames of each scene, depth 250 to 1200 mm, no pose given"
        if args.auto:
            about = "the first accepted hypothesis within the first ten frames of each scene, no pose given"
        names = ", ".join(root.name for root in args.datasets)
        measured.record(f"detection.{args.record}", about, UNIT, names, values)


def _table(
    scenes: list[BopScene], finders: dict[tuple[Path, int], Finder], args: argparse.Namespace
) -> dict[str, dict[str, float]]:
    """Rows of the table, by their labels."""
    searches, absent, false = list[Search](), 0, 0
    for number, scene in enumerate(scenes):
        own = _key(scene)
        others = [key for key in finders if key != own]
        for turn, frame in enumerate(_spread(scene, args.frames)):
            searches.append(_search(finders[own], scene, frame))
            if args.prior:
                searches.append(_search(finders[own], scene, frame, with_prior=True))
            if absent < args.absent and others:
                found = finders[others[(number + turn) % len(others)]].find(frame, 1)
                absent += 1
                false += bool(found) and found[0].is_accepted
        label = f"{scene.dataset.name} {scene.scene_id}"
        print(label, _row([search for search in searches if label in search.labels]), flush=True)
    labels = sorted({label for search in searches for label in search.labels}, key=lambda label: label == "all")
    values = {label: _row([search for search in searches if label in search.labels]) for label in labels}
    if absent:
        values["all"] |= {"absent": absent, "false": false}
    return values


def _auto(scenes: list[BopScene], finders: dict[tuple[Path, int], Finder]) -> dict[str, dict[str, float]]:
    """How many parts are accepted within the first frames, by data set and in all."""
    outcomes = dict[str, list[bool | None]]()
    for scene in scenes:
        accepted = _first_accepted(finders[_key(scene)], scene)
        print(
            scene.dataset.name, scene.scene_id, {None: "not found", True: "right", False: "wrong"}[accepted], flush=True
        )
        for label in (scene.dataset.name, "all"):
            outcomes.setdefault(label, []).append(accepted)
    return {
        label: {"sequences": len(of_one), "found": of_one.count(True), "wrong": of_one.count(False)}
        for label, of_one in sorted(outcomes.items(), key=lambda entry: entry[0] == "all")
    }


def _first_accepted(finder: Finder, scene: BopScene) -> bool | None:
    """Whether the first accepted hypothesis of a scene is right; None where there is none."""
    for frame in islice(scene.frames(), AUTO_FRAMES):
        found = finder.find(frame, 1) if isinstance(frame, Frame) else ()
        if found and found[0].is_accepted:
            return _is_right(finder, scene, frame.index, found[0])
    return None


def _key(scene: BopScene) -> tuple[Path, int]:
    return scene.dataset.root, scene.object_ids[0]


def _finder(scene: BopScene, parts: Path) -> Finder:
    model = prepared_part_of(scene, parts)
    finder = Finder(model, DetectionConfig())
    finder.prepare()
    return finder


def _spread(scene: BopScene, count: int) -> list[Frame]:
    rows = np.linspace(0, len(scene.frame_ids) - 1, count + 2)[1:-1]
    frames = [scene.frame(scene.frame_ids[round(row)]) for row in rows]
    return [frame for frame in frames if isinstance(frame, Frame)]


def _search(finder: Finder, scene: BopScene, frame: Frame, with_prior: bool = False) -> Search:
    prior = PRIOR_REACH.of(_disturbed(finder, scene, frame)) if with_prior else None
    begin = time.process_time()
    found = finder.find(frame, 3, prior)
    time_s = time.process_time() - begin
    right = tuple(_is_right(finder, scene, frame.index, one) for one in found)
    size = f"{frame.camera.width}x{frame.camera.height}"
    labels = (f"{scene.dataset.name} {scene.scene_id}", f"background {_background(scene)}", size, "all")
    return Search(right, bool(found) and found[0].is_accepted, time_s, (f"prior, {size}",) if with_prior else labels)


def _disturbed(finder: Finder, scene: BopScene, frame: Frame) -> FloatArray:
    """The true pose, turned and moved away."""
    truth = scene.truth(frame.index, scene.object_ids[0])
    assert truth is not None
    centre = finder.model.part.box_centre
    away = (PRIOR_DEPTH - 1.0) * transform(truth, centre)
    turn = np.radians(PRIOR_DEG) * np.array([0.6, 0.64, 0.48])
    return move_pose(truth, centre, np.concatenate([turn, away]))


def _is_right(finder: Finder, scene: BopScene, frame_id: int, one: Detection) -> bool:
    truth = scene.truth(frame_id, scene.object_ids[0])
    return truth is not None and PartMetric(finder.model.part, 500).share(one.cam_T_obj, truth) < RIGHT


def _background(scene: BopScene) -> str:
    """What scene_meta.json says is behind the part."""
    meta = scene.folder / "scene_meta.json"
    told = json.loads(meta.read_text(encoding="utf-8")) if meta.is_file() else {}
    return str(told.get("background", told.get("table", "not told")))


def _row(searches: list[Search]) -> dict[str, float]:
    accepted = [search.right[0] for search in searches if search.accepted]
    return {
        "frames": len(searches),
        "first": float(np.mean([any(search.right[:1]) for search in searches])),
        "best of 3": float(np.mean([any(search.right) for search in searches])),
        "accepted": len(accepted) / len(searches),
        "right": float(np.mean(accepted)) if accepted else 0.0,
        "time": float(np.median([search.time_s for search in searches])),
        "most": max(search.time_s for search in searches),
    }


if __name__ == "__main__":
    main()
