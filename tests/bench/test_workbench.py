"""Where data sets, parts and runs are."""

from __future__ import annotations

from pathlib import Path

import pytest

from acp_lab.bench.workbench import Workbench
from acp_lab.errors import ParameterError
from acp_lab.sample import sample_dataset


def test_a_data_set_goes_by_its_own_name(tmp_path: Path) -> None:
    sample = Path(sample_dataset())
    assert Workbench({"sample": sample}, {"sample": tmp_path}, tmp_path).sequences
    with pytest.raises(ParameterError, match=r"roots\['mine'\] = .*'sample'"):
        Workbench({"mine": sample}, {"mine": tmp_path}, tmp_path)


def test_every_data_set_has_a_folder_of_parts(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="parts: has no 'sample'"):
        Workbench({"sample": Path(sample_dataset())}, {}, tmp_path)
