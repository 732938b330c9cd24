"""The tracker whose solutions are looked at."""

from __future__ import annotations

import numpy as np

from acp_lab.sequences.frame import Frame
from acp_lab.tracking.method import ACP
from benchmarks.confidence import _Judging
from benchmarks.uncertainty import Watched
from tests.made_parts import bracket, looking_at
from tests.tracking.rendered import CAMERA, draw, poses, prepared


def test_the_solution_that_is_kept_is_the_one_that_is_reported() -> None:
    part = bracket()
    truths = poses(part, looking_at(part, np.array([0.8, 0.6, 1.0]), 330.0, 0.3), 3)
    for tracker in (Watched(prepared(part), ACP), _Judging(prepared(part), ACP)):
        assert tracker.solution is None
        tracker.start(Frame(0, draw([(part, truths[0])], 0, CAMERA), CAMERA), truths[0])
        for number, truth in enumerate(truths[1:], 1):
            tracker.forget()
            result = tracker.track(Frame(number, draw([(part, truth)], number, CAMERA), CAMERA))
            assert tracker.solution is not None
            np.testing.assert_array_equal(tracker.solution.cam_T_obj, result.cam_T_obj)
            if isinstance(tracker, _Judging):
                assert 0.0 < tracker.expected_error(tracker.solution) < 0.1
