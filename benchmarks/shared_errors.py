"""Do `acp` and other trackers' own programs err alike? Then the error may be none of theirs.

    python -m benchmarks.shared_errors DATASET --parts PARTS --results-from TRACKER__DATASET.csv ... [--record]

Results of others are in the BOP results format, `acp` starts from the first frame's truth as they did. Each pair is
compared with the truth and with each other (`acp_lab.studies.shared_errors`), over all sequences of the data set; and
each with the truth moved in depth as the errors of the other say, which tells whether they are the truth's.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from itertools import combinations
from pathlib import Path

from acp_lab.commands.machine import limit_threads

limit_threads(1)  # before NumPy is imported

import numpy as np  # noqa: E402

from acp_lab.bench.outside import tracker_and_dataset  # noqa: E402
from acp_lab.cad.part import Part  # noqa: E402
from acp_lab.geometry.arrays import FloatArray  # noqa: E402
from acp_lab.sequences.bop import BopDataset, BopScene  # noqa: E402
from acp_lab.sequences.results_csv import read_results  # noqa: E402
from acp_lab.studies.shared_errors import SharedErrors, joined, shared_errors, shifted_in_depth  # noqa: E402
from acp_lab.tracking.tracker import Tracker  # noqa: E402
from benchmarks import measured  # noqa: E402
from benchmarks.runs import prepared_part_of  # noqa: E402

Poses = dict[int, FloatArray]
UNIT = {
    "frames": "frames, each sequence's first left out",
    "@* apart": "share of frames in which the two are within 2, 5% of the diameter of each other",
    "@* moved": "share of frames with ADD below 2, 5% from the truth, moved in depth as the other's errors say",
    "@*": "share of frames with ADD (ADD-S for symmetric parts) below 2, 5% of the diameter",
    "correlation *": "of the errors of the two along the camera's x, y, z; no unit",
    "offset *": "mm by which the truth's depth is behind each, apart from the lead",
    "*lead *": "frames by which estimates run ahead of the truth along the camera's x, y, z",
}


def poses_of_acp(scene: BopScene, parts: Path) -> tuple[Part, Poses]:
    """The part, and where `acp` finds it, by frame."""
    object_id, model = scene.object_ids[0], prepared_part_of(scene, parts)
    start = scene.truth(scene.frame_ids[0], object_id)
    assert start is not None
    run = Tracker(model).run(scene, start, object_id=object_id)
    return model.part, {row.im_id: row.cam_T_obj for row in run.rows}


def fields_of(study: SharedErrors, first_moved: FloatArray, second_moved: FloatArray) -> dict[str, float]:
    """What is recorded of a pair; first_moved, second_moved: errors from the truth as the other's errors move it."""
    fields: dict[str, float] = {"frames": len(study.apart)}
    for name, errors in (
        ("first", study.first), ("second", study.second), ("apart", study.apart), ("first moved", first_moved),
        ("second moved", second_moved),
    ):  # fmt: skip
        fields |= {f"@{percent} {name}": float(np.mean(errors < percent / 100.0)) for percent in (2, 5)}
    to_first, to_second = study.depth_shifts
    fields |= {"offset first": to_first.offset_mm, "offset second": to_second.offset_mm}
    for name, values in (
        ("correlation", study.correlation), ("first lead", study.first_lead), ("second lead", study.second_lead),
    ):  # fmt: skip
        fields |= {f"{name} {axis}": float(value) for axis, value in zip("xyz", values, strict=True)}
    return fields


def of_pair(sequences: list[tuple[Part, Poses, dict[str, Poses]]], one: str, other: str) -> dict[str, float]:
    """Of two trackers by their names; sequences: the part, the truth, and where each tracker finds it."""
    study = joined([shared_errors(part, truth, tracks[one], tracks[other]) for part, truth, tracks in sequences])
    to_first, to_second = study.depth_shifts
    moved = [
        (
            shared_errors(part, shifted_in_depth(truth, to_second, part), tracks[one], tracks[other]).first,
            shared_errors(part, shifted_in_depth(truth, to_first, part), tracks[one], tracks[other]).second,
        )
        for part, truth, tracks in sequences
    ]
    first, second = (np.concatenate(errors) for errors in zip(*moved, strict=True))
    return fields_of(study, first, second)


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", type=Path)
    parser.add_argument("--parts", type=Path, required=True)
    parser.add_argument("--results-from", type=Path, nargs="+", required=True)
    parser.add_argument("--record", action="store_true")
    args = parser.parse_args()
    data = BopDataset(args.dataset)
    others: dict[str, dict[tuple[int, int], Poses]] = {}
    for path in args.results_from:
        poses = others.setdefault(tracker_and_dataset(path, {data.name: args.dataset})[0], defaultdict(dict))
        for found in read_results(path):
            poses[found.scene_id, found.obj_id][found.im_id] = found.cam_T_obj
    sequences = list[tuple[Part, Poses, dict[str, Poses]]]()
    for scene_id in data.scenes():
        scene = data.open_scene(scene_id)
        object_id = scene.object_ids[0]
        part, own = poses_of_acp(scene, args.parts)
        known = {number: scene.truth(number, object_id) for number in scene.frame_ids}
        truth = {number: pose for number, pose in known.items() if pose is not None}
        tracks = {"acp": own} | {name: poses[scene_id, object_id] for name, poses in others.items()}
        for track in tracks.values():
            track.pop(scene.frame_ids[0], None)  # that was given
        sequences.append((part, truth, tracks))
    rows = {f"{one}, {other}": of_pair(sequences, one, other) for one, other in combinations(["acp", *others], 2)}
    for pair, row in rows.items():
        print(pair, {field: round(value, 2) for field, value in row.items()})
    if args.record:
        about = "pairs of trackers beside the truth and beside each other, from exact starts"
        measured.record(f"shared_errors.{data.name}", about, UNIT, data.name, rows)


if __name__ == "__main__":
    main()
