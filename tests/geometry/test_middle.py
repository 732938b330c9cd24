"""The median of a few numbers."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from acp_lab.geometry.middle import median


@given(st.lists(st.floats(allow_nan=False, min_value=-1e300, max_value=1e300) | st.just(np.inf), min_size=1))
def test_it_is_numpys(values: list[float]) -> None:
    assert median(np.array(values)) == np.median(values)


@pytest.mark.parametrize("values", [[], [np.nan], [1.0, np.nan, 2.0]])
def test_there_is_none_of_nothing_nor_of_what_is_not_known(values: list[float]) -> None:
    assert np.isnan(median(np.array(values)))
