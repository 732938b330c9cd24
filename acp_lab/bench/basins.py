"""The basin of convergence of whole trackers: from how far off a start they still come to the part.

A tracker that was started off may need some frames; one that learns from the wrong pose never gets there. So what
counts is the tenth frame after the start: the basin at a disturbance is the share of runs whose ADD(-S) is below 5% of
the diameter there. It is read off the runs of `--noise`; `studies.basin` looks at single frames instead.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from acp_lab.bench.protocol import Variant
from acp_lab.bench.record import Run
from acp_lab.bench.tables import by_sequence, groups
from acp_lab.evaluation.bootstrap import Interval, bootstrap_mean

FRAME = 10
"""After the start; of a shorter sequence the last one."""
LIMIT = 0.05


@dataclass(frozen=True)
class Basin:
    """One method from starts that are off by one amount, on one group of sequences.

    Attributes:
        group: as in `tables.Row`; variant: how, seed left aside. method: its name. runs: how many.
        found: share of them, mean over sequences, with its interval: sequences are drawn, and of each its seeds.
    """

    group: str
    variant: Variant
    method: str
    runs: int
    found: Interval


def has_found(run: Run) -> bool:
    """Whether a run is at the part in the tenth frame after its start."""
    return bool(run.distance[min(FRAME, len(run.distance)) - 1] < LIMIT)


def basins(runs: Sequence[Run]) -> tuple[Basin, ...]:
    """Of every method and amount; () where no start is off. Runs with resets, which are helped, are left out."""
    found = []
    alone = [run for run in runs if not run.variant.resets and len(run.distance)]
    if all(run.variant.start == "truth" for run in alone):
        return ()
    for group, members in groups(alone):
        for method in dict.fromkeys(run.method for run in alone):
            own = [run for run in members if run.method == method]
            for key in sorted({run.variant.group for run in own}):
                found.append(_basin(group, method, [run for run in own if run.variant.group == key]))
    return tuple(found)


def _basin(group: str, method: str, runs: list[Run]) -> Basin:
    shares = [np.array([[has_found(run)] for run in own], float) for own in by_sequence(runs).values()]
    return Basin(group, runs[0].variant, method, len(runs), bootstrap_mean(shares))
