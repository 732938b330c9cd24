"""Settings that make no sense are refused before they take hours, gigabytes or a division by zero."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from acp_lab.commands.methods import chosen_method
from acp_lab.errors import InputFileError, ParameterError
from acp_lab.tracking.limits import check_limits
from acp_lab.tracking.method import METHODS, Method


@pytest.mark.parametrize("method", METHODS.values(), ids=METHODS.keys())
def test_every_named_method_is_within_them(method: Method) -> None:
    check_limits(method, "here")


@pytest.mark.parametrize(
    ("lines", "told"),
    [
        ("[states]\npatience = 1000000000", "states.patience = 1e+09: give at most 100000"),
        ("[learning.offsets]\nlargest = inf", "learning.offsets.largest = inf: give at most 1e+06"),
        ("[learning.offsets]\ninner_power = 1e9", "learning.offsets.inner_power = 1e+09: give at most 10"),
        ("[learning.reliability]\nmiss_px = 1e300", "miss_px = 1e+300: give at most 1000"),
        (
            '[schedule]\nkind = "pixels"\n[[schedule.levels]]\nreach_px = 1000000000\nsigma_px = 1.0',
            "schedule.levels.reach_px = 1e+09: give at most 1000",
        ),
    ],
)
def test_what_is_beyond_them_is_named_with_the_file(lines: str, told: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(f'base = "acp"\n{lines}\n')
    with pytest.raises(ParameterError) as caught:
        chosen_method("acp", path)
    assert str(caught.value).startswith(f"{path}: ")
    assert told in str(caught.value)


@pytest.mark.parametrize(
    ("lines", "told"),
    [
        ("[start]\nturn_deg = inf", "start.turn_deg = inf: give 0 to 180"),
        ("[recovery.cloud]\nposes = 0", "recovery.cloud.poses = 0: give 1 to 10000"),
        ("[start]\nlargest_shift_px = 0.0", "start.largest_shift_px = 0: give more than 0"),
        ("[start]\nlargest_scale = 1e-300", "start.largest_scale = 1e-300: give more than 0"),
    ],
)
def test_what_is_no_cloud_is_named_with_the_file(lines: str, told: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(f'base = "acp"\n{lines}\n')
    with pytest.raises(InputFileError) as caught:
        chosen_method("acp", path)
    assert str(caught.value) == f"{path}: {told}"


def test_no_number_is_no_limit() -> None:
    acp = METHODS["acp"]
    with pytest.raises(ParameterError, match=r"here: start\.agreement = nan"):
        check_limits(replace(acp, start=replace(acp.start, agreement=float("nan"))), "here")  # type: ignore[type-var]
