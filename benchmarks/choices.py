"""What each choice within a method is worth: one thing changed at a time, on the same edges.

Two bases, both with the visibility network's edges and the control points of the middle section: the paper's path
(`acp-paper-samples`: a distance map, eight coordinates moved by a homography), and a pose with search along normals.
From truth, no resets, the first frame left out, one thread; the mean over all scenes, and the first scene alone.

Example: python -m benchmarks.choices path/to/dataset --parts out/parts --record
(parts prepared before: acp-lab prepare MESH --out out/parts/DATASET)
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from acp_lab.commands import machine

# Before NumPy is imported: its linear algebra reads the number of threads once.
machine.limit_threads(1)

import numpy as np  # noqa: E402

if TYPE_CHECKING:
    from acp_lab.tracking.losses import LossForm
    from acp_lab.tracking.method import Method

LIMITS = (0.02, 0.05, 0.10)


def paper_choices() -> Iterator[tuple[str, Method]]:
    """The paper's path on the visibility network's edges, and one change each."""
    from acp_lab.tracking.motions import ControlPointVariables, PoseVariables
    from acp_lab.tracking.priors import RigidityPrior
    from acp_lab.tracking.schedule import ShareSchedule
    from acp_lab.tracking.targets.distance_map import DistanceMap, EdgeMapConfig

    base = on_exact_edges()
    yield "base", base
    forms: tuple[LossForm, ...] = ("saturating", "tukey", "logistic")
    for form in forms:
        yield f"loss {form}", replace(base, targets=(DistanceMap(loss=form),))
    for alpha in (0.035, 0.07):
        yield f"alpha {alpha:g}", replace(base, schedule=ShareSchedule(alpha=alpha))
    for alpha in (0.035, 0.05, 0.07):
        yield f"alpha {alpha:g}, fixed", replace(
            base, schedule=ShareSchedule(alpha=alpha, shares=(1.0,)), solver=replace(base.solver, steps=12)
        )
    for blur in (1.0, 1.5, 2.0):
        yield f"blur {blur:g} px", replace(base, targets=(DistanceMap(edge_map=EdgeMapConfig(blur_px=blur)),))
    yield "median filter", replace(base, targets=(DistanceMap(edge_map=EdgeMapConfig(denoise="median")),))
    for bins in (4, 8):
        edge_map = EdgeMapConfig(orientation_bins=bins)
        yield f"{bins} orientation bins", replace(base, targets=(DistanceMap(edge_map=edge_map),))
    yield "I carried", replace(base, variables=ControlPointVariables(carry="points"))
    for weight in (0.1, 0.3):
        yield f"rigidity prior {weight:g}", replace(base, priors=(RigidityPrior(weight),))
    yield "edges generated anew", replace(base, variables=ControlPointVariables(direction="differences"))
    yield "pose", replace(base, variables=PoseVariables())


def search_choices() -> Iterator[tuple[str, Method]]:
    """A pose on the same edges: from the distance map to the search along normals with memory and prediction."""
    from acp_lab.imaging.edge_search import AS_THEY_ARE
    from acp_lab.tracking.learning.knowledge import Off, SampleLearning
    from acp_lab.tracking.motions import PoseVariables
    from acp_lab.tracking.prediction import ConstantVelocityPrediction
    from acp_lab.tracking.targets.distance_map import DistanceMap, EdgeMapConfig
    from acp_lab.tracking.targets.normals import NormalSearch

    pose = replace(on_exact_edges(), variables=PoseVariables())
    yield "distance map", pose
    yield (
        "distance map, 8 orientation bins",
        replace(pose, targets=(DistanceMap(edge_map=EdgeMapConfig(orientation_bins=8)),)),
    )
    normals = replace(pose, targets=(NormalSearch(replace(AS_THEY_ARE, blur_px=0.7), bind="step", min_score=0.0),))
    # Of every frame, and for all levels.
    memory = SampleLearning(offsets=Off(), learn_above=-1.0, learn_from_px=0.0, trust_from_sigma_px=float("inf"))
    prediction = ConstantVelocityPrediction(rest_below=-1.0)
    yield "normals", normals
    yield "normals, memory", replace(normals, learning=memory)
    yield "normals, prediction", replace(normals, prediction=prediction)
    yield "normals, memory, prediction", replace(normals, learning=memory, prediction=prediction)


def on_exact_edges() -> Method:
    """The paper's path on the visibility network's edges, with the control points of the middle section."""
    from acp_lab.tracking.method import ACP_PAPER_SAMPLES
    from acp_lab.tracking.sources.rigid import CadSamples

    return replace(ACP_PAPER_SAMPLES, source=CadSamples("learned", inset_outlines=True), control_points="mid-section")


def scores(root: Path, parts: Path, methods: dict[str, Method]) -> dict[str, dict[str, float]]:
    """Per method: share of frames below each limit, mean over scenes and of the first scene."""
    from acp_lab.evaluation import evaluate
    from acp_lab.prepared_part import PreparedPart
    from acp_lab.sequences.bop import BopDataset
    from acp_lab.tracking.tracker import Tracker

    dataset = BopDataset(root)
    shares: dict[str, list[list[float]]] = {name: [] for name in methods}
    for scene_id in dataset.scenes():
        scene = dataset.open_scene(scene_id)
        object_id = scene.object_ids[0]
        model = PreparedPart.load(parts / dataset.name / f"obj_{object_id:06d}", dataset.part_path(object_id))
        for name, method in methods.items():
            run = Tracker(model, method).run(scene, scene.first_pose)
            errors = np.array(evaluate(run, scene).objects[0].errors.distance, float)
            shares[name].append([float((errors < limit).mean()) for limit in LIMITS])
    rows = {}
    for name, found in shares.items():
        means = dict(zip(("@2", "@5", "@10"), np.mean(found, axis=0).tolist(), strict=True))
        rows[name] = means | {"first_@2": found[0][0]}
    return rows


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("dataset", type=Path)
    parser.add_argument("--parts", type=Path, required=True, help="prepared parts, one folder per data set")
    parser.add_argument("--record", action="store_true", help="write to docs/measured.json")
    options = parser.parse_args()
    print(f"CPU: {machine.cpu_model()}; one thread")
    for group, found in (("paper", paper_choices()), ("search", search_choices())):
        rows = scores(options.dataset, options.parts, dict(found))
        print(f"\n**{group}**\n\n| choice | @2% | @5% | @10% | first scene @2% |\n|---|---|---|---|---|")
        for name, row in rows.items():
            print(f"| {name} | " + " | ".join(f"{value:.2f}" for value in row.values()) + " |")
        if options.record:
            from benchmarks.measured import record

            unit = {
                "@*": "share of frames with ADD below 2, 5, 10% of the diameter, mean over scenes",
                "first_@2": "share of frames with ADD below 2% of the diameter, first scene",
            }
            about = f"one choice changed at a time ({group}), visibility network's edges, from truth, no resets"
            record(f"choices.{group}.{options.dataset.name}", about, unit, options.dataset.name, rows)


if __name__ == "__main__":
    main()
