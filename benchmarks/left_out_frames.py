"""Frames that are left out at random: is the part followed over the gaps, and what is it worth to be told of them?

    python -m benchmarks.left_out_frames metal_hard metal_dev own_checking --parts PARTS --split checking --record KEY

Each sequence is tracked forwards, from truth and from 5 degrees and 5 mm off, with defaults: as it is; with 30% of its
frames left out; with one of three; and with gaps of 2 to 5 frames, 8 to 15 frames apart. The frames' ids tell how many
are missing, as their times would; "untold" are frames that are numbered anew. Of the frames that are left those count
in which at least 30% of the part is visible. PARTS holds prepared parts, or one folder of them per data set.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from acp_lab.commands.machine import limit_threads

limit_threads(1)  # before NumPy is imported

import numpy as np  # noqa: E402

from acp_lab.evaluation.part_metric import PartMetric  # noqa: E402
from acp_lab.sequences.bop import BopScene  # noqa: E402
from acp_lab.tracking.method import Method  # noqa: E402
from acp_lab.tracking.tracker import Tracker  # noqa: E402
from benchmarks.runs import prepared_part_of  # noqa: E402
from benchmarks.told_wrong import (  # noqa: E402
    STARTS_TOLD,
    Told,
    ToldRun,
    TrueFrame,
    as_taken,
    follow,
    main_of_recalls,
    true_frames,
)

LEFT_OUT = ("none", "30%", "one of three", "gaps")
SHARE = 0.3
"""Of frames that "30%" leaves out."""
GAP, APART = (2, 5), (8, 15)
"""Frames that a gap leaves out, and that come between two gaps; the least and the most."""


def main() -> None:
    """See the module."""
    main_of_recalls(__doc__, "left_out_frames", "frames left out", _runs)


def kept(name: str, count: int, rng: np.random.Generator) -> list[int]:
    """Which of `count` frames are left; the first two always are, so that a usual step is known."""
    is_kept = np.ones(count, bool)
    if name == "30%":
        is_kept = rng.random(count) >= SHARE
    elif name == "one of three":
        is_kept[2::3] = False
    elif name == "gaps":
        begin = int(rng.integers(APART[0], APART[1], endpoint=True))
        while begin < count:
            end = begin + int(rng.integers(GAP[0], GAP[1], endpoint=True))
            is_kept[begin:end] = False
            begin = end + int(rng.integers(APART[0], APART[1], endpoint=True))
    is_kept[:2] = True
    return [int(number) for number in np.flatnonzero(is_kept)]


def _runs(scene: BopScene, parts: Path, method: Method) -> Iterator[ToldRun]:
    model, frames = prepared_part_of(scene, parts), true_frames(scene)
    metric, seed = PartMetric(model.part), [0, scene.scene_id, scene.object_ids[0]]
    for name in LEFT_OUT:
        left = [frames[number] for number in kept(name, len(frames), np.random.default_rng(seed))]
        for suffix, told in (("", as_taken(left)), (", untold", _numbered_anew(left))):
            if name == "none" and suffix:
                continue  # nothing to tell
            for start in STARTS_TOLD:
                errors = follow(told, Tracker(model, method), metric, start, seed)
                yield ToldRun(name + suffix, start, errors, np.zeros(0))


def _numbered_anew(frames: Sequence[TrueFrame]) -> list[Told]:
    return [
        replace(one, frame=replace(one.frame, index=number, time_s=None)) for number, one in enumerate(as_taken(frames))
    ]


if __name__ == "__main__":
    main()
