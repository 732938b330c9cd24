"""A bracket that moves through twelve small frames, drawn once for this layer's tests."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.cad.part import Part
from acp_lab.prepared_part import PreparedPart
from tests.made_parts import bracket, looking_at
from tests.tracking.rendered import MadeSequence, draw, poses, prepared


@pytest.fixture(scope="session")
def part() -> Part:
    # Its origin lies behind the camera, as that of a CAD file may.
    return bracket(shift=(-400.0, -300.0, -500.0))


@pytest.fixture(scope="session")
def model(part: Part) -> PreparedPart:
    return prepared(part)


@pytest.fixture(scope="session")
def sequence(part: Part) -> MadeSequence:
    truth = poses(part, looking_at(part, np.array([0.8, 0.6, 1.0]), 330.0, 0.3), 12)
    return MadeSequence([draw([(part, pose)], seed) for seed, pose in enumerate(truth)], {1: truth})
