"""A run put together again from its rows says of every frame what its tracker said."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.diagnosis.recorded_run import first_loss, run_from_rows
from acp_lab.tracking.tracker import Tracker
from tests.made_parts import bracket, looking_at
from tests.tracking.rendered import AS_DRAWN, MadeSequence, draw, poses, prepared


@pytest.mark.parametrize("noise", range(3))
def test_states_are_those_of_the_tracker_from_the_first_frame_on(noise: int) -> None:
    """A start that shows mere noise is lost at once, without patience; so it must be when the rows are read again."""
    part = bracket(shift=(-400.0, -300.0, -500.0))
    truth = poses(part, looking_at(part, np.array([0.8, 0.6, 1.0]), 330.0, 0.3), 4)
    shown = [draw([(part, pose)], seed) for seed, pose in enumerate(truth[1:], 1)]
    sequence = MadeSequence([draw([], noise), *shown], {1: truth})
    run = Tracker(prepared(part), AS_DRAWN).run(sequence, truth[0])
    again = run_from_rows(run.rows, sequence, {1: part}, "acp")
    assert [result.state for result in again.results[1]] == [result.state for result in run.results[1]]
    assert first_loss(again.results[1]) == 0
    assert run.results[1][0].quality < 0.15
