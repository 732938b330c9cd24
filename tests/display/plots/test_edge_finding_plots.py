"""Pictures of what an edge point sees along its normal."""

from __future__ import annotations

import numpy as np

from acp_lab.display.plots.edge_finding import draw_profile, profile
from acp_lab.imaging.edge_search import image_patch
from tests.display.blank_axes import axes_of

STEP = np.repeat(np.where(np.arange(60) < 31, 40, 160).astype(np.uint8)[None], 40, 0)
IMAGE = np.repeat(STEP[..., None], 3, 2)
EDGE_X = 30.5
"""Between the last dark and the first bright column."""


def test_the_profile_is_steepest_at_the_edge() -> None:
    patch = image_patch(IMAGE, (5, 5, 55, 35))
    steps = np.arange(-8.0, 8.01, 0.25)
    grey, gradient = profile(patch, np.array([28.0, 20.0]), np.array([1.0, 0.0]), steps)
    # The two columns beside the edge share the steepest gradient.
    steepest = np.abs(gradient) > np.abs(gradient).max() - 1e-3
    np.testing.assert_allclose(steps[steepest].mean(), EDGE_X - 28.0, atol=1e-6)
    np.testing.assert_allclose(grey[[0, -1]], [40.0, 160.0], atol=1.0)


def test_candidates_are_drawn_where_the_gradient_peaks() -> None:
    (axes,) = axes_of()
    patch = image_patch(IMAGE, (5, 5, 55, 35))
    draw_profile(axes, patch, np.array([28.0, 20.0]), np.array([1.0, 0.0]), 8, way_px=EDGE_X - 28.0)
    drawn = {line.get_label(): np.asarray(line.get_xdata(), float) for line in axes.lines}
    np.testing.assert_allclose(drawn["candidates"], EDGE_X - 28.0, atol=0.1)
    np.testing.assert_allclose(drawn["its true place"], EDGE_X - 28.0)
    heights = {line.get_label(): np.asarray(line.get_ydata(), float) for line in axes.lines}
    np.testing.assert_allclose(heights["candidates"], heights["10 x gradient of light"].max(), rtol=0.05)
