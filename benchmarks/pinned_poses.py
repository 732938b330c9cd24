"""Poses of every method on the sample and on two made sequences, stored before a change and compared after it.

A change of structure must not change numbers. What may differ: methods that vary control points read a pose off them by
planar PnP, which turns a rounding of 1e-13 px into 1e-6 mm and more, and a track that is lost is chaotic.

Example: python -m benchmarks.pinned_poses --parts out/parts --store before.npz
         python -m benchmarks.pinned_poses --parts out/parts --compare before.npz
(the made sequences: python -m data_recipes.metal_sequences --out out/made --parts l_bracket,valve_body
--kinds regular,fast --sequences 2 --frames 16 --seed 71; parts of both data sets prepared with --generator both and
again with --generator autoencoder --fast, into out/parts/sample and out/parts/made)
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from acp_lab.commands import machine

# Before NumPy is imported: its linear algebra reads the number of threads once.
machine.limit_threads(1)

import numpy as np  # noqa: E402

from acp_lab.errors import PreparationError  # noqa: E402

if TYPE_CHECKING:
    from acp_lab.tracking.method import Method

FRAMES = 16


def methods() -> dict[str, Method]:
    """The named methods, and three other sums of parts that use what these do not."""
    from acp_lab.tracking.learning.knowledge import Off, SampleLearning
    from acp_lab.tracking.method import METHODS
    from acp_lab.tracking.motions import ControlPointVariables, PoseVariables
    from acp_lab.tracking.prediction import ConstantVelocityPrediction
    from acp_lab.tracking.priors import RigidityPrior
    from acp_lab.tracking.schedule import ShareSchedule
    from acp_lab.tracking.solvers import Adam, LevenbergMarquardt
    from acp_lab.tracking.sources.painted import PaintedRidges
    from acp_lab.tracking.sources.rigid import CadSamples
    from acp_lab.tracking.targets.distance_map import DistanceMap, EdgeMapConfig
    from acp_lab.tracking.targets.normals import NormalSearch

    base = replace(METHODS["acp-paper-samples"], control_points="mid-section")
    samples = CadSamples("learned", inset_outlines=True)
    others = (
        replace(
            base,
            name="painted ridges",
            source=PaintedRidges(),
            variables=ControlPointVariables(carry="points", residual="homography"),
            targets=(DistanceMap("tukey", EdgeMapConfig(orientation_bins=4)),),
            schedule=ShareSchedule(0.08, samples=300),
            solver=LevenbergMarquardt(steps=3),
        ),
        replace(
            base,
            name="points along normals",
            source=samples,
            targets=(NormalSearch(bind="step"),),
            priors=(RigidityPrior(),),
            prediction=ConstantVelocityPrediction(),
            learning=SampleLearning(offsets=Off(), learn_from_px=0.0),
        ),
        replace(
            base,
            name="pose by Adam",
            source=replace(samples, generator="templates"),
            variables=PoseVariables(),
            targets=(DistanceMap("saturating", EdgeMapConfig(denoise="median", thresholds="median")),),
            solver=Adam(steps=12),
        ),
    )
    return METHODS | {method.name: method for method in others}


def poses(datasets: dict[str, Path], parts: Path) -> dict[str, np.ndarray]:
    """(frames, 4, 4) per data set, scene and method; methods whose generator is not prepared are left out."""
    from acp_lab.prepared_part import PreparedPart
    from acp_lab.sequences.bop import BopDataset
    from acp_lab.tracking.tracker import Tracker
    from benchmarks.runs import readable_frames

    found = {}
    for name, root in datasets.items():
        dataset = BopDataset(root)
        for scene_id in dataset.scenes():
            scene = dataset.open_scene(scene_id)
            object_id, start = next(iter(scene.first_poses.items()))
            mesh = dataset.part_path(object_id)
            model = PreparedPart.load(parts / name / mesh.stem, mesh)
            first, *others = readable_frames(scene, FRAMES)
            for method in methods().values():
                try:
                    tracker = Tracker(model, method)
                except PreparationError as error:
                    print(f"{name} {scene_id}: {method.name} is left out: {error}")
                    continue
                results = [tracker.start(first, start), *(tracker.track(frame) for frame in others)]
                found[f"{name} {scene_id}, {method.name}"] = np.stack([result.cam_T_obj for result in results])
    return found


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--parts", type=Path, required=True, help="prepared parts, folders sample and made")
    parser.add_argument("--made", type=Path, help="the data set of made sequences")
    parser.add_argument("--store", type=Path, metavar="FILE.npz")
    parser.add_argument("--compare", type=Path, metavar="FILE.npz")
    options = parser.parse_args()

    from acp_lab.sample import sample_dataset

    datasets = {"sample": sample_dataset()} | ({"made": options.made} if options.made else {})
    now = poses(datasets, options.parts)
    if options.store:
        np.savez(options.store, **now)  # type: ignore[arg-type]
        print(f"{options.store}: {len(now)} tracks")
    if options.compare:
        with np.load(options.compare) as before:
            print("| track | largest difference of a pose's number | first frame above 1e-9 |\n|---|---|---|")
            for key, found in now.items():
                if key not in before:
                    print(f"| {key} | new | |")
                    continue
                off = np.abs(found - before[key]).max((1, 2))
                above = np.flatnonzero(off > 1e-9)
                print(f"| {key} | {off.max():.1e} | {above[0] if len(above) else 'none'} |")


if __name__ == "__main__":
    main()
