"""How far off may a hand be for `snap` to find the part?

    python -m benchmarks.snap_starts acp_lab/sample/data --parts PARTS --record sample

Five frames of each sequence, spread over it, five starts in each. By hand: the four control points, each within 5 px of
its place both ways, and the pose that they leave; where that is not found, the other pose of four coplanar points, as
in the aligner. By pose: turned by 10 degrees, shifted by 10 mm, and up to 8% nearer or farther.
PARTS holds prepared parts, or one folder of them per data set.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from acp_lab.commands.machine import limit_threads

limit_threads(1)  # before NumPy is imported

import numpy as np  # noqa: E402

from acp_lab.control_points.canonical_frame import eye_position  # noqa: E402
from acp_lab.control_points.coplanar_points import mid_section_points  # noqa: E402
from acp_lab.control_points.view_regions import ALL_REGIONS, choose_region  # noqa: E402
from acp_lab.evaluation.part_metric import PartMetric  # noqa: E402
from acp_lab.geometry.arrays import FloatArray  # noqa: E402
from acp_lab.geometry.planar_pnp import solve_planar_pnp  # noqa: E402
from acp_lab.geometry.pose import disturb_pose, make_pose, transform  # noqa: E402
from acp_lab.prepared_part import PreparedPart  # noqa: E402
from acp_lab.sequences.bop import BopDataset  # noqa: E402
from acp_lab.sequences.frame import Frame  # noqa: E402
from acp_lab.tracking.snap import snap  # noqa: E402
from benchmarks import measured  # noqa: E402
from benchmarks.runs import prepared_part_of, readable_frames  # noqa: E402

FRAMES, SEEDS = 5, 5
POINTS_PX = 5.0
TURN_DEG, SHIFT_MM, DEPTH_SHARE = 10.0, 10.0, 0.08
LIMIT = 0.02
BY_HAND, BY_POSE = "points 5 px off", "pose 10 degrees and 10 mm off"
UNIT = {"starts": "starts", "snapped": "of these with ADD (ADD-S for symmetric parts) below 2% of the diameter"}


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("datasets", nargs="+", type=Path)
    parser.add_argument("--parts", type=Path, required=True)
    parser.add_argument("--record", metavar="KEY")
    args = parser.parse_args()
    snapped: dict[str, list[bool]] = {BY_HAND: [], BY_POSE: []}
    for root in args.datasets:
        for scene_id in BopDataset(root).scenes():
            scene = BopDataset(root).open_scene(scene_id)
            model = prepared_part_of(scene, args.parts)
            metric = PartMetric(model.part)
            frames = readable_frames(scene)
            for frame in (frames[k] for k in np.linspace(0, len(frames) - 1, FRAMES).round().astype(int)):
                truth = scene.truth(frame.index, scene.object_ids[0])
                if truth is None:
                    continue
                for seed in range(SEEDS):
                    rng = np.random.default_rng(seed)
                    starts = {BY_HAND: set_by_hand(model, frame, truth, rng), BY_POSE: (off(model, truth, rng),)}
                    for how, poses in starts.items():
                        snapped[how].append(metric.share(snapped_to(model, frame, poses), truth) < LIMIT)
            told = (f"{how}: {sum(some)} of {len(some)}" for how, some in snapped.items())
            print(root.name, scene_id, *told, sep="  ", flush=True)
    if args.record:
        values = {how: {"starts": len(some), "snapped": sum(some)} for how, some in snapped.items()}
        about = "starts that snap brings below 2% of the diameter"
        measured.record(f"snap.{args.record}", about, UNIT, ", ".join(root.name for root in args.datasets), values)


def set_by_hand(
    model: PreparedPart, frame: Frame, truth: FloatArray, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Both poses (4, 4) of four control points that a hand put near their places, the one that fits better first."""
    part = model.part
    region = choose_region(eye_position(truth) - part.box_centre, 0.5 * part.box_size)
    points_obj = mid_section_points(part.box_min, part.box_max, ALL_REGIONS[region].axis)
    points = frame.camera.project(transform(truth, points_obj)) + rng.uniform(-POINTS_PX, POINTS_PX, (4, 2))
    first, second = solve_planar_pnp(points_obj, points, frame.camera).poses
    return first, second


def off(model: PreparedPart, truth: FloatArray, rng: np.random.Generator) -> FloatArray:
    """A pose (4, 4) that is off by what `TURN_DEG`, `SHIFT_MM` and `DEPTH_SHARE` say."""
    pose = disturb_pose(truth, model.part.box_centre, TURN_DEG, SHIFT_MM, rng)
    centre = transform(pose, model.part.box_centre)
    return make_pose(pose[:3, :3], pose[:3, 3] + rng.uniform(-DEPTH_SHARE, DEPTH_SHARE) * centre)


def snapped_to(model: PreparedPart, frame: Frame, starts: tuple[FloatArray, ...]) -> FloatArray:
    """Where the first start that is found snaps to, (4, 4); the best of all where none is."""
    found = []
    for start in starts:
        found.append(snap(model, frame, start))
        if found[-1].is_good:
            break
    return max(found, key=lambda result: result.quality).cam_T_obj


if __name__ == "__main__":
    main()
