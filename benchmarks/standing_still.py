"""A part that stands still for a while: does its pose stay where it is?

    python -m benchmarks.standing_still metal_hard metal_dev own_checking --parts PARTS --split checking --record KEY

Each sequence is tracked forwards, from truth and from 5 degrees and 5 mm off, with defaults. In its middle it stops:
the same picture comes for 120 frames more, each with a sensor's noise of its own, in light that stays or that fades to
0.4 of itself meanwhile, and is that dark when the part moves on. Every method is run as it is, where frames teach that
bring news (`acp_lab.tracking.learning.novelty`), and learning from every frame. A frame counts when at least 30% of the
part is visible; the covariance is not asked of parts with symmetries. PARTS holds prepared parts, or one folder of them
per data set.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from acp_lab.commands.machine import limit_threads

limit_threads(1)  # before NumPy is imported

import numpy as np  # noqa: E402

from acp_lab.evaluation.part_metric import PartMetric  # noqa: E402
from acp_lab.geometry.arrays import FloatArray  # noqa: E402
from acp_lab.geometry.pose import disturb_pose  # noqa: E402
from acp_lab.geometry.pose_step import pose_step_between  # noqa: E402
from acp_lab.sequences.bop import BopScene  # noqa: E402
from acp_lab.tracking.learning.knowledge import SampleLearning  # noqa: E402
from acp_lab.tracking.method import Method, method_named  # noqa: E402
from acp_lab.tracking.tracker import Tracker  # noqa: E402
from benchmarks.faulty_frames import in_light, noisy  # noqa: E402
from benchmarks.robustness import STARTS  # noqa: E402
from benchmarks.runs import LOST, prepared_part_of  # noqa: E402
from benchmarks.told_wrong import STARTS_TOLD, ToldRun, TrueFrame, arguments, record, rows_of, true_frames  # noqa: E402
from benchmarks.uncertainty import WITHIN_6  # noqa: E402

STANDS, NOISE = 120, 2.0
"""Frames, and grey values."""
ENDS = 5
"""Frames over which an error at the beginning and at the end is the mean."""
LIGHTS = {"light that stays": 1.0, "light that fades": 0.4}
UNIT = {
    "begin": "ADD (ADD-S) in the first 5 frames of the stand, % of the diameter, mean over runs",
    "end": "the same in its last 5 frames",
    "@2": "share of the frames of the stand with ADD (ADD-S) below 2% of the diameter",
    "@2 afterwards": "the same of the frames in which the part moves on",
    "within": "share of the frames of the stand whose truth is within the 95% region that the covariance tells",
    "lost": "runs in which ADD (ADD-S) was ever above 30%",
    "runs": "runs",
}


@dataclass(frozen=True)
class Stand(ToldRun):
    """A run of errors before, while and after the part stands still. stands: (m,) errors meanwhile; afterwards: (k,).

    squared: (m,) normalised errors of the poses, NaN where no covariance was asked.
    """

    stands: FloatArray
    afterwards: FloatArray
    squared: FloatArray


def main() -> None:
    """See the module."""
    args = arguments(__doc__).parse_args()
    method = method_named(args.method)
    if not isinstance(method.learning, SampleLearning):
        raise SystemExit(f"--method {method.name}: learns nothing of edges: give one that does, such as acp")
    learns_always = replace(method, learning=replace(method.learning, learn_from_px=0.0))
    methods = {"news teach": method, "all teaches": learns_always}
    rows = rows_of(args, lambda scene: _runs(scene, args.parts, methods), _row)
    record(args, "standing_still", "a part that stands still", UNIT, rows)


def _row(runs: Sequence[Stand]) -> dict[str, float]:
    squared = np.concatenate([run.squared for run in runs])
    return {
        "begin": float(np.mean([100.0 * run.stands[:ENDS].mean() for run in runs])),
        "end": float(np.mean([100.0 * run.stands[-ENDS:].mean() for run in runs])),
        "@2": float(np.mean([(run.stands < 0.02).mean() for run in runs])),
        "@2 afterwards": float(np.mean([(run.afterwards < 0.02).mean() for run in runs])),
        "within": float((squared[np.isfinite(squared)] < WITHIN_6).mean()),
        "lost": sum(bool((run.errors > LOST).any()) for run in runs),
        "runs": len(runs),
    }


def _runs(scene: BopScene, parts: Path, methods: Mapping[str, Method]) -> Iterator[Stand]:
    model, frames = prepared_part_of(scene, parts), true_frames(scene)
    counting = [number for number, one in enumerate(frames) if one.counts]
    middle = counting[len(counting) // 2]
    metric = PartMetric(model.part)
    for name, method in methods.items():
        for light, gain in LIGHTS.items():
            for start in STARTS_TOLD:
                rng = np.random.default_rng([0, scene.scene_id, scene.object_ids[0]])
                tracker = Tracker(model, method)
                yield _run(frames, middle, gain, tracker, metric, (f"{name}, {light}", start), rng)


def _run(
    frames: Sequence[TrueFrame], middle: int, gain: float, tracker: Tracker, metric: PartMetric,
    names: tuple[str, str], rng: np.random.Generator,
) -> Stand:  # fmt: skip
    part, (told, start) = tracker.part, names
    has_symmetries = len(part.symmetries.discrete) or len(part.symmetries.continuous)
    tracker.start(frames[0].frame, disturb_pose(frames[0].truth, part.box_centre, *STARTS[start], rng))
    plan = [(number, "before") for number in range(1, middle + 1)]
    plan += [(middle, "stands")] * STANDS + [(number, "afterwards") for number in range(middle + 1, len(frames))]
    errors, squared = {when: list[float]() for _, when in plan}, list[float]()
    for number, when in plan:
        one, faded = frames[number], min(len(errors["stands"]) / STANDS, 1.0)
        result = tracker.track(noisy(in_light(one.frame, 1.0 + (gain - 1.0) * faded), NOISE, rng))
        if not one.counts:
            continue
        errors[when].append(metric.share(result.cam_T_obj, one.truth))
        if when == "stands":
            squared.append(np.nan)
            if result.covariance is not None and not has_symmetries:
                step = pose_step_between(one.truth, result.cam_T_obj, part.box_centre)
                squared[-1] = float(step @ np.linalg.solve(result.covariance, step))
    stands, afterwards = np.array(errors["stands"]), np.array(errors["afterwards"])
    return Stand(told, start, np.concatenate(list(errors.values())), np.zeros(0), stands, afterwards, np.array(squared))


if __name__ == "__main__":
    main()
