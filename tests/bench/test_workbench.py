"""Where data sets, parts and runs are."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import pytest

from acp_lab.bench import workbench
from acp_lab.bench.protocol import Task
from acp_lab.bench.record import Run
from acp_lab.bench.workbench import Workbench
from acp_lab.errors import ParameterError, TrackingError
from acp_lab.sample import sample_dataset
from acp_lab.tracking.method import ACP, METHODS
from acp_lab.tracking.solvers import GaussNewton
from tests.bench.made_runs import made_run


def test_a_data_set_goes_by_its_own_name(tmp_path: Path) -> None:
    sample = Path(sample_dataset())
    assert Workbench({"sample": sample}, {"sample": tmp_path}, tmp_path).sequences
    with pytest.raises(ParameterError, match=r"roots\['mine'\] = .*'sample'"):
        Workbench({"mine": sample}, {"mine": tmp_path}, tmp_path)


def test_every_data_set_has_a_folder_of_parts(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="parts: has no 'sample'"):
        Workbench({"sample": Path(sample_dataset())}, {}, tmp_path)


@dataclass(frozen=True)
class OwnSolver(GaussNewton):
    """A stage that is none of ours."""

    kind: ClassVar[str] = "own"


def test_methods_are_compared_as_well_as_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def complete(tasks: list[Task], *_: object, **__: object) -> list[Run]:
        asked.extend(tasks)
        return [made_run([0.01], task.method_name, task.sequence, task.variant) for task in tasks]

    asked: list[Task] = []
    monkeypatch.setattr(workbench, "complete", complete)
    bench = Workbench({"sample": Path(sample_dataset())}, {"sample": tmp_path}, tmp_path)
    mine = replace(ACP, name="mine", margin_px=40.0)
    report = bench.compare(["acp", mine, "GOS", METHODS["region"], "region"], bench.sequences)
    assert report.methods == ["acp", "mine", "GOS", "region"]
    assert [task.settings() for task in asked if task.method] == [ACP, mine, METHODS["region"]]
    with pytest.raises(ParameterError, match="method mine: two are called so"):
        bench.compare([mine, replace(mine, margin_px=50.0)], bench.sequences)
    with pytest.raises(TrackingError, match="method own: cannot be written as TOML") as told:
        bench.compare([replace(ACP, name="own", solver=OwnSolver())], bench.sequences)
    assert len(str(told.value)) < 400
