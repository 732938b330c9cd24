"""The page on stages of one's own: its code runs on the sample as it stands, and does what the page says."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import acp_lab as acp
from acp_lab.geometry.pose import transform
from acp_lab.tracking.result import TrackState
from tests.prepared_sample import sample_model

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "own-stages.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def names(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What its code leaves behind; the part that the tests prepared stands in for the one that it prepares."""
    found: dict[str, Any] = {"__name__": __name__}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(acp, "prepare", lambda part, out: sample_model())
        patch.chdir(tmp_path_factory.mktemp("page"))
        for block in re.findall(r"^```python\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL):
            exec(compile(block, "own-stages.md", "exec", dont_inherit=True), found)
    return found


def test_the_other_edge_detector_follows_the_sample(names: dict[str, Any]) -> None:
    assert acp.evaluate(names["run"], names["scene"]).pooled.recall_5 > 0.8


def test_the_prior_holds_the_part_where_it_is_told_to(names: dict[str, Any]) -> None:
    scene, first, middle = names["scene"], names["first"], names["model"].part.box_centre
    heights = []
    for method in ("acp", names["held"]):
        tracker = acp.Tracker(names["model"], method)
        tracker.start(scene.frame(0), first)
        for number in range(1, 11):
            result = tracker.track(scene.frame(number))
        assert result.state is TrackState.TRACKING
        heights.append(first[:3, 2] @ (transform(result.cam_T_obj, middle) - transform(first, middle)))
    assert abs(heights[1]) < 0.8 * abs(heights[0])
    assert np.sign(heights[0]) == np.sign(heights[1])
