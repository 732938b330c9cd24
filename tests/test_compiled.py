"""Kernels where nothing can be kept on disk."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest

from acp_lab import compiled
from acp_lab.commands import doctor
from acp_lab.commands.doctor import Check, Verdict
from acp_lab.compiled import can_be_kept, kernel


@pytest.fixture
def nothing_can_be_written(monkeypatch: pytest.MonkeyPatch) -> None:
    njit = numba.njit
    njit("f8(f8)")(lambda value: value)  # numba imports the rest of itself, before `njit` is another's

    def nowhere(*args: Any, cache: bool = False, **options: Any) -> Any:
        def decorate(function: Any) -> Any:
            if cache:
                raise RuntimeError("cannot cache function 'doubled': no locator available for file 'x.py'")
            return njit(*args, **options)(function)

        return decorate

    monkeypatch.setattr(numba, "njit", nowhere)


@pytest.mark.usefixtures("nothing_can_be_written")
def test_where_nothing_can_be_written_kernels_are_compiled_and_it_is_said() -> None:
    compiled._say_that_nothing_is_kept.cache_clear()

    def doubled(values: np.ndarray) -> float:
        return 2.0 * values[0]

    with pytest.warns(UserWarning, match="set NUMBA_CACHE_DIR to a folder that you can write") as told:
        functions = [kernel("f8(f8[::1])")(doubled) for _ in range(2)]
    assert len(told) == 1
    assert Path(told[0].filename).is_relative_to(Path(compiled.__file__).parent)  # which notes are made of
    assert functions[1](np.array([2.0])) == 4.0


def test_compiled_code_can_be_kept_here() -> None:
    assert can_be_kept()
    assert doctor.check_compiled() == Check(Verdict.OK, "compiled code can be kept")


@pytest.mark.usefixtures("nothing_can_be_written")
def test_the_doctor_tells_where_nothing_can_be_kept() -> None:
    assert not can_be_kept()
    found = doctor.check_compiled()
    assert found.verdict is Verdict.ABSENT
    assert "compiled code cannot be kept, so it is compiled again at every start" in str(found)
    assert str(found).endswith(": set NUMBA_CACHE_DIR to a folder that you can write")


@pytest.mark.parametrize("watched", [True, False])
def test_who_watches_is_told_once_why_the_first_start_takes_so_long(
    watched: bool, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, recwarn: pytest.WarningsRecorder
) -> None:
    monkeypatch.setattr("sys.stderr.isatty", lambda: watched)
    compiled._say_what_takes_so_long.cache_clear()
    source = tmp_path / "mine.py"
    source.write_text("def doubled(values):\n    return 2.0 * values[0]\n")
    said = ["loops are compiled, once on this machine: a minute or less"] if watched else []
    for _ in range(2):  # the second time it is read from disk
        names: dict[str, Any] = {"__name__": "mine"}
        exec(compile(source.read_text(), str(source), "exec"), names)
        assert kernel("f8(f8[::1])")(names["doubled"])(np.array([2.0])) == 4.0
    assert [str(one.message) for one in recwarn.list] == said
