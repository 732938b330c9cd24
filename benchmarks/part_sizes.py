"""How small, and how large, may a part be in the picture?

    python -m benchmarks.part_sizes metal_hard metal_dev own_checking --parts PARTS --split checking --record checking

Each sequence is scaled until the part's diameter appears as long as it is told here, in the middle frame: its length,
times the focal length, over its distance. Forwards, from truth and from 5 degrees and 5 mm off, with defaults. Where
it is scaled up the picture holds nothing new, but has the px of a larger one; where the part is smaller as it is than
the sizes to scale down to, it does without these.

A frame counts when at least 30% of the part is visible. Said: how likely the tracker calls its poses right, quality
times exactness. PARTS holds prepared parts, or one folder of them per data set.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from acp_lab.commands.machine import limit_threads

limit_threads(1)  # before NumPy is imported

import cv2  # noqa: E402
import numpy as np  # noqa: E402

from acp_lab.errors import TrackingError  # noqa: E402
from acp_lab.evaluation.part_metric import PartMetric  # noqa: E402
from acp_lab.geometry.pose import disturb_pose  # noqa: E402
from acp_lab.sequences.bop import BopDataset, BopScene  # noqa: E402
from acp_lab.sequences.frame import Frame  # noqa: E402
from acp_lab.tracking.magnification import appears_px  # noqa: E402
from acp_lab.tracking.method import Method, method_named  # noqa: E402
from acp_lab.tracking.method_file import read_method  # noqa: E402
from acp_lab.tracking.tracker import Tracker  # noqa: E402
from benchmarks import measured  # noqa: E402
from benchmarks.robustness import SPLITS, is_in_split  # noqa: E402
from benchmarks.runs import LOST, STARTS, part_name, prepared_part_of, readable_frames, visible_frames  # noqa: E402

LARGE_PX, SMALL_PX = (900, 600, 400), (120, 90, 70, 50, 35)
UNIT = {
    "@*": "share of frames with ADD (ADD-S for symmetric parts) below 2, 5% of the diameter, mean over runs",
    "lost": "runs in which ADD was ever above 30%",
    "runs": "runs",
    "said": "mean of what the tracker says how likely a pose is right, which is below 5%",
}


@dataclass(frozen=True)
class SizedRun:
    """A run, the first frame left out: of the frames that count, ADD(-S) as a share of the diameter, and what was said.

    errors: infinite throughout for a start that is refused.
    """

    size_px: int
    start: str
    errors: np.ndarray
    said: np.ndarray


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("datasets", nargs="+", type=Path)
    parser.add_argument("--parts", type=Path, required=True)
    parser.add_argument("--method", default="acp", help="a method's name, or a TOML file")
    parser.add_argument("--split", choices=SPLITS, default="all")
    parser.add_argument("--record", metavar="KEY")
    args = parser.parse_args()
    method = read_method(Path(args.method)) if args.method.endswith(".toml") else method_named(args.method)
    runs: list[SizedRun] = []
    for root in args.datasets:
        for scene_id in BopDataset(root).scenes():
            scene = BopDataset(root).open_scene(scene_id)
            if is_in_split(part_name(root, scene.object_ids[0]), args.split):
                new = list(_runs(scene, args.parts, method))
                told = [f"{run.size_px} px, {run.start}: median {100 * np.median(run.errors):.1f}%" for run in new]
                print(root.name, scene_id, *told, sep="  ", flush=True)
                runs += new
    groups = {
        (size, start): [r for r in runs if (r.size_px, r.start) == (size, start)]
        for size in LARGE_PX + SMALL_PX
        for start in ("truth", "5")
    }
    values = {f"{size} px, {start}": _row(members) for (size, start), members in groups.items() if members}
    for name, row in values.items():
        print(name, row)
    if args.record:
        about = f"parts that are small or large in the picture; tracker {method.name}, forwards, parts for {args.split}"
        names = ", ".join(root.name for root in args.datasets)
        measured.record(f"part_sizes.{args.record}", about, UNIT, names, values)


def _runs(scene: BopScene, parts: Path, method: Method) -> Iterator[SizedRun]:
    object_id = scene.object_ids[0]
    model = prepared_part_of(scene, parts)
    metric = PartMetric(model.part)
    frames = readable_frames(scene)
    truths = {f.index: truth for f in frames if (truth := scene.truth(f.index, object_id)) is not None}
    counts = visible_frames(scene.folder, object_id, truths)
    frames = [frame for frame in frames if frame.index in truths]
    frames = frames[next(number for number, frame in enumerate(frames) if counts[frame.index]) :]
    middle = frames[len(frames) // 2]
    now_px = appears_px(model.part, middle.camera, truths[middle.index])
    for size_px in (*LARGE_PX, *(size for size in SMALL_PX if size <= now_px)):
        for start in ("truth", "5"):
            rng = np.random.default_rng([0, scene.scene_id, object_id])
            pose = disturb_pose(truths[frames[0].index], model.part.box_centre, *STARTS[start], rng)
            tracker, errors, said = Tracker(model, method), list[float](), list[float]()
            for number, taken in enumerate(frames):
                frame = scaled(taken, size_px / now_px)
                try:
                    result = tracker.track(frame) if number else tracker.start(frame, pose)
                except TrackingError:  # the start is refused
                    count = sum(counts[one.index] for one in frames[1:])
                    errors, said = [np.inf] * count, [0.0] * count
                    break
                if number and counts[frame.index]:
                    errors.append(metric.share(result.cam_T_obj, truths[frame.index]))
                    said.append(result.right)
            yield SizedRun(size_px, start, np.array(errors), np.array(said))


def scaled(frame: Frame, scale: float) -> Frame:
    """A frame with `scale` times as many pixels in each direction, means of what they cover or values in between."""
    size = round(scale * frame.camera.width), round(scale * frame.camera.height)
    interpolation = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_CUBIC
    image = np.asarray(cv2.resize(frame.image, size, interpolation=interpolation), np.uint8)
    return replace(frame, image=image, camera=frame.camera.resized(*size))


def _row(runs: list[SizedRun]) -> dict[str, float]:
    """Of runs of one size and start, as a row of measured numbers."""
    return {
        "@2": float(np.mean([(run.errors < 0.02).mean() for run in runs])),
        "@5": float(np.mean([(run.errors < 0.05).mean() for run in runs])),
        "lost": sum(bool((run.errors > LOST).any()) for run in runs),
        "runs": len(runs),
        "said": float(np.mean([run.said.mean() for run in runs])),
    }


if __name__ == "__main__":
    main()
