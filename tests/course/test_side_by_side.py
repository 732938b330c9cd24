"""The comparison lab of notebook 11: runs are kept, and what cannot be run says so."""

from __future__ import annotations

from pathlib import Path

import pytest

from acp_lab.bench import runner, spread
from acp_lab.course.side_by_side import compare
from acp_lab.course.workshop import FOLDER_VARIABLE
from acp_lab.errors import ParameterError, TrackingError
from acp_lab.prepared_part import PreparedPart
from tests.prepared_sample import sample_model


@pytest.fixture(autouse=True)
def prepared_sample(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
    monkeypatch.setattr(PreparedPart, "load", lambda *_: sample_model())
    runner._prepared.cache_clear()


def test_methods_are_compared_and_their_runs_kept(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    report = compare(["acp-edges", "region"], off=2.0, step=4, starts=2)
    assert [row.method for row in report.rows] == ["acp-edges", "region"]
    assert [row.runs for row in report.rows] == [2, 2]
    text = str(report)
    assert "sample: 1 of 4 frames, from 2°, 2 mm off" in text
    assert text.splitlines()[1].split()[:2] == ["method", "runs"]
    assert len(list((tmp_path / "bench_quick").glob("*.json"))) == 4

    def refuse(*_: object) -> None:
        raise AssertionError("was run again")

    monkeypatch.setattr(spread, "run_task", refuse)
    assert compare(["acp-edges", "region"], off=2.0, step=4, starts=2).rows == report.rows


def test_a_method_that_is_none() -> None:
    with pytest.raises(TrackingError, match="magic"):
        compare(["magic"])
    with pytest.raises(ParameterError, match="choose one or more"):
        compare([])
