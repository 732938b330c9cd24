"""Slow sequences: rows are means over sequences, each of both orders, and tell starts and methods apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from acp_lab.tracking.method import METHODS as TRACKING
from benchmarks.deviations import steps
from benchmarks.slow_sequences import METHODS, SlowRun, pooled_rows, sequence_rows

NEAR, FAR = np.full(20, 0.01), np.concatenate([np.full(10, 0.03), np.full(10, np.inf)])
RUNS = [
    SlowRun("set 1", "truth", "painted edges", NEAR),
    SlowRun("set 2", "truth", "painted edges", FAR),
    SlowRun("set 1", "off", "painted edges", FAR),
    SlowRun("set 1", "truth", "exact edges", NEAR),
]


def test_every_method_is_a_step_of_the_path() -> None:
    named = steps()
    assert set(METHODS.values()) <= set(named)
    paper = TRACKING["acp-paper"]
    assert named[METHODS["painted edges"]] == paper
    in_image = replace(paper, variables=replace(paper.variables, lengths="image"))
    assert named[METHODS["painted edges, lengths in the image"]] == in_image
    by_homography = replace(paper, variables=replace(in_image.variables, direction="homography"))
    assert named[METHODS["painted edges, by homography"]] == by_homography
    for ending in ("", ", by homography"):
        painted, exact = (named[METHODS[f"{edges} edges{ending}"]] for edges in ("painted", "exact"))
        assert replace(exact, source=painted.source) == painted
        assert exact.source != painted.source


def test_rows_are_means_over_sequences_with_intervals() -> None:
    rows = pooled_rows(RUNS)
    assert list(rows) == ["truth: painted edges", "off: painted edges", "truth: exact edges"]
    assert [rows["truth: painted edges"][key][0] for key in ("@2", "@5", "@10")] == pytest.approx([0.5, 0.75, 0.75])
    mean, low, high = rows["truth: painted edges"]["@5"]
    assert low < mean < high
    assert rows["off: painted edges"]["@2"][0] == 0.0
    assert rows["truth: exact edges"]["@2"] == [1.0, 1.0, 1.0]


def test_each_sequence_is_told_from_truth() -> None:
    rows = sequence_rows(RUNS)
    assert list(rows) == ["set 1: painted edges", "set 2: painted edges", "set 1: exact edges"]
    assert rows["set 2: painted edges"] == {"@2": 0.0, "@5": 0.5, "@10": 0.5}
