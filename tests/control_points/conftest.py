"""A bracket, its edges, and a few motion pairs of one region, made once for this layer's tests."""

from __future__ import annotations

import pytest

from acp_lab.cad.edges import EdgeSamples, sample_edges
from acp_lab.cad.part import Part
from acp_lab.cad.raycast import RayCaster, make_caster
from acp_lab.control_points.motion_pairs import MotionPairs, PairConfig, make_motion_pairs
from acp_lab.control_points.view_regions import ALL_REGIONS
from tests.made_parts import bracket

PAIRS = PairConfig(views=6, size=128, points=150, nearest=3.0)


@pytest.fixture(scope="session")
def part() -> Part:
    return bracket(shift=(100.0, -50.0, 20.0))


@pytest.fixture(scope="session")
def edges(part: Part) -> EdgeSamples:
    return sample_edges(part)


@pytest.fixture(scope="session")
def caster(part: Part) -> RayCaster:
    return make_caster(part)


@pytest.fixture(scope="session")
def pairs(part: Part, edges: EdgeSamples, caster: RayCaster) -> MotionPairs:
    return make_motion_pairs(part, edges, caster, ALL_REGIONS[4], PAIRS, seed=3)
