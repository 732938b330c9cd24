"""Painted points are coloured by which way they are off."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from acp_lab.display.plots.painting_bias import draw_painting_bias
from acp_lab.generator.base import GeneratedEdges
from acp_lab.studies.painting_bias import PaintingBias


def test_outwards_is_positive_whichever_way_a_normal_points() -> None:
    points = np.array([[0.0, 0.0], [10.0, 0.0], [0.0, 10.0], [10.0, 10.0]])
    tangents = np.array([[0.0, 1.0], [0.0, 1.0], [0.0, -1.0], [0.0, -1.0]])
    edges = GeneratedEdges(points, tangents, np.ones(4), np.full(4, -1))
    outwards = np.sign(((points - points.mean(0)) * edges.normals).sum(1))
    assert set(outwards) == {-1.0, 1.0}
    bias = PaintingBias(edges, 0.25 * outwards, np.eye(4), 0.0123)
    axes = Figure().subplots()
    draw_painting_bias(axes, bias, edges)
    (dots,) = [item for item in axes.collections if item.get_array() is not None and len(item.get_array()) == 4]
    np.testing.assert_allclose(dots.get_array(), 0.25)
    assert axes.get_title() == "0.25 px off,\nthe pose it shows is 1.23% of the diameter off"
    assert axes.yaxis_inverted()
