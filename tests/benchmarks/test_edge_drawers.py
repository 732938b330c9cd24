"""The ways to draw an edge image that are compared by their time draw pictures of one size."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.cad.edges import sample_edges
from acp_lab.cad.part import Part
from acp_lab.cad.raycast import make_caster
from acp_lab.control_points.canonical_frame import canonical_frame
from acp_lab.control_points.view_regions import ALL_REGIONS
from benchmarks.edge_drawers import MeshUnderTest, View, autoencoder, edge_samples
from tests.made_parts import bracket


@pytest.fixture(scope="module")
def part() -> Part:
    return bracket()


def test_the_autoencoder_paints_as_large_as_the_others_draw(part: Part) -> None:
    eye_obj = part.box_centre + 4.0 * part.diameter * np.array([0.1, 0.2, 0.97])
    view = View(4, canonical_frame(eye_obj, part.box_centre, part.radius, ALL_REGIONS[4]))
    mesh = MeshUnderTest(part, make_caster(part), sample_edges(part), 0.0, 0.0)
    for draw in (autoencoder(part), edge_samples(mesh)):
        assert draw(view).shape == (view.frame.size, view.frame.size)
