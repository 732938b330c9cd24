"""The covariance of the poses that the tracker reports: how often the truth is within its 95% region.

    python -m benchmarks.uncertainty metal_dev metal_hard --parts out/parts --split checking --record checking
    python -m benchmarks.uncertainty metal_dev metal_hard --parts out/parts --split tuning --fit

Each sequence is tracked forwards, backwards and with every second frame, from truth and from 5 degrees and 5 mm off;
poses with a quality above 0.5 and an ADD below 15% of the diameter count, since the covariance speaks of parts that are
there. Of each part one row, and one mean over parts. --fit prints the terms of
`acp_lab.tracking.uncertainty` by maximum likelihood, parts weighed alike, times the factor that makes the 95% regions
hold 95% of the poses. The likelihood is that of Student's distribution: a few errors lie far out, and are not to widen
all others. Parts with symmetries are left out.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from acp_lab.commands.machine import limit_threads

limit_threads(1)  # before NumPy is imported

import numpy as np  # noqa: E402

from acp_lab.errors import TrackingError  # noqa: E402
from acp_lab.evaluation.part_metric import PartMetric  # noqa: E402
from acp_lab.geometry.arrays import FloatArray  # noqa: E402
from acp_lab.geometry.pose import disturb_pose, transform  # noqa: E402
from acp_lab.geometry.pose_step import pose_step_between  # noqa: E402
from acp_lab.prepared_part import PreparedPart  # noqa: E402
from acp_lab.sequences.bop import BopDataset, BopScene  # noqa: E402
from acp_lab.tracking.assessment import Assessment  # noqa: E402
from acp_lab.tracking.method import ACP, Method  # noqa: E402
from acp_lab.tracking.solution import Solution  # noqa: E402
from acp_lab.tracking.tracker import Tracker  # noqa: E402
from acp_lab.tracking.uncertainty import PoseUncertainty  # noqa: E402
from benchmarks import measured  # noqa: E402
from benchmarks.robustness import SPLITS, is_in_split  # noqa: E402
from benchmarks.runs import part_name, prepared_part_of, readable_frames, visible_frames  # noqa: E402

RUNS = ((0.0, 1), (5.0, 1), (0.0, -1), (5.0, -1), (0.0, 2), (5.0, 2))
"""Degrees and mm that the start is off, and the step from frame to frame; below 0 from the last to the first."""
WITHIN_6, WITHIN_3 = 12.592, 7.815
"""95% of chi-squared with six and with three degrees of freedom."""
MEDIAN_6 = 5.348
FREEDOM = 4.0
"""Degrees of freedom of Student's distribution."""
UNIT = {
    "poses": "poses",
    "within": "share of poses whose truth is within the 95% region",
    "shift within": "the same for the part's centre",
    "median": "median of the squared normalised error over that of chi-squared; 1 where the covariance is right",
}


@dataclass(frozen=True, eq=False)
class Pose:
    """A tracked pose: error, a step (6,) from truth; information (8, 8) and mm_per_px, what its covariance is of."""

    part: str
    error: FloatArray
    information: FloatArray
    mm_per_px: float

    def squared_error(self, config: PoseUncertainty, only_shift: bool = False) -> tuple[float, float]:
        """Normalised, and the logarithm of the covariance's determinant."""
        covariance = config.covariance(self.information, self.mm_per_px)
        rows = slice(3, 6) if only_shift else slice(0, 6)
        block, error = covariance[rows, rows], self.error[rows]
        return float(error @ np.linalg.solve(block, error)), float(np.linalg.slogdet(block)[1])


class _Keeping(Assessment):
    """Keeps the solution whose covariance was asked for last: that which is reported."""

    solution: Solution | None = None

    def covariance(self, solution: Solution) -> FloatArray | None:
        """As ever."""
        self.solution = solution
        return super().covariance(solution)


class Watched(Tracker):
    """Keeps the solution of the last frame as it is reported; where the part is not seen, that of the frame before."""

    def __init__(self, model: PreparedPart, method: Method) -> None:
        super().__init__(model, method)
        self._assessment = self._keeping = _Keeping(model.part, method)

    @property
    def solution(self) -> Solution | None:
        """None where none was reported since the beginning, or since `forget`."""
        return self._keeping.solution

    def forget(self) -> None:
        """From here on there is no solution until the next one."""
        self._keeping.solution = None


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("datasets", nargs="+", type=Path)
    parser.add_argument("--parts", type=Path, required=True)
    parser.add_argument("--split", choices=SPLITS, default="all")
    parser.add_argument("--fit", action="store_true")
    parser.add_argument("--record", metavar="KEY")
    args = parser.parse_args()
    poses: list[Pose] = []
    for root in args.datasets:
        for scene_id in BopDataset(root).scenes():
            scene = BopDataset(root).open_scene(scene_id)
            name = part_name(root, scene.object_ids[0])
            if is_in_split(name, args.split):
                poses += _tracked(scene, args.parts, name)
                print(root.name, scene_id, len(poses), flush=True)
    if args.fit:
        print(fitted(poses))
    config = PoseUncertainty()
    rows = {part: _row([p for p in poses if p.part == part], config) for part in sorted({p.part for p in poses})}
    rows["mean"] = {field: float(np.mean([row[field] for row in rows.values()])) for field in UNIT}
    for part, row in rows.items():
        print(part, {field: round(value, 2) for field, value in row.items()})
    if args.record:
        about = f"the covariance of the poses of acp, parts for {args.split}"
        names = ", ".join(root.name for root in args.datasets)
        measured.record(f"uncertainty.{args.record}", about, UNIT, names, rows)


def _tracked(scene: BopScene, parts: Path, name: str) -> Iterator[Pose]:
    object_id, model = scene.object_ids[0], prepared_part_of(scene, parts)
    part, metric, rng = model.part, PartMetric(model.part, 500), np.random.default_rng(scene.scene_id)
    if len(part.symmetries.discrete) or len(part.symmetries.continuous):
        return
    found = [(frame, scene.truth(frame.index, object_id)) for frame in readable_frames(scene)]
    known = [(frame, truth) for frame, truth in found if truth is not None]
    visible = visible_frames(scene.folder, object_id, [frame.index for frame, _ in known])
    for off, step in RUNS:
        tracker, ((first, start), *rest) = Watched(model, ACP), known[::step]
        try:
            tracker.start(first, disturb_pose(start, part.box_centre, off, off, rng))
        except TrackingError:
            continue
        for frame, truth in rest:
            tracker.forget()
            result = tracker.track(frame)
            solution = tracker.solution
            if solution is None or solution.information is None or not visible[frame.index]:
                continue
            if result.quality > 0.5 and metric.share(result.cam_T_obj, truth) < 0.15:
                error = pose_step_between(truth, result.cam_T_obj, part.box_centre)
                depth = float(transform(result.cam_T_obj, part.box_centre)[2])
                yield Pose(name, error, solution.information, depth / frame.camera.fx)


def fitted(poses: list[Pose]) -> PoseUncertainty:
    """The terms that make the errors most likely, widened until 95% are within the 95% regions; parts alike."""
    from scipy.optimize import brentq, minimize

    names = np.array([pose.part for pose in poses])
    weights = np.array([1.0 / (names == name).sum() for name in names])

    def config_of(logs: FloatArray) -> PoseUncertainty:
        return PoseUncertainty(*np.exp(np.clip(logs, -20.0, 20.0)))

    def unlikely(logs: FloatArray) -> float:
        squared, sizes = np.transpose([pose.squared_error(config_of(logs)) for pose in poses])
        return float(weights @ (sizes + (FREEDOM + 6.0) * np.log1p(squared / FREEDOM)))

    now = PoseUncertainty()
    start = np.log([now.image, now.outline_mm, now.crease_mm, now.shift_px])
    best = config_of(minimize(unlikely, start, method="Nelder-Mead", options={"maxiter": 300}).x)
    squared = np.array([pose.squared_error(best)[0] for pose in poses])
    factor = brentq(lambda f: weights @ (squared / f < WITHIN_6) - 0.95 * weights.sum(), 0.01, 100.0)
    wider = np.sqrt(factor)
    return replace(
        best,
        image=factor * best.image,
        outline_mm=wider * best.outline_mm,
        crease_mm=wider * best.crease_mm,
        shift_px=wider * best.shift_px,
    )


def _row(poses: list[Pose], config: PoseUncertainty) -> dict[str, float]:
    squared = np.array([pose.squared_error(config)[0] for pose in poses])
    shifts = np.array([pose.squared_error(config, only_shift=True)[0] for pose in poses])
    return {
        "poses": len(poses),
        "within": float((squared < WITHIN_6).mean()),
        "shift within": float((shifts < WITHIN_3).mean()),
        "median": float(np.median(squared) / MEDIAN_6),
    }


if __name__ == "__main__":
    main()
