"""Runs as tables: scores per group of sequences and variant, intervals, and paired differences to the first method.

Sequences are drawn with replacement, within each of them its seeds, and blocks of frames within those
(`evaluation.bootstrap`). Methods are paired by sequence, seed and frame: a difference whose 95% interval holds 0 is a
tie.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from acp_lab.bench.protocol import SequenceKey, Variant
from acp_lab.bench.record import Run
from acp_lab.evaluation.bootstrap import Interval, bootstrap_mean
from acp_lab.evaluation.metrics import LOST_SHARE, Scores, pooled_scores
from acp_lab.geometry.arrays import FloatArray

LIMITS = (0.02, 0.05, 0.10)
ALL = "all"


@dataclass(frozen=True)
class Row:
    """One method on one group of sequences, in one variant.

    Attributes:
        group: data set, "DATASET: KIND" of motion, or "all"; variant: how, seed left aside.
        method: its name; sequences, runs: how many.
        pooled: scores over the frames of all runs; recalls: mean over sequences, with intervals, at 2, 5, 10%.
        until_lost: frames before a part was lost, mean over runs; lost: runs in which it ever was; resets: in all.
        ms_median, ms_95: over frames that are not lost, NaN where unknown. memory_mb: the most of any run, each of
            which counts what its process did before, too.
        prepare_s: CPU seconds of preparing a part, mean over the parts where it is known, NaN without.
        size: (w, h) px of the images, (0, 0) where they differ; threads: 0 where unknown.
        against: differences of `recalls` to the first method on the sequences that both have; () for itself, and
            where there is none.
    """

    group: str
    variant: Variant
    method: str
    sequences: int
    runs: int
    pooled: Scores
    recalls: tuple[Interval, ...]
    until_lost: float
    lost: int
    resets: int
    ms_median: float
    ms_95: float
    memory_mb: float
    prepare_s: float
    size: tuple[int, int]
    threads: int
    against: tuple[Interval, ...] = ()

    @property
    def verdicts(self) -> tuple[str, ...]:
        """"better", "worse" or "tie" against the first method, at 2, 5, 10%; () without a comparison."""
        return tuple(verdict(difference) for difference in self.against)


def verdict(difference: Interval) -> str:
    """What a difference says whose interval may hold 0."""
    if difference.low > 0.0:
        return "better"
    return "worse" if difference.high < 0.0 else "tie"


def by_sequence(runs: Iterable[Run]) -> dict[SequenceKey, list[Run]]:
    """The runs of each sequence, by their seeds."""
    found: dict[SequenceKey, list[Run]] = {}
    for run in sorted(runs, key=lambda run: run.variant.seed):
        found.setdefault(run.sequence, []).append(run)
    return found


def within(runs: Iterable[Run], limit: float) -> dict[SequenceKey, FloatArray]:
    """By sequence: (r, n) 1.0 where its runs are within a limit, a share of the diameter, in each frame."""
    return {
        name: np.stack([run.distance < limit for run in own]).astype(float) for name, own in by_sequence(runs).items()
    }


def difference(first: Sequence[Run], other: Sequence[Run], limit: float) -> Interval | None:
    """Other less first, of recalls at a limit on the sequences, seeds and frames that both have; None without any."""
    both = {_frames_of(run) for run in first} & {_frames_of(run) for run in other}
    before, after = (within([run for run in runs if _frames_of(run) in both], limit) for runs in (first, other))
    found = [after[name] - before[name] for name in after if before[name].size]
    return bootstrap_mean(found) if found else None


def _frames_of(run: Run) -> tuple[SequenceKey, int, tuple[int, ...]]:
    """What two runs share that are compared."""
    return run.sequence, run.variant.seed, run.frame_ids


def table(runs: Sequence[Run]) -> tuple[Row, ...]:
    """The rows of all groups and variants; methods in the order of the runs, the first being what others are held
    against."""
    methods = list(dict.fromkeys(run.method for run in runs))
    rows = []
    for group, members in groups(runs):
        for key in sorted({run.variant.group for run in members}):
            alike = [run for run in members if run.variant.group == key and len(run.frame_ids)]
            by_method = {name: [run for run in alike if run.method == name] for name in methods}
            first = by_method[methods[0]]
            rows += [_row(group, name, own, first) for name, own in by_method.items() if own]
    return tuple(rows)


def groups(runs: Sequence[Run]) -> Iterator[tuple[str, list[Run]]]:
    """All runs where there are several data sets, those of each data set, and of each kind of motion in it."""
    datasets = list(dict.fromkeys(run.sequence.dataset for run in runs))
    if len(datasets) > 1:
        yield ALL, list(runs)
    for name in datasets:
        own = [run for run in runs if run.sequence.dataset == name]
        yield name, own
        kinds = list(dict.fromkeys(run.kind for run in own))
        if len(kinds) > 1:
            for kind in kinds:
                yield f"{name}: {kind or 'other'}", [run for run in own if run.kind == kind]


class Varied(Protocol):
    """A run, or what was made of some of one method in one variant."""

    @property
    def method(self) -> str:
        """Its name."""

    @property
    def variant(self) -> Variant:
        """How."""


def main_variant(found: Iterable[Varied]) -> Variant:
    """How most methods were run, and of that the plainest: what to show where one variant stands for all.

    Its seed is 0; `Variant()` of nothing.
    """
    methods: dict[Variant, set[str]] = {}
    for one in found:
        methods.setdefault(replace(one.variant, seed=0), set()).add(one.method)
    return min(methods, key=lambda how: (-len(methods[how]), how.group), default=Variant())


def _row(group: str, method: str, runs: list[Run], first: list[Run]) -> Row:
    recalls = tuple(bootstrap_mean(list(within(runs, limit).values())) for limit in LIMITS)
    against: tuple[Interval, ...] = ()
    if first and first[0].method != method:
        found = [difference(first, runs, limit) for limit in LIMITS]
        against = tuple(item for item in found if item is not None)
    ms = np.concatenate([run.ms[run.distance <= LOST_SHARE] for run in runs])
    ms = ms[np.isfinite(ms)]
    memory = [run.memory_mb for run in runs if math.isfinite(run.memory_mb)]
    by_part = {(run.sequence.dataset, run.sequence.object_id): run.prepare_s for run in runs}
    preparing = [seconds for seconds in by_part.values() if math.isfinite(seconds)]
    sizes = {run.size for run in runs}
    pooled = pooled_scores(run.errors for run in runs)
    return Row(
        group, runs[0].variant, method, len({run.sequence for run in runs}), len(runs), pooled, recalls,
        pooled.frames_until_lost / len(runs), sum(run.is_lost for run in runs), sum(len(run.resets) for run in runs),
        float(np.median(ms)) if len(ms) else math.nan, float(np.quantile(ms, 0.95)) if len(ms) else math.nan,
        max(memory, default=math.nan), float(np.mean(preparing)) if preparing else math.nan,
        sizes.pop() if len(sizes) == 1 else (0, 0),
        runs[0].threads, against,
    )  # fmt: skip
