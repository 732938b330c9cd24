"""Other parts like the tracked one lie around it, as in a tray: is one of those taken for it?

    python -m benchmarks.look_alikes tray_checking --parts PARTS --record checking

Such sequences are made by `python -m data_recipes.metal_sequences --look-alikes COUNT`. Each is followed from truth and
from 5 degrees and 5 mm off. It is begun in every eighth frame, from five start poses that are 5 degrees and mm off and
from five that are 20: the part that is meant is "right" within a tenth of its diameter, and "other" beyond 30% of it.
And the part is hidden for a while, as in `benchmarks.recovery`. "not remembered" is a tracker that does not know what
else stood around, nor that a start means the part that is there. A frame counts when at least 30% of the part is
visible. PARTS holds prepared parts, or one folder of them per data set.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from acp_lab.commands.machine import limit_threads

limit_threads(1)  # before NumPy is imported

import numpy as np  # noqa: E402

from acp_lab.evaluation.part_metric import PartMetric  # noqa: E402
from acp_lab.geometry.arrays import FloatArray  # noqa: E402
from acp_lab.geometry.pose import disturb_pose  # noqa: E402
from acp_lab.sequences.bop import BopDataset, BopScene  # noqa: E402
from acp_lab.tracking.method import ACP, Method  # noqa: E402
from acp_lab.tracking.recovery import WayBack  # noqa: E402
from acp_lab.tracking.start import SecondOpinion, TrustedStart  # noqa: E402
from acp_lab.tracking.tracker import Tracker  # noqa: E402
from benchmarks import measured  # noqa: E402
from benchmarks.recovery import HIDDEN, LOST, RIGHT, Return, returns, row_of  # noqa: E402
from benchmarks.runs import prepared_part_of  # noqa: E402
from benchmarks.told_wrong import RECALLS, STARTS_TOLD, TrueFrame, as_taken, follow, recalls, true_frames  # noqa: E402

OFF = {"5": 5.0, "20": 20.0}
"""How far starts are off: degrees, mm."""
EVERY, SEEDS = 8, 5
UNIT = RECALLS | {
    "right": "share of starts, or of absences after which the part is back in time",
    "other": "share of starts at another place; of absences, most frames in a row with state tracking and such an ADD",
}


@dataclass(frozen=True)
class Asked:
    """What comes of a scene. followed: errors by start; started: of first frames, by how far they are off; hidden."""

    followed: dict[str, FloatArray]
    started: dict[str, FloatArray]
    hidden: tuple[Return, ...]


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("datasets", nargs="+", type=Path)
    parser.add_argument("--parts", type=Path, required=True)
    parser.add_argument("--record", metavar="KEY")
    args = parser.parse_args()
    rows = dict[str, dict[str, float]]()
    for name, method in (("acp", ACP), ("not remembered", not_remembering(ACP))):
        asked = []
        for root in args.datasets:
            for scene_id in BopDataset(root).scenes():
                asked.append(_asked(BopDataset(root).open_scene(scene_id), args.parts, method))
                print(name, root.name, scene_id, _told(asked[-1]), flush=True)
        rows |= {f"{what}, {name}": row for what, row in _rows(asked).items()}
    for what, row in rows.items():
        print(what, row)
    if args.record:
        about = "other parts like the tracked one lie around it"
        measured.record(f"look_alikes.{args.record}", about, UNIT, ", ".join(root.name for root in args.datasets), rows)


def not_remembering(method: Method) -> Method:
    """The same without what tells parts like each other apart."""
    way_back, start = method.way_back, method.start
    assert isinstance(way_back, WayBack)
    assert isinstance(start, TrustedStart)
    assert isinstance(start.second_opinion, SecondOpinion)
    return replace(
        method,
        way_back=replace(way_back, remembered_frames=0),
        start=replace(start, second_opinion=replace(start.second_opinion, apart_below=2.0)),
    )


def _asked(scene: BopScene, parts: Path, method: Method) -> Asked:
    model = prepared_part_of(scene, parts)
    metric, frames, seed = PartMetric(model.part), true_frames(scene), [0, scene.scene_id, scene.object_ids[0]]
    told = as_taken(frames)
    followed = {start: follow(told, Tracker(model, method), metric, start, seed) for start in STARTS_TOLD}
    started = {
        name: np.array(list(_starts(frames, Tracker(model, method), metric, scene.scene_id, off)))
        for name, off in OFF.items()
    }
    return Asked(followed, started, tuple(returns(scene, parts, method, tuple(HIDDEN))))


def _starts(
    frames: Sequence[TrueFrame], tracker: Tracker, metric: PartMetric, scene_id: int, off: float
) -> Iterator[float]:
    for number, one in enumerate(frames[::EVERY]):
        for seed in range(SEEDS if one.counts else 0):
            rng = np.random.default_rng([seed, scene_id, number])
            result = tracker.start(one.frame, disturb_pose(one.truth, tracker.part.box_centre, off, off, rng))
            yield metric.share(result.cam_T_obj, one.truth)


def _told(one: Asked) -> str:
    return "  ".join(
        f"{what} {' '.join(f'{value:.2f}' for value in row.values())}" for what, row in _rows([one]).items()
    )


def _rows(asked: list[Asked]) -> dict[str, dict[str, float]]:
    rows = {f"followed from {start}": recalls(one.followed[start] for one in asked) for start in STARTS_TOLD}
    for name in OFF:
        errors = np.concatenate([one.started[name] for one in asked])
        shares = {"right": float((errors < RIGHT).mean()), "other": float((errors > LOST).mean())}
        rows[f"begun {name} off"] = shares | {"runs": len(errors)}
    absences = [absence for one in asked for absence in one.hidden]
    for kind in (*HIDDEN, "elsewhere"):
        some = [one for one in absences if one.row == kind]
        if some:
            row = row_of(some)
            rows[kind] = {"right": row["back"], "other": row["false"], "runs": row["runs"]}
    return rows


if __name__ == "__main__":
    main()
