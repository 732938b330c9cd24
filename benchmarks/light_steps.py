"""Lamps are switched: does the tracker go on?

    python -m benchmarks.light_steps metal_public metal_dev --parts out/parts --split checking --record checking

Each sequence is tracked from truth, with defaults; from its twelfth frame on the picture is darker or brighter: the
light itself times 0.4 or 2 ("light"), or the grey values ("grey"; 0.4 of the grey is an eighth of the light, and 2
makes white of most of a picture). Kept: ADD (ADD-S) below 10% of the diameter in the 8th to 14th frame after the step.
PARTS holds prepared parts, or one folder of them per data set.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

from acp_lab.commands.machine import limit_threads

limit_threads(1)  # before NumPy is imported

from acp_lab.evaluation.part_metric import PartMetric  # noqa: E402
from acp_lab.sequences.bop import BopDataset, BopScene  # noqa: E402
from acp_lab.tracking.method import Method, method_named  # noqa: E402
from acp_lab.tracking.tracker import Tracker  # noqa: E402
from benchmarks import measured  # noqa: E402
from benchmarks.faulty_frames import in_grey, in_light  # noqa: E402
from benchmarks.robustness import SPLITS, is_in_split  # noqa: E402
from benchmarks.runs import part_name, prepared_part_of, readable_frames  # noqa: E402

STEP, FIRST, LAST = 12, 8, 14
RIGHT = 0.1
CHANGES = {
    "light x0.4": (in_light, 0.4),
    "light x2": (in_light, 2.0),
    "grey x0.4": (in_grey, 0.4),
    "grey x2": (in_grey, 2.0),
}
UNIT = {"runs": "runs", "kept": "share of runs in which the part is kept"}


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("datasets", nargs="+", type=Path)
    parser.add_argument("--parts", type=Path, required=True)
    parser.add_argument("--method", default="acp")
    parser.add_argument("--split", choices=SPLITS, default="all")
    parser.add_argument("--record", metavar="KEY")
    args = parser.parse_args()
    kept: dict[str, list[bool]] = {name: [] for name in CHANGES}
    for root in args.datasets:
        for scene_id in BopDataset(root).scenes():
            scene = BopDataset(root).open_scene(scene_id)
            if is_in_split(part_name(root, scene.object_ids[0]), args.split):
                worst = dict(_worst_after(scene, args.parts, method_named(args.method)))
                for name, error in worst.items():
                    kept[name].append(error < RIGHT)
                told = [f"{name}: {100 * error:.1f}%" for name, error in worst.items()]
                print(root.name, scene_id, *told, sep="  ", flush=True)
    values = {name: {"runs": len(ones), "kept": sum(ones) / max(len(ones), 1)} for name, ones in kept.items()}
    for name, row in values.items():
        print(name, row)
    if args.record:
        about = f"sudden changes of light; tracker {args.method}, defaults, from truth, parts for {args.split}"
        names = ", ".join(root.name for root in args.datasets)
        measured.record(f"light_steps.{args.record}", about, UNIT, names, values)


def _worst_after(scene: BopScene, parts: Path, method: Method) -> Iterator[tuple[str, float]]:
    """By change: the largest ADD as a share of the diameter. Sequences that are too short have none."""
    object_id = scene.object_ids[0]
    model = prepared_part_of(scene, parts)
    metric = PartMetric(model.part, 500)
    frames = readable_frames(scene, STEP + LAST + 1)
    truths = [scene.truth(frame.index, object_id) for frame in frames]
    if len(frames) <= STEP + LAST or any(truth is None for truth in truths):
        return
    for name, (change, gain) in CHANGES.items():
        tracker, errors = Tracker(model, method), list[float]()
        for number, (frame, truth) in enumerate(zip(frames, truths, strict=True)):
            assert truth is not None
            if number == 0:
                tracker.start(frame, truth)
                continue
            result = tracker.track(frame if number < STEP else change(frame, gain))
            if number >= STEP + FIRST:
                errors.append(metric.share(result.cam_T_obj, truth))
        yield name, max(errors)


if __name__ == "__main__":
    main()
