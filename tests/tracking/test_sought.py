"""Where a lost part was looked for: in words, and there and back through JSON."""

from __future__ import annotations

import json

import numpy as np

from acp_lab.detection.pose_prior import PosePrior
from acp_lab.tracking.sought import Sought, from_rows, to_row

POSE = np.array([[0.0, -1.0, 0.0, 10.0], [1.0, 0.0, 0.0, -20.0], [0.0, 0.0, 1.0, 512.0], [0.0, 0.0, 0.0, 1.0]])


def test_words() -> None:
    assert str(Sought()) == "searched in the whole image, from any side and at any distance; no hypothesis yet"
    near = Sought.by(PosePrior(POSE, 25.0, 1.1, 80.0), POSE, 0.713)
    assert str(near) == (
        "searched within 80 px of its last place, turned by up to 25 degrees, near a distance of 512 mm; "
        "best hypothesis: score 0.71 at t = [10, -20, 512] mm"
    )
    assert "in the whole image, from any side, near" in str(Sought.by(PosePrior(POSE, 180.0, 1.6), None, 0.0))


def test_there_and_back() -> None:
    sought = [Sought.by(PosePrior(POSE, 25.0, 1.1, 80.0), POSE, 0.7), Sought()]
    rows = json.loads(json.dumps([to_row(3, 7 + k, 1, one) for k, one in enumerate(sought)]))
    back = from_rows(rows, 3)
    assert [str(back[1, 7]), str(back[1, 8])] == [str(one) for one in sought]
    assert np.array_equal(back[1, 7].near, POSE)
    assert from_rows(rows, 4) == {}


def test_what_is_no_search_is_left_out() -> None:
    good = to_row(1, 2, 3, Sought.by(PosePrior(POSE, 25.0, 1.1), POSE, 0.7))
    mirrored = np.diag([1.0, 1.0, -1.0, 1.0]).tolist()
    spoiled = [None, 5, {}, {**good, "found": mirrored}, {**good, "near": [1.0]}, {**good, "score": "much"}]
    assert from_rows(spoiled, 1) == {}
    assert list(from_rows([*spoiled, good], 1)) == [(3, 2)]
