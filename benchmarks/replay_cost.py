"""What a replay costs: the size of its file, and the time of the thread that tracks.

    python -m benchmarks.replay_cost metal_public --parts PARTS --record

Each sequence, up to its hundredth frame, is tracked twice by `acp`: with a replay, and with one that holds all
iterations inside the frames. Times are CPU ms of the tracking thread.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from acp_lab.commands.machine import limit_threads

limit_threads(1)  # before NumPy is imported

import numpy as np  # noqa: E402

from acp_lab.display.replay.log import Iterations  # noqa: E402
from acp_lab.display.replay.recorder import Replay  # noqa: E402
from acp_lab.prepared_part import PreparedPart  # noqa: E402
from acp_lab.sequences.bop import BopDataset, BopScene  # noqa: E402
from acp_lab.sequences.frame import Frame, UnreadableFrame  # noqa: E402
from acp_lab.tracking.result import TrackResult  # noqa: E402
from acp_lab.tracking.tracker import Tracker  # noqa: E402
from benchmarks import measured  # noqa: E402
from benchmarks.runs import prepared_part_of  # noqa: E402

FRAMES = 100
UNIT = {
    "file": "MB for 100 frames of 640x512, least and most of the sequences",
    "file_all": "MB for 100 frames with all iterations",
    "thread": "CPU ms per frame on the tracking thread, median over frames, least and most",
    "start": "s, once",
    "iterations": "CPU ms per frame more there, with all iterations, median of the sequences",
    "tracker": "ms per frame more in the tracker itself, with all iterations, median of the sequences",
}


class TimedReplay(Replay):
    """A replay that keeps the CPU time of each frame: times_ms."""

    def on_frame(self, frame: Frame | UnreadableFrame, results: Mapping[int, TrackResult]) -> None:
        """See `Replay`."""
        begin_s = time.thread_time()
        super().on_frame(frame, results)
        self.times_ms = [*getattr(self, "times_ms", []), 1e3 * (time.thread_time() - begin_s)]


@dataclass(frozen=True)
class Cost:
    """Of one run. file_mb: for `FRAMES` frames; frame_ms: of the observer, median; start_s: of its first frame;
    tracker_ms: of the tracker, median."""

    file_mb: float
    frame_ms: float
    start_s: float
    tracker_ms: float


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("datasets", nargs="+", type=Path)
    parser.add_argument("--parts", type=Path, required=True)
    parser.add_argument("--record", action="store_true")
    args = parser.parse_args()
    plain, whole = list[Cost](), list[Cost]()
    for root in args.datasets:
        for scene_id in BopDataset(root).scenes():
            scene = BopDataset(root).open_scene(scene_id)
            model = prepared_part_of(scene, args.parts)
            plain.append(cost(scene, model, "off"))
            whole.append(cost(scene, model, "all"))
            print(root.name, scene_id, plain[-1], whole[-1], flush=True)
    values = {
        "file": _ends([one.file_mb for one in plain]),
        "file_all": _ends([one.file_mb for one in whole]),
        "thread": _ends([one.frame_ms for one in plain]),
        "start": max(one.start_s for one in plain),
        "iterations": float(np.median([b.frame_ms - a.frame_ms for a, b in zip(plain, whole, strict=True)])),
        "tracker": float(np.median([b.tracker_ms - a.tracker_ms for a, b in zip(plain, whole, strict=True)])),
    }
    print(values)
    if args.record:
        data = ", ".join(root.name for root in args.datasets)
        measured.record("replay.cost", "what a replay costs", UNIT, data, {"all": values})


def cost(scene: BopScene, model: PreparedPart, iterations: Iterations) -> Cost:
    """Of one sequence."""
    object_id = scene.object_ids[0]
    with tempfile.TemporaryDirectory() as folder:
        replay = TimedReplay(Path(folder) / "run.rrd", iterations=iterations)
        run = Tracker(model).run(scene, scene.first_poses[object_id], [replay], object_id, FRAMES)
        size = replay.path.stat().st_size
    results = run.results[object_id]
    first_ms, *others_ms = replay.times_ms
    tracker_ms = [1e3 * result.timings.total_s for result in results[1:]]
    return Cost(
        1e-6 * size * FRAMES / len(results),
        float(np.median(others_ms)),
        1e-3 * first_ms,
        float(np.median(tracker_ms)),
    )


def _ends(values: list[float]) -> list[float]:
    return [min(values), max(values)]


if __name__ == "__main__":
    main()
