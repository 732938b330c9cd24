"""Finding parts without a first pose: how often the best hypothesis is right, and how often a part that is not there.

    python -m benchmarks.detection metal_public metal_hard --parts out/parts --absent 100 --record all
    python -m benchmarks.detection metal_public metal_hard --parts out/parts --auto --record auto
    python -m benchmarks.detection metal_public metal_hard --parts out/parts --memory --record memory

Each scene gives frames that are spread evenly over it; a hypothesis is right when its ADD (ADD-S for symmetric parts)
is below 10% of the diameter. Rows: each scene, each data set, each size of image, both halves of the parts (see
`robustness.CHECKING`), each half's backgrounds, and all. With --absent some of the frames of each scene, so many in
all, are also searched for a part of another scene; with --prior each for its own part near the true pose turned by 15
degrees and 10% farther. With --auto the first ten frames are searched until the part is accepted, as `acp-lab track
--init auto` does. PARTS holds prepared parts, or one folder of them per data set. What was found in a scene is
appended to --results, and not searched again. Times are CPU seconds of one thread; templates are made before. With
--memory `acp-lab detect` searches one frame of each size in a process of its own.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from itertools import islice
from pathlib import Path
from subprocess import Popen
from tempfile import TemporaryDirectory

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
from acp_lab.tracking.find import ACCEPTED, Finder  # noqa: E402
from acp_lab.tracking.first_pose import FirstPose  # noqa: E402
from acp_lab.tracking.way_back import Reach  # noqa: E402
from benchmarks import measured  # noqa: E402
from benchmarks.robustness import is_in_split  # noqa: E402
from benchmarks.runs import part_name, prepared_part_of  # noqa: E402

RIGHT = 0.1
AUTO_FRAMES = 10
ABSENT = "absent"
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
    "memory": "MB, the most that the process held",
}


@dataclass(frozen=True)
class Search:
    """One search.

    right: of the hypotheses, the best first; scores: theirs. labels: of the rows that it counts in; ABSENT for a part
    that the frame does not show.
    """

    right: tuple[bool, ...]
    scores: tuple[float, ...]
    time_s: float
    labels: tuple[str, ...]

    @property
    def accepted(self) -> bool:
        """Whether the best one is."""
        return any(score >= ACCEPTED for score in self.scores[:1])


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
    parser.add_argument("--memory", action="store_true")
    parser.add_argument("--results", type=Path, metavar="FILE.jsonl")
    parser.add_argument("--record", metavar="KEY")
    args = parser.parse_args()
    scenes = [
        scene
        for root in args.datasets
        for scene_id in (args.scene or BopDataset(root).scenes())
        for scene in [BopDataset(root).open_scene(scene_id)]
    ]
    if args.memory:
        values = _memory(scenes, args.parts)
    else:
        values = _auto(scenes, Finders(args.parts)) if args.auto else _table(scenes, Finders(args.parts), args)
    for label, row in values.items():
        print(label, row)
    if args.record:
        about = "hypotheses of acp_lab.detect on frames of each scene, depth 250 to 1200 mm, no pose given"
        if args.auto:
            about = "the first accepted pose within the first ten frames of each scene, no pose given"
        if args.memory:
            about = "acp-lab detect on one frame, one part, no pose given"
        names = ", ".join(root.name for root in args.datasets)
        measured.record(f"detection.{args.record}", about, UNIT, names, values)


class Finders(dict[tuple[Path, int], Finder]):
    """By data set and object id, each made when it is first asked for."""

    def __init__(self, parts: Path) -> None:
        super().__init__()
        self._parts = parts

    def of(self, scene: BopScene) -> Finder:
        """Of a scene's first object."""
        key = (scene.dataset.root, scene.object_ids[0])
        if key not in self:
            self[key] = Finder(prepared_part_of(scene, self._parts), DetectionConfig())
            self[key].prepare()
        return self[key]


def _table(scenes: list[BopScene], finders: Finders, args: argparse.Namespace) -> dict[str, dict[str, float]]:
    """Rows of the table, by their labels."""
    searches, known = list[Search](), _read(args.results)
    for number, scene in enumerate(scenes):
        label = f"{scene.dataset.name} {scene.scene_id}"
        others = [one for one in scenes if (one.dataset.root, one.object_ids) != (scene.dataset.root, scene.object_ids)]
        absent = len(range(number, args.absent, len(scenes))) if others else 0
        if label not in known:
            known[label] = list(_searches(scene, finders, args.frames, args.prior, others, number, absent))
            _append(args.results, label, known[label])
        searches += known[label]
        print(label, _row([search for search in searches if label in search.labels]), flush=True)
    labels = sorted({label for one in searches for label in one.labels} - {ABSENT}, key=lambda label: label == "all")
    values = {label: _row([search for search in searches if label in search.labels]) for label in labels}
    absent_ones = [search for search in searches if ABSENT in search.labels]
    if absent_ones:
        values["all"] |= {"absent": len(absent_ones), "false": sum(search.accepted for search in absent_ones)}
    return values


def _searches(
    scene: BopScene, finders: Finders, frames: int, with_prior: bool, others: list[BopScene], number: int, absent: int
) -> Iterator[Search]:
    """Those of a scene; others: whose parts it does not show; absent: in how many of its frames one is searched."""
    finder = finders.of(scene)
    for turn, frame in enumerate(_spread(scene, frames)):
        yield _search(finder, scene, frame)
        if with_prior:
            yield _search(finder, scene, frame, with_prior=True)
        if turn < absent:
            found = finders.of(others[(7 * number + turn) % len(others)]).find(frame, 1)
            yield Search((False,) * len(found), tuple(one.score for one in found), 0.0, (ABSENT,))


def _read(path: Path | None) -> dict[str, list[Search]]:
    """By scene."""
    lines = path.read_text(encoding="utf-8").splitlines() if path is not None and path.is_file() else []
    return {
        row["scene"]: [
            Search(tuple(one["right"]), tuple(one["scores"]), one["time_s"], tuple(one["labels"]))
            for one in row["searches"]
        ]
        for row in map(json.loads, lines)
    }


def _append(path: Path | None, label: str, searches: list[Search]) -> None:
    if path is not None:
        with path.open("a", encoding="utf-8") as file:
            file.write(json.dumps({"scene": label, "searches": [asdict(search) for search in searches]}) + "\n")


def _auto(scenes: list[BopScene], finders: Finders) -> dict[str, dict[str, float]]:
    """How many parts are accepted within the first frames, by data set, by half of the parts, and in all."""
    outcomes = dict[str, list[bool | None]]()
    for scene in scenes:
        accepted = _first_accepted(finders.of(scene), scene)
        print(
            scene.dataset.name, scene.scene_id, {None: "not found", True: "right", False: "wrong"}[accepted], flush=True
        )
        for label in (scene.dataset.name, _half(scene), "all"):
            outcomes.setdefault(label, []).append(accepted)
    return {
        label: {"sequences": len(of_one), "found": of_one.count(True), "wrong": of_one.count(False)}
        for label, of_one in sorted(outcomes.items(), key=lambda entry: entry[0] == "all")
    }


def _memory(scenes: list[BopScene], parts: Path) -> dict[str, dict[str, float]]:
    """By size of the image. A process counts what its parent held when it began, so nothing is loaded before."""
    first = dict[str, BopScene]()
    for scene in scenes:
        camera = scene.frame(scene.frame_ids[0]).camera
        if camera is not None:
            first.setdefault(f"{camera.width}x{camera.height}", scene)
    values = {}
    for size, scene in first.items():
        folder = parts / scene.dataset.name
        with TemporaryDirectory() as out:
            command = [sys.executable, "-m", "acp_lab", "detect", str(scene.dataset.root), "--out", f"{out}/found.csv"]
            options = ["--parts", str(folder if folder.is_dir() else parts), "--scene", str(scene.scene_id)]
            process = Popen([*command, *options, "--step", "1000"])
            _, status, used = os.wait4(process.pid, 0)
            if status:
                raise SystemExit(f"acp-lab detect failed on {scene.dataset.name} {scene.scene_id}")
        values[size] = {"memory": used.ru_maxrss / 1024.0}
    return values


def _first_accepted(finder: Finder, scene: BopScene) -> bool | None:
    """Whether the first accepted pose of a scene is right; None where there is none."""
    search = FirstPose(finder)
    for frame in islice(scene.frames(), AUTO_FRAMES):
        pose = search.look(frame)
        if pose is not None:
            return _is_right(finder, scene, frame.index, pose)
    return None


def _half(scene: BopScene) -> str:
    """Of the parts: constants were chosen on the one, the other is reported."""
    return "checking" if is_in_split(part_name(scene.dataset.root, scene.object_ids[0]), "checking") else "tuning"


def _spread(scene: BopScene, count: int) -> list[Frame]:
    rows = np.linspace(0, len(scene.frame_ids) - 1, count + 2)[1:-1]
    frames = [scene.frame(scene.frame_ids[round(row)]) for row in rows]
    return [frame for frame in frames if isinstance(frame, Frame)]


def _search(finder: Finder, scene: BopScene, frame: Frame, with_prior: bool = False) -> Search:
    prior = PRIOR_REACH.of(_disturbed(finder, scene, frame)) if with_prior else None
    begin = time.process_time()
    found = finder.find(frame, 3, prior)
    time_s = time.process_time() - begin
    right = tuple(_is_right(finder, scene, frame.index, one.cam_T_obj) for one in found)
    size, half = f"{frame.camera.width}x{frame.camera.height}", _half(scene)
    rows = (scene.dataset.name, half, f"{half}, background {_background(scene)}", size, "all")
    labels = (f"{scene.dataset.name} {scene.scene_id}", *rows)
    return Search(right, tuple(one.score for one in found), time_s, (f"prior, {size}",) if with_prior else labels)


def _disturbed(finder: Finder, scene: BopScene, frame: Frame) -> FloatArray:
    """The true pose, turned and moved away."""
    truth = scene.truth(frame.index, scene.object_ids[0])
    assert truth is not None
    centre = finder.model.part.box_centre
    away = (PRIOR_DEPTH - 1.0) * transform(truth, centre)
    turn = np.radians(PRIOR_DEG) * np.array([0.6, 0.64, 0.48])
    return move_pose(truth, centre, np.concatenate([turn, away]))


def _is_right(finder: Finder, scene: BopScene, frame_id: int, cam_T_obj: FloatArray) -> bool:
    truth = scene.truth(frame_id, scene.object_ids[0])
    return truth is not None and PartMetric(finder.model.part, 500).share(cam_T_obj, truth) < RIGHT


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
