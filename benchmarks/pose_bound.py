"""The least error that each frame's edges allow, beside what the tracker reached: which misses are the tracker's?

    python -m benchmarks.pose_bound metal_public metal_hard metal_dev --parts out/parts --record --figure bound.png

Three bounds of `acp_lab.studies.pose_bound` per frame, by what is known of the offsets that outlines, inner edges and
stretches of edges share: "samples", known exactly; "known", measured in a first frame whose pose is exact, so that only
the drift since then is open; "open", known as well as it is for parts of the data sets at hand, by their spread. Drift
and spread are measured at the true poses: of classes over all sequences, of stretches in each frame.

Tracked forwards from truth, which is compared with "known", and from 5 degrees and 5 mm off, three directions, which
are compared with "open". Beside the bounds stands what each frame alone shows: the pose fitted, with the same
knowledge, to the image edges that were found at the true pose. A frame that is missed from truth counts as "physics"
where "known" gives less than an even chance of 2%, and else as "shown beside" where the pose that it shows is beyond
2%, too: then its edges err together in ways that the bound does not know of. Frames that show less than 30% of the
part, the first frame, frames without a bound, and parts with symmetries are left out.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

from acp_lab.commands.machine import limit_threads

limit_threads(1)  # before NumPy is imported

import numpy as np  # noqa: E402
from PIL import Image  # noqa: E402

from acp_lab.display.plots.pose_bound import BoundCurves, bound_figure  # noqa: E402
from acp_lab.errors import ParameterError  # noqa: E402
from acp_lab.evaluation.part_metric import PartMetric  # noqa: E402
from acp_lab.geometry.arrays import FloatArray  # noqa: E402
from acp_lab.geometry.pose import disturb_pose  # noqa: E402
from acp_lab.geometry.pose_step import move_pose  # noqa: E402
from acp_lab.prepared_part import PreparedPart  # noqa: E402
from acp_lab.sequences.bop import BopDataset, BopScene  # noqa: E402
from acp_lab.sequences.frame import Frame  # noqa: E402
from acp_lab.studies.pose_bound import (  # noqa: E402
    WITHOUT_PROFILES,
    AllowedError,
    EdgeEvidence,
    allowed_error,
    edge_evidence,
    least_covariance,
    robust_deviation,
    shown_step,
)
from acp_lab.tracking.frame_solver import FrameSolver  # noqa: E402
from acp_lab.tracking.method import ACP  # noqa: E402
from acp_lab.tracking.tracker import Tracker  # noqa: E402
from benchmarks import measured  # noqa: E402
from benchmarks.runs import prepared_part_of, readable_frames, visible_frames  # noqa: E402

LIMIT = 0.02
OFF, SEEDS = 5.0, 3
UNIT = {
    "frames": "frames",
    "@2 *": "share of frames with ADD below 2% of the diameter; of the bounds, the mean of its probability",
    "ADD *": "ADD in % of the diameter, median over frames; of the bounds, of its mean in each frame",
    "missed": "frames missed at 2% from truth",
    "physics": "of these, those for which the bound gives less than an even chance",
    "shown beside": "of the other missed ones, those whose edges show a pose beyond 2%",
    "*_mm": "mm",
}


@dataclass(frozen=True, eq=False)
class Sequence:
    """A sequence whose frames were looked at at their true poses; errors: by start, (n,) or (seeds, n) shares."""

    name: str
    model: PreparedPart
    frame_ids: list[int]
    truths: list[FloatArray]
    evidence: list[EdgeEvidence]
    first: EdgeEvidence
    errors: dict[str, FloatArray]

    @property
    def shared_mm(self) -> FloatArray:
        """(n, 2) in every frame."""
        return np.array([evidence.shared_mm for evidence in self.evidence])


def looked_at(scene: BopScene, parts: Path) -> Sequence | None:
    """A scene, tracked and looked at; None for a part with symmetries."""
    object_id, model = scene.object_ids[0], prepared_part_of(scene, parts)
    if model.part.symmetries:
        return None
    solver = FrameSolver(model, WITHOUT_PROFILES)
    found = [(frame, scene.truth(frame.index, object_id)) for frame in readable_frames(scene)]
    known = [(frame, truth) for frame, truth in found if truth is not None]
    visible = visible_frames(scene.folder, object_id, [frame.index for frame, _ in known])
    seen = [edge_evidence(solver, frame, truth) for frame, truth in known]
    kept = [i for i in range(1, len(known)) if seen[i] is not None and visible[known[i][0].index]]
    if seen[0] is None:
        return None
    errors = {
        "truth": np.array(_errors(model, known, 0.0, 0))[kept],
        "off": np.array([_errors(model, known, OFF, seed) for seed in range(SEEDS)])[:, kept],
    }
    return Sequence(
        f"{scene.dataset.name} {scene.scene_id}", model, [known[i][0].index for i in kept], [known[i][1] for i in kept],
        [evidence for i in kept if (evidence := seen[i]) is not None], seen[0], errors,
    )  # fmt: skip


def _errors(model: PreparedPart, known: list[tuple[Frame, FloatArray]], off: float, seed: int) -> list[float]:
    (first, start), *rest = known
    tracker, metric = Tracker(model, ACP), PartMetric(model.part)
    given = disturb_pose(start, model.part.box_centre, off, off, np.random.default_rng(seed)) if off else start
    return [
        metric.share(tracker.start(first, given).cam_T_obj, start),
        *(metric.share(tracker.track(frame).cam_T_obj, truth) for frame, truth in rest),
    ]


@dataclass(frozen=True)
class Shared:
    """What is known of the offsets of classes, (2,) mm each: their means, none for those of the first frame, and their
    standard deviations."""

    mean_mm: FloatArray | None
    deviation_mm: FloatArray


def drift_and_spread(sequences: list[Sequence]) -> tuple[Shared, Shared]:
    """How far what outlines, and inner edges share drifts after the first frame (rms), and how much that of parts
    differs (mean and standard deviation of their medians)."""
    drift = np.concatenate([one.shared_mm - one.first.shared_mm for one in sequences])
    by_part: dict[str, list[FloatArray]] = {}
    for one in sequences:
        by_part.setdefault(f"{one.name.split()[0]} {one.model.part.name}", []).append(one.shared_mm)
    of_parts = np.array([np.nanmedian(np.concatenate(found), axis=0) for found in by_part.values()])
    spread = Shared(np.nanmean(of_parts, axis=0), np.nanstd(of_parts, axis=0, ddof=1))
    return Shared(None, np.sqrt(np.nanmean(drift**2, axis=0))), spread


@dataclass(frozen=True)
class Told:
    """What a frame tells of the pose. allowed: by its bound; shown: ADD of the pose that its edges show, a share."""

    allowed: AllowedError
    shown: float


NOTHING = Told(AllowedError(float("inf"), {LIMIT: 0.0}), float("inf"))


def told(sequence: Sequence, known: Shared | None) -> list[Told]:
    """Of every frame. known: None where the offsets of classes and of stretches are known exactly."""
    metric, centre, found = PartMetric(sequence.model.part), sequence.model.part.box_centre, []
    for evidence, truth in zip(sequence.evidence, sequence.truths, strict=True):
        shared, means, deviation = np.zeros((len(evidence.outline), 0)), np.zeros(0), np.zeros(0)
        if known is not None:
            first = sequence.first if known.mean_mm is None else None
            local = stretches_before(evidence, first)
            shared = np.hstack([evidence.classes, evidence.stretches])
            means = np.concatenate([sequence.first.shared_mm if known.mean_mm is None else known.mean_mm, local[0]])
            deviation = np.concatenate([known.deviation_mm, local[1]])
        rest_px = evidence.residuals_px - shared @ np.nan_to_num(means)
        try:
            covariance = least_covariance(evidence.jacobian, evidence.scatter_px, shared, deviation)
        except ParameterError:
            found.append(NOTHING)
            continue
        step = shown_step(evidence.jacobian, rest_px, evidence.scatter_px, shared, deviation)
        shown = metric.share(move_pose(truth, centre, step), truth)
        found.append(Told(allowed_error(sequence.model.part, truth, covariance, (LIMIT,)), shown))
    return found


def stretches_before(evidence: EdgeEvidence, first: EdgeEvidence | None) -> tuple[FloatArray, FloatArray]:
    """(m,) mm each: where every stretch is expected beside what its class shares, and how surely, by a first frame."""
    now, before = evidence.stretches_mm, {} if first is None else first.stretches_mm
    drift = {}
    for which in (True, False):
        moved = [own - before[i][1] for i, (outline, own) in now.items() if i in before and outline is which]
        drift[which] = robust_deviation(moved)
    spread = dict(zip((True, False), evidence.spread_mm.tolist(), strict=True))
    expected = [before[i][1] if i in before else 0.0 for i in now]
    deviation = [
        min(drift[outline], spread[outline]) if i in before else spread[outline] for i, (outline, _) in now.items()
    ]
    return np.array(expected), np.array(deviation)


def row(errors: dict[str, FloatArray], by_bound: dict[str, list[Told]]) -> dict[str, float]:
    """A row of the table, of one sequence or of several."""
    missed = errors["truth"] >= LIMIT
    fields: dict[str, float] = {"frames": len(missed), "@2 truth": float((~missed).mean()), "missed": int(missed.sum())}
    fields |= {"@2 off": float((errors["off"] < LIMIT).mean())}
    fields |= {f"ADD {start}": 100.0 * float(np.median(found)) for start, found in errors.items()}
    for bound, found in by_bound.items():
        fields[f"@2 {bound}"] = float(np.mean([one.allowed.within[LIMIT] for one in found]))
        fields[f"ADD {bound}"] = 100.0 * float(np.median([one.allowed.mean for one in found]))
        if bound != "samples":
            fields[f"@2 {bound} shown"] = float(np.mean([one.shown < LIMIT for one in found]))
            fields[f"ADD {bound} shown"] = 100.0 * float(np.median([one.shown for one in found]))
    even = np.array([one.allowed.within[LIMIT] < 0.5 for one in by_bound["known"]])
    beside = np.array([one.shown >= LIMIT for one in by_bound["known"]])
    return fields | {"physics": int((missed & even).sum()), "shown beside": int((missed & ~even & beside).sum())}


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("datasets", nargs="+", type=Path)
    parser.add_argument("--parts", type=Path, required=True)
    parser.add_argument("--record", action="store_true")
    parser.add_argument("--figure", type=Path, metavar="FILE.png")
    args = parser.parse_args()
    sequences = []
    for root in args.datasets:
        for scene_id in BopDataset(root).scenes():
            sequence = looked_at(BopDataset(root).open_scene(scene_id), args.parts)
            if sequence is not None:
                sequences.append(sequence)
                print(sequence.name, np.round(np.nanmedian(sequence.shared_mm, axis=0), 3), flush=True)
    drift, spread = drift_and_spread(sequences)
    rows, curves, everything = {}, [], list[dict[str, list[Told]]]()
    for one in sequences:
        found = {"samples": told(one, None), "known": told(one, drift), "open": told(one, spread)}
        rows[one.name] = row(one.errors, found)
        everything.append(found)
        mean = {name: np.array([frame.allowed.mean for frame in frames]) for name, frames in found.items()}
        ids, errors = np.array(one.frame_ids), one.errors
        shown = np.array([frame.shown for frame in found["known"]])
        curves.append(BoundCurves(one.name, ids, errors["truth"], errors["off"], mean["known"], mean["open"], shown))
    rows["all"] = row(
        {start: np.concatenate([one.errors[start] for one in sequences], axis=-1) for start in ("truth", "off")},
        {name: [frame for found in everything for frame in found[name]] for name in ("samples", "known", "open")},
    )
    for name, fields in rows.items():
        print(name, {field: round(value, 2) for field, value in fields.items()})
    shared = {f"{what} {of}_mm": float(value)
              for what, found_mm in (("drift", drift.deviation_mm), ("spread", spread.deviation_mm))
              for of, value in zip(("outline", "inner"), found_mm, strict=True)}  # fmt: skip
    print(shared)
    if args.figure:
        bound_figure(curves, LIMIT).savefig(args.figure)
        with Image.open(args.figure) as picture:
            few = picture.convert("RGB").quantize(64, dither=Image.Dither.NONE)  # a quarter of the bytes
        few.save(args.figure, optimize=True)
        print(args.figure)
    if args.record:
        names = ", ".join(root.name for root in args.datasets)
        about = "the least ADD that the edges of each frame allow, beside that of acp"
        measured.record("pose_bound", about, UNIT, names, rows | {"shared": shared})


if __name__ == "__main__":
    main()
