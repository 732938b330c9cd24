"""Pictures of ambiguous pairs."""

from __future__ import annotations

import numpy as np

from acp_lab.cad.edges import sample_edges
from acp_lab.cad.raycast import make_caster
from acp_lab.display.plots.ambiguity import ambiguity_figure
from acp_lab.geometry.camera import Camera
from acp_lab.studies.ambiguity import Ambiguities, AmbiguousPair
from tests.made_parts import bracket, looking_at


def test_a_pair_is_drawn_with_both_contours_and_both_pictures() -> None:
    part = bracket()
    poses = [
        looking_at(part, direction, 200.0) for direction in (np.array([0.2, 0.1, 1.0]), np.array([0.2, 0.1, -1.0]))
    ]
    found = Ambiguities(Camera(96, 96, 250.0, 250.0, 47.5, 47.5), (AmbiguousPair(*poses, 170.0, 0.01, 0.04),))
    figure = ambiguity_figure(part, sample_edges(part), make_caster(part), found)
    figure.canvas.draw()
    contours, edges, first, second = figure.axes
    assert len(contours.lines) == 2
    assert len(edges.collections) == 2
    assert "1.00%" in contours.get_title()
    assert "4.00%" in edges.get_title()
    assert not np.array_equal(first.images[0].get_array(), second.images[0].get_array())
