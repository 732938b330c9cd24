"""Can the paper's idea win? Control points as variables with everything else at its best, against a pose.

All share the visibility network's edges, the search along normals with memory and reliability, the annealed loss and
prediction at constant velocity; control points are those of the middle section. From truth, no resets, the first
frame left out, one thread; every frame, and every second frame only. Kinds of motion are read from
scene_meta.json where a data set has it.

Example: python -m benchmarks.hybrid path/to/dataset --parts out/parts
(parts prepared before: acp-lab prepare MESH --out out/parts/DATASET)
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from acp_lab.commands import machine

# Before NumPy is imported: its linear algebra reads the number of threads once.
machine.limit_threads(1)

import numpy as np  # noqa: E402

if TYPE_CHECKING:
    from collections.abc import Iterator

    from acp_lab.tracking.method import Method

LIMITS = (0.02, 0.05, 0.10)
STEPS = (1, 2)


@dataclass(frozen=True)
class Track:
    """One run: ADD as a share of the diameter per frame."""

    sequence: str
    kind: str
    method: str
    step: int
    errors: np.ndarray


def methods() -> Iterator[Method]:
    """The variables and directions that are compared."""
    from acp_lab.imaging.edge_search import AS_THEY_ARE
    from acp_lab.tracking.learning.knowledge import Off, SampleLearning
    from acp_lab.tracking.method import ACP_PAPER_SAMPLES
    from acp_lab.tracking.motions import ControlPointVariables, PoseVariables
    from acp_lab.tracking.prediction import ConstantVelocityPrediction
    from acp_lab.tracking.priors import RigidityPrior
    from acp_lab.tracking.sources.rigid import CadSamples
    from acp_lab.tracking.targets.normals import NormalSearch

    pose = replace(
        ACP_PAPER_SAMPLES,
        name="pose",
        source=CadSamples("learned", inset_outlines=True),
        variables=PoseVariables(),
        control_points="mid-section",
        targets=(NormalSearch(replace(AS_THEY_ARE, blur_px=0.7), bind="step", min_score=0.0),),
        prediction=ConstantVelocityPrediction(rest_below=-1.0),
        # Of every frame, and for all levels.
        learning=SampleLearning(offsets=Off(), learn_above=-1.0, learn_from_px=0.0, trust_from_sigma_px=float("inf")),
    )
    yield pose
    exact, homography = ControlPointVariables(direction="autograd"), ControlPointVariables(direction="homography")
    name = "control points, exact Jacobian, prior 0.1"
    yield replace(pose, name=name, variables=exact, priors=(RigidityPrior(0.1),))
    name = "control points, homography, prior 0.3"
    yield replace(pose, name=name, variables=homography, priors=(RigidityPrior(0.3),))


def track(root: Path, parts: Path) -> Iterator[Track]:
    """Run every method, at every frame step, on every scene of a data set."""
    from acp_lab.evaluation import add_mm
    from acp_lab.prepared_part import PreparedPart
    from acp_lab.sequences.bop import BopDataset
    from acp_lab.tracking.tracker import Tracker
    from benchmarks.runs import readable_frames

    dataset = BopDataset(root)
    for scene_id in dataset.scenes():
        scene = dataset.open_scene(scene_id)
        frames = readable_frames(scene)
        object_id = scene.object_ids[0]
        model = PreparedPart.load(parts / dataset.name / f"obj_{object_id:06d}", dataset.part_path(object_id))
        meta = root / "test" / f"{scene_id:06d}" / "scene_meta.json"
        kind = json.loads(meta.read_text()).get("kind", "") if meta.exists() else ""
        for method in methods():
            for step in STEPS:
                tracker = Tracker(model, method)
                tracker.start(frames[0], scene.first_pose)
                errors = []
                for frame in frames[step::step]:
                    pose, truth = tracker.track(frame).cam_T_obj, scene.truth(frame.index, object_id)
                    assert truth is not None, f"{root}, scene {scene_id}: frame {frame.index} has no truth"
                    errors.append(add_mm(model.part.vertices, pose, truth) / model.part.diameter)
                yield Track(f"{dataset.name}/{scene_id}", kind, method.name, step, np.array(errors))


def print_table(tracks: list[Track]) -> dict[str, dict[str, list[float]]]:
    """Means over sequences, of all and of each kind; also as rows to be recorded."""
    names = list(dict.fromkeys(item.method for item in tracks))
    print("\n| sequences | step | " + " | ".join(names) + " |")
    print("|---" * (len(names) + 2) + "|")
    rows: dict[str, dict[str, list[float]]] = {}
    for kind in ("", *sorted({item.kind for item in tracks} - {""})):
        members = [item for item in tracks if kind in ("", item.kind)]
        count = len({item.sequence for item in members})
        for step in STEPS:
            cells = []
            for name in names:
                of_name = [item.errors for item in members if item.method == name and item.step == step]
                shares = [np.mean([(errors < limit).mean() for errors in of_name]) for limit in LIMITS]
                cells.append(" / ".join(f"{share:.2f}" for share in shares))
                rows.setdefault(f"{kind or 'all'}, step {step}", {})[name] = [float(share) for share in shares]
            print(f"| {kind or 'all'} ({count}) | {step} | " + " | ".join(cells) + " |")
    return rows


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("datasets", nargs="+", type=Path)
    parser.add_argument("--parts", type=Path, required=True, help="prepared parts, one folder per data set")
    parser.add_argument("--record", action="store_true", help="write to docs/measured.json")
    options = parser.parse_args()
    print(f"CPU: {machine.cpu_model()}; one thread")
    tracks = []
    for root in options.datasets:
        for item in track(root, options.parts):
            tracks.append(item)
            print(f"{item.sequence}, {item.kind}, {item.method}, step {item.step}: {(item.errors < 0.05).mean():.2f}")
    rows = print_table(tracks)
    if options.record:
        from benchmarks.measured import record

        unit = "share of frames with ADD below 2, 5, 10% of the diameter, mean over sequences"
        about = "control points as variables against a pose, everything else equal"
        names = ", ".join(root.name for root in options.datasets)
        data = f"{names}: {len({item.sequence for item in tracks})} sequences"
        record("hybrid", about, unit, data, rows)


if __name__ == "__main__":
    main()
