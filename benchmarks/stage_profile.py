"""Where the time of a frame goes: CPU time of each stage of `acp`, frame by frame, on one thread.

A stage's time is its own: what a stage inside it takes counts there. Frames are decoded before; the first frame of a
sequence and frames that are lost are left out. Times of a busy machine are longer, also as CPU time: processes share
caches. So every sequence is tracked several times, and of each frame and stage the shortest time counts.

Example: python -m benchmarks.stage_profile path/to/dataset:1 path/to/other:2 --parts out/parts
(each is a data set and a scene; parts prepared before: acp-lab prepare MESH --out out/parts/DATASET)
"""

from __future__ import annotations

import argparse
import resource
import time
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

from acp_lab.commands import machine

# Before NumPy is imported: its linear algebra reads the number of threads once.
machine.limit_threads(1)

import numpy as np  # noqa: E402

if TYPE_CHECKING:
    from acp_lab.prepared_part import PreparedPart
    from acp_lab.sequences.bop import BopScene

REST = "everything else"


class Stages:
    """CPU seconds of one frame by stage; `measured` makes a function one of them."""

    def __init__(self) -> None:
        self.spent_s: dict[str, float] = {}
        self._running: list[str] = []
        self._since = 0.0

    def begin(self) -> None:
        """A new frame."""
        self.spent_s = {REST: 0.0}
        self._running = [REST]
        self._since = time.process_time()

    def end(self) -> dict[str, float]:
        """Seconds by stage of the frame."""
        self._switch()
        return self.spent_s

    def measured(self, stage: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """The function, with its time counted."""

        @wraps(function)
        def inside(*arguments: Any, **named: Any) -> Any:
            self._switch()
            self._running.append(stage)
            try:
                return function(*arguments, **named)
            finally:
                self._switch()
                self._running.pop()

        return inside

    def _switch(self) -> None:
        now = time.process_time()
        if self._running:
            stage = self._running[-1]
            self.spent_s[stage] = self.spent_s.get(stage, 0.0) + now - self._since
        self._since = now


def watch(stages: Stages) -> None:
    """Have the stages of `acp` measured."""
    from acp_lab.tracking import frame_solver, pursuit, tracker
    from acp_lab.tracking.assessment import Assessment
    from acp_lab.tracking.kalman import PoseKalman
    from acp_lab.tracking.pose_descent import PoseLevel
    from acp_lab.tracking.priors import ControlPointDamping, MotionPrior
    from acp_lab.tracking.targets.normals import NormalMeasure, NormalTarget
    from acp_lab.tracking.targets.regions import RegionJudgement, RegionMemory, RegionTarget

    watched: tuple[tuple[Any, str, str], ...] = (
        (tracker.Tracker, "_steady", "light: sudden changes"),
        (pursuit.Pursuit, "sight", "picture: where did it go"),
        (PoseKalman, "observe", "motion filter"),
        (PoseKalman, "is_sure", "motion filter"),
        (PoseKalman, "information", "motion filter"),
        (frame_solver.FrameSolver, "look", "image: crop, blur, gradients"),
        (frame_solver.FrameSolver, "_generate", "edges that show, projected"),
        (NormalTarget, "bind", "image edges along normals"),
        (RegionTarget, "bind", "colours across the outline"),
        (MotionPrior, "bind", "Gauss-Newton steps"),
        (ControlPointDamping, "bind", "Gauss-Newton steps"),
        (frame_solver, "pose_level", "Gauss-Newton steps"),
        (PoseLevel, "minimise", "Gauss-Newton steps"),
        (PoseLevel, "information", "Gauss-Newton steps"),
        (NormalMeasure, "judge", "judging the pose"),
        (NormalMeasure, "plain_quality", "judging the pose"),
        (RegionJudgement, "lines", "judging the pose"),
        (Assessment, "quality", "judging the pose"),
        (Assessment, "covariance", "judging the pose"),
        (pursuit, "recover", "second tries"),
        (RegionMemory, "learn", "learning"),
        (tracker.Tracker, "_learn", "learning"),
    )
    for owner, name, stage in watched:
        found = owner.__dict__[name]
        if hasattr(found, "func"):  # a cached property
            found.func = stages.measured(stage, found.func)
        else:
            setattr(owner, name, stages.measured(stage, found))


def profile(stages: Stages, model: PreparedPart, scene: BopScene, start: np.ndarray, repeats: int) -> dict[str, Any]:
    """(frames,) ms by stage of the frames that are not lost, and of all stages under "frame"."""
    from acp_lab.tracking.result import TrackState
    from acp_lab.tracking.tracker import Tracker
    from benchmarks.runs import readable_frames

    frames, tracker = readable_frames(scene), Tracker(model)
    rounds = []
    for _ in range(repeats):
        tracker.start(frames[0], start)  # type: ignore[arg-type]
        spent = []
        for frame in frames[1:]:
            stages.begin()
            result = tracker.track(frame)
            found = stages.end()
            if result.state is not TrackState.LOST:
                spent.append(found | {"frame": sum(found.values())})
        rounds.append(spent)
    names = sorted({name for spent in rounds for one in spent for name in one})
    return {name: 1e3 * np.min([[one.get(name, 0.0) for one in spent] for spent in rounds], axis=0) for name in names}


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+", metavar="DATASET:SCENE")
    parser.add_argument("--parts", type=Path, required=True, help="prepared parts, one folder per data set")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--record", action="store_true", help="write to docs/measured.json")
    options = parser.parse_args()

    from acp_lab.prepared_part import PreparedPart
    from acp_lab.sequences.bop import BopDataset

    stages = Stages()
    watch(stages)
    by_size: dict[str, dict[str, list[np.ndarray]]] = {}
    for word in options.scenes:
        root, _, number = word.rpartition(":")
        dataset = BopDataset(Path(root))
        scene = dataset.open_scene(int(number))
        object_id, start = next(iter(scene.first_poses.items()))
        mesh = dataset.part_path(object_id)
        model = PreparedPart.load(options.parts / dataset.name / mesh.stem, mesh)
        camera = scene.camera(scene.frame_ids[0])
        size = by_size.setdefault(f"{camera.width}x{camera.height}", {})
        for name, values in profile(stages, model, scene, start, options.repeats).items():
            size.setdefault(name, []).append(values)

    print(f"CPU: {machine.cpu_model()}; one thread; CPU ms per frame, shortest of {options.repeats} runs")
    for size_name, spent in by_size.items():
        pooled = {name: np.concatenate(values) for name, values in spent.items()}
        whole = pooled.pop("frame")
        means = sorted(((name, float(values.mean())) for name, values in pooled.items()), key=lambda pair: -pair[1])
        middle, late, worst = float(np.median(whole)), float(np.percentile(whole, 95)), float(whole.max())
        print(f"\n{size_name}: {len(whole)} frames, median {middle:.1f}, 95% below {late:.1f}, worst {worst:.1f}")
        print("\n| stage | mean |\n|---|---|")
        print("\n".join(f"| {name} | {value:.2f} |" for name, value in means))
        if options.record:
            from benchmarks.measured import record

            unit = {"*": "CPU ms per frame"}
            data = f"{', '.join(_short(word) for word in options.scenes)}: those of {size_name}"
            about = f"where a frame's time goes, acp, mean of each stage, shortest of {options.repeats} runs"
            record(f"speed.stages.{size_name}", about, unit, data, {name: round(value, 2) for name, value in means})
            about = f"a whole frame, acp, shortest of {options.repeats} runs: median, 95th percentile, worst"
            record(f"speed.frame.{size_name}", about, unit, data, {"acp": [middle, late, worst]})
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    print(f"\nmemory at most: {peak_mb:.0f} MB, with the decoded frames")


def _short(word: str) -> str:
    root, _, number = word.rpartition(":")
    return f"{Path(root).resolve().name} {number}"


if __name__ == "__main__":
    main()
