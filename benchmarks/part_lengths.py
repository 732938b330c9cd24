"""How long a part is, in mm: is a screw or a casting followed as well as what lies in the hand?

    python -m benchmarks.part_lengths metal_hard metal_dev own_checking --split checking --record checking

Each part is made so many times as long, and stands so many times as far away: the images are the same, and so is all
that can be seen in them. Forwards, from truth and from 5 degrees and 5 mm off (as many times 5 mm), with defaults.
"in mm" is a tracker whose settings in mm are the same for all parts; only what the network of edge profiles is told is
in proportion. A frame counts when at least 30% of the part is visible. Parts are prepared on the way, without
visibility networks.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from acp_lab.commands.machine import limit_threads

limit_threads(1)  # before NumPy is imported

import numpy as np  # noqa: E402

from acp_lab.cad.models_info import Symmetries  # noqa: E402
from acp_lab.cad.part import Part  # noqa: E402
from acp_lab.evaluation.part_metric import PartMetric  # noqa: E402
from acp_lab.geometry.arrays import FloatArray  # noqa: E402
from acp_lab.preparation import prepare  # noqa: E402
from acp_lab.prepared_part import DEFAULT_EDGE_BREAK_MM, PrepareOptions  # noqa: E402
from acp_lab.sequences.bop import BopScene  # noqa: E402
from acp_lab.tracking.method import ACP  # noqa: E402
from acp_lab.tracking.part_size import for_size  # noqa: E402
from acp_lab.tracking.tracker import Tracker  # noqa: E402
from benchmarks.robustness import SPLITS  # noqa: E402
from benchmarks.told_wrong import (  # noqa: E402
    RECALLS,
    STARTS_TOLD,
    Told,
    ToldRun,
    TrueFrame,
    follow,
    recalls,
    record,
    rows_of,
    true_frames,
)

TIMES = 0.15, 1.0, 8.0


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("datasets", nargs="+", type=Path)
    parser.add_argument("--split", choices=SPLITS, default="all")
    parser.add_argument("--record", metavar="KEY")
    args = parser.parse_args()
    args.method = ACP.name
    rows = rows_of(args, _runs, lambda runs: recalls(run.errors for run in runs))
    record(args, "part_lengths", "parts as long as screws and as castings, prepared with templates", RECALLS, rows)


def made(part: Part, times: float) -> Part:
    """A part that is so many times as long."""
    discrete = part.symmetries.discrete.copy()
    discrete[:, :3, 3] *= times
    continuous = tuple((axis, (times * x, times * y, times * z)) for axis, (x, y, z) in part.symmetries.continuous)
    return Part.from_mesh(times * part.vertices, part.faces, part.name, Symmetries(discrete, continuous))


def _runs(scene: BopScene) -> Iterator[ToldRun]:
    part, frames = scene.dataset.part(scene.object_ids[0]), true_frames(scene)
    seed = [0, scene.scene_id, scene.object_ids[0]]
    for times in TIMES:
        model = prepare(made(part, times), PrepareOptions("templates"))
        told, size = [_told(one, times) for one in frames], model.part.times_usual
        in_mm = Tracker(replace(model, edge_break_mm=DEFAULT_EDGE_BREAK_MM), for_size(ACP, 1.0 / size))
        for suffix, tracker in (("", Tracker(model)), (", in mm", in_mm)):
            if suffix and size == 1.0:
                continue
            for start in STARTS_TOLD:
                errors = follow(told, tracker, PartMetric(model.part), start, seed, times)
                yield ToldRun(f"{times:g} times{suffix}", start, errors, np.zeros(0))


def _told(one: TrueFrame, times: float) -> Told:
    best: FloatArray = one.truth.copy()
    best[:3, 3] *= times
    return Told(one.frame, best, one.counts)


if __name__ == "__main__":
    main()
