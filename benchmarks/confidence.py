"""Quality and exactness as probabilities: how often a pose is right, and how weights for that are fitted.

    python -m benchmarks.confidence metal_dev --parts out/parts --split checking --picture docs/images/reliability.png
    python -m benchmarks.confidence metal_dev --parts out/parts --split tuning --fit

Each sequence is tracked forwards and backwards from truth, every second frame, from starts 2 and 5 degrees and mm off,
and once for each fault of `faulty_frames`, which is there in four frames of twelve. Beside every fourth frame three
poses 3 to 20% of the diameter away are judged as they are. Right: ADD (ADD-S for symmetric parts) below 5% of the
diameter. Reported: the expected calibration error in ten bins, and the area under the ROC curve against ADD above 10%,
and above 5%; of each fault together with all poses that have none. PARTS holds prepared parts, or one folder of them
per data set; --fit prints the weights of `acp_lab.tracking.confidence` by maximum likelihood, parts weighed alike.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from acp_lab.commands.machine import limit_threads

limit_threads(1)  # before NumPy is imported

import numpy as np  # noqa: E402

from acp_lab.cad.part import box_corners  # noqa: E402
from acp_lab.errors import TrackingError  # noqa: E402
from acp_lab.evaluation.part_metric import PartMetric  # noqa: E402
from acp_lab.geometry.arrays import BoolArray, FloatArray  # noqa: E402
from acp_lab.geometry.pose import disturb_pose  # noqa: E402
from acp_lab.sequences.bop import BopDataset, BopScene  # noqa: E402
from acp_lab.sequences.frame import Frame  # noqa: E402
from acp_lab.tracking.confidence import RIGHT_SHARE, Confidence  # noqa: E402
from acp_lab.tracking.frame_view import crop_box  # noqa: E402
from acp_lab.tracking.learning.knowledge import Off  # noqa: E402
from acp_lab.tracking.method import Method, method_named  # noqa: E402
from acp_lab.tracking.schedule import Level  # noqa: E402
from acp_lab.tracking.solution import Solution  # noqa: E402
from acp_lab.tracking.states import StateConfig  # noqa: E402
from acp_lab.tracking.stopwatch import Stopwatch  # noqa: E402
from acp_lab.tracking.targets.normals import NormalJudgement  # noqa: E402
from benchmarks import measured  # noqa: E402
from benchmarks.faulty_frames import FAULTS  # noqa: E402
from benchmarks.robustness import SPLITS, is_in_split  # noqa: E402
from benchmarks.runs import part_name, prepared_part_of, readable_frames, visible_frames  # noqa: E402
from benchmarks.uncertainty import Watched  # noqa: E402

WRONG = 0.1
RUNS = (
    ("forwards", 0.0, ""),
    ("backwards", 0.0, ""),
    ("second", 0.0, ""),
    ("forwards", 2.0, ""),
    ("forwards", 5.0, ""),
    *(("forwards", 0.0, fault) for fault in FAULTS),
)
"""Order of the frames, degrees and mm that the start is off, and what goes wrong."""
ORDERS = {"backwards": slice(None, None, -1), "second": slice(None, None, 2)}
BINS = 10
# A state that never changes: a tracker that is lost behaves otherwise.
NEVER_LOST = StateConfig(weak_below=0.0, tracking_above=0.0, lost_below=0.0, found_above=0.0)
UNIT = {
    "frames": "judged poses",
    "wrong": "those with an ADD above 10%",
    "auc": "area under the ROC curve against ADD above 10%",
    "auc 5": "area under the ROC curve against ADD above 5%",
    "ece": "expected calibration error, right: ADD below 5%",
}


@dataclass(frozen=True)
class Judged:
    """A pose that was judged.

    part: see `runs.part_name`; kind: "tracked", "disturbed" or one of FAULTS; error: ADD as a share of the diameter;
    expected: the same by the covariance, 0 without one.
    """

    part: str
    kind: str
    error: float
    expected: float
    agreement: float
    contrast: float
    margin: float


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("datasets", nargs="+", type=Path)
    parser.add_argument("--parts", type=Path, required=True)
    parser.add_argument("--method", default="acp")
    parser.add_argument("--split", choices=SPLITS, default="all")
    parser.add_argument("--fit", action="store_true")
    parser.add_argument("--picture", type=Path)
    parser.add_argument("--record", metavar="KEY")
    args = parser.parse_args()
    method = method_named(args.method)
    judged: list[Judged] = []
    for root in args.datasets:
        for scene_id in BopDataset(root).scenes():
            scene = BopDataset(root).open_scene(scene_id)
            name = part_name(root, scene.object_ids[0])
            if is_in_split(name, args.split):
                judged += _judged(name, scene, args.parts, method)
                print(root.name, scene_id, len(judged), flush=True)
    if args.fit:
        print("all anew:", fitted(judged))
        if not isinstance(method.confidence, Off):
            print("the spread alone:", fitted(judged, method.confidence))
    if isinstance(method.confidence, Off):
        return
    tracked = [one for one in judged if one.kind == "tracked"]
    clean = [one for one in judged if one.kind not in FAULTS]
    values = {
        "clean": _row(tracked, method.confidence),
        "clean, by the quality alone": _row(tracked, replace(method.confidence, spread=0.0)),
        "clean and disturbed": _row(clean, method.confidence),
        "all, with faults": _row(judged, method.confidence),
    }
    for fault in FAULTS:
        values[fault] = _row([one for one in judged if one.kind not in FAULTS or one.kind == fault], method.confidence)
    for name, row in values.items():
        print(name, row)
    if args.picture:
        _draw(judged, method.confidence, args.picture)
    if args.record:
        about = f"the quality of {args.method} as a probability, parts for {args.split}"
        names = ", ".join(root.name for root in args.datasets)
        measured.record(f"confidence.{args.record}", about, UNIT, names, values)


def _judged(name: str, scene: BopScene, parts: Path, method: Method) -> Iterator[Judged]:
    object_id = scene.object_ids[0]
    model = prepared_part_of(scene, parts)
    metric, rng = PartMetric(model.part, 500), np.random.default_rng(scene.scene_id)
    frames = readable_frames(scene)
    known = [frame for frame in frames if scene.truth(frame.index, object_id) is not None]
    visible = visible_frames(scene.folder, object_id, [frame.index for frame in known])
    for order, off, fault in RUNS:
        run = known[ORDERS.get(order, slice(None))]
        tracker = _Judging(model, replace(method, states=NEVER_LOST, way_back=Off()))
        truths = [_truth(scene, frame, object_id) for frame in run]
        try:
            tracker.start(run[0], disturb_pose(truths[0], model.part.box_centre, off, off, rng))
        except TrackingError:
            continue
        for number, (frame, truth) in enumerate(zip(run, truths, strict=True)):
            faulty = bool(fault) and number % 12 in (5, 6, 7, 8)
            if number:
                tracker.forget()
                box = crop_box(box_corners(model.part), truth, frame.camera, 15.0)
                tracker.track(FAULTS[fault](frame, box, rng) if faulty else frame)
            if tracker.solution is None or not (faulty or visible[frame.index]):
                continue
            error = metric.share(tracker.solution.cam_T_obj, truth)
            if faulty or not fault:
                yield _seen(name, fault or "tracked", error, tracker, tracker.solution)
            if number % 4 == 0 and off == 0.0 and not fault and order != "second" and error < 0.03:
                yield from _disturbed(name, tracker, frame, truth, metric, rng)


class _Judging(Watched):
    """Says of solutions how exact they are."""

    def expected_error(self, solution: Solution) -> float:
        """The ADD to be expected by its covariance, as a share of the diameter; 0 without one."""
        covariance = self._assessment.covariance(solution)
        return 0.0 if covariance is None else self._assessment.expected_error(solution.cam_T_obj, covariance)


def _truth(scene: BopScene, frame: Frame, object_id: int) -> FloatArray:
    truth = scene.truth(frame.index, object_id)
    assert truth is not None
    return truth


def _disturbed(
    name: str, tracker: _Judging, frame: Frame, truth: FloatArray, metric: PartMetric, rng: np.random.Generator
) -> Iterator[Judged]:
    part, found = tracker.part, 0
    for _ in range(60):
        degrees, mm = rng.uniform(0.0, 25.0), rng.uniform(0.0, 0.3 * part.diameter)
        pose = disturb_pose(truth, part.box_centre, degrees, mm, rng)
        error = metric.share(pose, truth)
        seen = tracker.look(frame, pose) if 0.03 < error < 0.2 else None
        if seen is None:
            continue
        solution = tracker.solver.look_at(seen, seen.view.at_pose(pose), Level(5, 1.0, 600), Stopwatch())
        if solution is not None:
            yield _seen(name, "disturbed", error, tracker, tracker.solver.weigh(seen, solution))
            found += 1
        if found == 3:
            return


def _seen(name: str, kind: str, error: float, tracker: _Judging, solution: Solution) -> Judged:
    first, *others = solution.judgements
    assert isinstance(first, NormalJudgement)
    margin, expected = sum(judgement.score for judgement in others), tracker.expected_error(solution)
    return Judged(name, kind, error, expected, first.quality, first.contrast, margin)


def qualities(judged: list[Judged], confidence: Confidence) -> FloatArray:
    """(n,) quality times exactness, as the tracker reports them."""
    exactness = np.array([confidence.exactness(one.expected) for one in judged])
    return _there(_features(judged), np.array(_weights(confidence))) * exactness


def fitted(judged: list[Judged], now: Confidence | None = None) -> Confidence:
    """What makes what is right, and what is not, most likely; features that never vary get no weight.

    now: to keep its log-odds of the part being there, by which the tracker goes on, and fit the spread alone.
    """
    from scipy.optimize import minimize
    from scipy.special import erf

    features, right = _features(judged), np.array([one.error < RIGHT_SHARE for one in judged])
    names = np.array([one.part for one in judged])
    weights = np.array([1.0 / (names == name).sum() for name in names])
    expected = np.array([one.expected for one in judged])
    numbers = np.zeros(5) if now is None else np.array([*_weights(now), 0.0])
    varies = np.r_[True, features[:, 1:].std(0) > 1e-9, expected.any()]
    if now is not None:
        varies[:4] = False
    if not varies.any():
        return now or Confidence()

    def unlikely(free: FloatArray) -> float:
        numbers[varies] = free
        exactness = erf(RIGHT_SHARE / np.maximum(np.sqrt(2.0) * np.exp(numbers[4]) * expected, 1e-9))
        likely = np.clip(_there(features, numbers[:4]) * exactness, 1e-9, 1.0 - 1e-9)
        # Slightly regularised.
        return float(-(weights @ np.log(np.where(right, likely, 1.0 - likely))) + 1e-4 * np.sum(numbers[1:4] ** 2))

    numbers[varies] = minimize(unlikely, np.array([-3.0, 5.0, 13.0, 2.5, -0.3])[varies], method="BFGS").x
    spread = float(np.exp(numbers[4])) if varies[4] else 0.0
    constant, agreement, contrast, margin = (round(float(value), 2) for value in numbers[:4])
    return Confidence(constant, agreement, contrast, margin, round(spread, 2))


def _weights(confidence: Confidence) -> tuple[float, float, float, float]:
    return confidence.constant, confidence.agreement, confidence.contrast, confidence.margin


def _there(features: FloatArray, weights: FloatArray) -> FloatArray:
    return np.asarray(1.0 / (1.0 + np.exp(-np.clip(features @ weights, -50.0, 50.0))))


def calibration_error(quality: FloatArray, right: BoolArray) -> float:
    """Mean over all frames of | mean quality - share that is right | of a frame's bin (Guo et al. 2017, eq. 3)."""
    bins = np.minimum((quality * BINS).astype(int), BINS - 1)
    gaps = [abs(quality[bins == k].sum() - right[bins == k].sum()) for k in range(BINS)]
    return float(sum(gaps) / len(quality))


def area_under_curve(quality: FloatArray, positive: BoolArray) -> float:
    """Probability that a positive has a higher quality than a negative; NaN where one of them is missing."""
    from scipy.stats import rankdata

    many, few = int(positive.sum()), int((~positive).sum())
    if not many or not few:
        return float("nan")
    return float((rankdata(quality)[positive].sum() - many * (many + 1) / 2) / (many * few))


def _features(judged: list[Judged]) -> FloatArray:
    return np.array([[1.0, one.agreement, one.contrast, one.margin] for one in judged])


def _row(judged: list[Judged], confidence: Confidence) -> dict[str, float]:
    quality, error = qualities(judged, confidence), np.array([one.error for one in judged])
    wrong = int((error > WRONG).sum())
    # Where none is wrong, or all are, there is no curve.
    area = {"auc": area_under_curve(quality, error <= WRONG)} if 0 < wrong < len(error) else {}
    if 0 < (error < RIGHT_SHARE).sum() < len(error):
        area["auc 5"] = area_under_curve(quality, error < RIGHT_SHARE)
    return {"frames": len(judged), "wrong": wrong, **area, "ece": calibration_error(quality, error < RIGHT_SHARE)}


def _draw(judged: list[Judged], confidence: Confidence, path: Path) -> None:
    """The reliability diagram: what is said against the share that is right, and how often each value occurs."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    quality, right = qualities(judged, confidence), np.array([one.error < RIGHT_SHARE for one in judged])
    bins = np.minimum((quality * BINS).astype(int), BINS - 1)
    used = [k for k in range(BINS) if (bins == k).any()]
    figure, (upper, lower) = plt.subplots(2, 1, figsize=(4.5, 5.5), height_ratios=(3, 1), sharex=True)
    upper.plot([0, 1], [0, 1], color="0.6", linestyle="--", linewidth=1, label="a perfect probability")
    share = [right[bins == k].mean() for k in used]
    upper.plot([quality[bins == k].mean() for k in used], share, "o-", color="#1f6fb4", label="measured")
    upper.set_ylabel("share with ADD below 5%")
    upper.legend(frameon=False, loc="upper left")
    lower.hist(quality, bins=BINS, range=(0, 1), color="#1f6fb4", rwidth=0.9)
    lower.set_yscale("log")
    lower.set_xlabel("quality x exactness")
    lower.set_ylabel("frames")
    figure.tight_layout()
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main()
