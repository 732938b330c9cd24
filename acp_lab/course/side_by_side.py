"""The comparison lab on the course's sample: methods side by side, each run kept for the next time."""

from __future__ import annotations

from collections.abc import Iterable

from acp_lab.bench.protocol import SequenceKey, Variant, task_of
from acp_lab.bench.report import Report
from acp_lab.bench.spread import complete
from acp_lab.course.workshop import SAMPLE_OBJECT, files_folder, sample_scene
from acp_lab.errors import ParameterError
from acp_lab.sample import sample_dataset
from acp_lab.tracking.method import method_named


def compare(
    methods: Iterable[str], off: float = 0.0, step: int = 1, starts: int = 1, resets: bool = False, quick: bool = True
) -> Report:
    """Methods on the sample sequence, the first of them being what the others are held against.

    Args:
        off: how far start poses are off, in degrees and in mm; 0 for the truth. starts: how many, where they are off.
        step: use every step-th frame; resets: start a lost part again.
        quick: which of the prepared samples, see `workshop.sample_model`; it must be there.

    Raises:
        AcpLabError: no method is chosen, or one is none, or the sample is not prepared for it.
    """
    methods = list(methods)
    if not methods:
        raise ParameterError("no method to compare: choose one or more")
    key = SequenceKey("sample", sample_scene().scene_id, SAMPLE_OBJECT)
    parts = files_folder() / ("parts_quick" if quick else "parts")
    variants = [Variant(step, off, off, seed, resets) for seed in range(starts if off else 1)]
    tasks = [
        task_of(sample_dataset(), "test", parts, key, method_named(name), variant)
        for name in methods
        for variant in variants
    ]
    folder = files_folder() / ("bench_quick" if quick else "bench")
    return Report.of(complete(tasks, folder, workers=1), "this one")
