"""The benchmark of starts that the detector finds."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.tracking.find import Finder
from benchmarks.found_starts import WAYS, Run, follow, row
from benchmarks.told_wrong import TrueFrame
from tests.prepared_sample import sample_model, sample_scene


def test_the_first_frame_counts_and_so_does_the_last() -> None:
    runs = [Run(np.array([0.2, 0.01, 0.02, 0.03]), 10.0), Run(np.array([0.01, 0.01, 0.2, 0.2]), 30.0)]
    shares = {"@2": pytest.approx(0.375), "@5": pytest.approx(0.625)}
    assert row(runs) == {"runs": 2, "begins": 0.5, **shares, "ends": 0.5, "ms": 20.0}


def test_a_run_goes_from_the_start_it_is_given() -> None:
    scene, finder = sample_scene(), Finder(sample_model())
    frames = [TrueFrame(scene.frame(k), scene.truth(k, 1), True) for k in scene.frame_ids[:3]]  # type: ignore[arg-type]
    for method, is_found in WAYS.values():
        run = follow(frames, finder, scene.first_pose, method, is_found)
        assert run.errors.shape == (3,)
        assert run.errors.max() < 0.05
        assert run.begin_ms > 0.0
