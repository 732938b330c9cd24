"""Kernels where nothing can be kept on disk."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest

from acp_lab import compiled
from acp_lab.compiled import kernel


def test_where_nothing_can_be_written_kernels_are_compiled_and_it_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    njit = numba.njit

    def nowhere(*args: Any, cache: bool, **options: Any) -> Any:
        def decorate(function: Any) -> Any:
            if cache:
                raise RuntimeError("cannot cache function 'doubled': no locator available for file 'x.py'")
            return njit(*args, **options)(function)

        return decorate

    monkeypatch.setattr(numba, "njit", nowhere)
    compiled._say_that_nothing_is_kept.cache_clear()

    def doubled(values: np.ndarray) -> float:
        return 2.0 * values[0]

    with pytest.warns(UserWarning, match="set NUMBA_CACHE_DIR to a folder that you can write") as told:
        functions = [kernel("f8(f8[::1])")(doubled) for _ in range(2)]
    assert len(told) == 1
    assert Path(told[0].filename).is_relative_to(Path(compiled.__file__).parent)  # which notes are made of
    assert functions[1](np.array([2.0])) == 4.0
