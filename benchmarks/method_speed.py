"""Time per frame of several methods on one scene, side by side: every frame is given to each method in turn.

So a machine that is slow for a minute is slow for all of them. From truth, no resets, one thread; frames are decoded
before, the first frame left out. Methods: those of the paper, and acp where its parts are at hand.

Example: python -m benchmarks.method_speed path/to/dataset --scene 1 --parts out/parts
(a part prepared before: acp-lab prepare MESH --out out/parts/DATASET --generator autoencoder --regions K, and for acp
again without the last two options, into the folder of --acp-parts)
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import TYPE_CHECKING

from acp_lab.commands import machine

# Before NumPy is imported: its linear algebra reads the number of threads once.
machine.limit_threads(1)

import numpy as np  # noqa: E402

if TYPE_CHECKING:
    from acp_lab.sequences.bop import BopScene
    from acp_lab.tracking.tracker import Tracker


def frame_times(
    trackers: dict[str, Tracker], scene: BopScene, start: np.ndarray, repeats: int
) -> dict[str, np.ndarray]:
    """(frames * repeats,) ms of each tracker, from the decoded frame to the pose."""
    from benchmarks.runs import readable_frames

    frames = readable_frames(scene)
    times: dict[str, list[float]] = {name: [] for name in trackers}
    for _ in range(repeats):
        for tracker in trackers.values():
            tracker.start(frames[0], start)
        for frame in frames[1:]:
            for name, tracker in trackers.items():
                begin = time.perf_counter()
                tracker.track(frame)
                times[name].append(1e3 * (time.perf_counter() - begin))
    return {name: np.array(values) for name, values in times.items()}


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("dataset", type=Path)
    parser.add_argument("--parts", type=Path, required=True, help="prepared parts, one folder per data set")
    parser.add_argument("--acp-parts", type=Path, help="parts prepared for acp, one folder per data set")
    parser.add_argument("--scene", type=int, default=1)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--record", action="store_true", help="write to docs/measured.json")
    options = parser.parse_args()

    from acp_lab.prepared_part import PreparedPart
    from acp_lab.sequences.bop import BopDataset
    from acp_lab.tracking.method import ACP, METHODS
    from acp_lab.tracking.tracker import Tracker

    dataset = BopDataset(options.dataset)
    scene = dataset.open_scene(options.scene)
    object_id, start = next(iter(scene.first_poses.items()))
    mesh = dataset.part_path(object_id)

    def prepared(folder: Path) -> PreparedPart:
        return PreparedPart.load(folder / dataset.name / f"obj_{object_id:06d}", mesh)

    trackers: dict[str, Tracker] = {}
    if options.acp_parts:
        trackers[ACP.name] = Tracker(prepared(options.acp_parts))
    model = prepared(options.parts)
    trackers |= {name: Tracker(model, method) for name, method in METHODS.items() if method is not ACP}
    times = frame_times(trackers, scene, start, options.repeats)

    camera = scene.camera(scene.frame_ids[0])
    print(
        f"CPU: {machine.cpu_model()}; one thread; {dataset.name} {scene.scene_id}, {camera.width}x{camera.height}, ms"
    )
    print("\n| method | median | quarter below | quarter above |")
    print("|---|---|---|---|")
    for name, values in times.items():
        low, middle, high = np.percentile(values, (25, 50, 75))
        print(f"| {name} | {middle:.1f} | {low:.1f} | {high:.1f} |")
    if options.record:
        from benchmarks.measured import record

        medians = {name: float(np.median(values)) for name, values in times.items()}
        data = f"{dataset.name}, sequence {options.scene}, {camera.width}x{camera.height}"
        record("speed.methods", "every frame given to each method in turn", "ms per frame, median", data, medians)


if __name__ == "__main__":
    main()
