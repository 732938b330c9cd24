"""A mapping by view region that keeps its reports and settings together."""

from __future__ import annotations

import pytest

from acp_lab.prepared_part import Trained


def test_regions_are_added_one_by_one() -> None:
    nothing: Trained[str, float] = Trained(settings="steps=3")
    assert not nothing
    trained = nothing.with_region(4, "four", 0.4).with_region(1, "one", 0.1)
    assert dict(trained) == {4: "four", 1: "one"}
    assert trained.regions == (1, 4)
    assert list(trained.reports.items()) == [(4, 0.4), (1, 0.1)]
    assert trained.settings == "steps=3"
    assert not nothing, "the one before is left as it was"
    assert 2 not in trained
    with pytest.raises(KeyError):
        trained[2]


def test_other_settings_start_anew() -> None:
    trained: Trained[str, float] = Trained({4: "four"}, {4: 0.4}, "steps=3")
    assert trained.under("steps=3") is trained
    anew = trained.under("steps=4")
    assert (len(anew), dict(anew.reports), anew.settings) == (0, {}, "steps=4")
