"""Colours of residuals, and colours as bytes."""

from __future__ import annotations

import numpy as np

from acp_lab.display.colours import GREY, SKY, VERMILLION, residual_colours, to_bytes


def test_residuals_run_from_sky_blue_to_vermillion() -> None:
    colours = residual_colours(np.array([0.0, 3.0, -3.0, 50.0, np.inf, np.nan]))
    np.testing.assert_allclose(colours[0], SKY)
    for row in colours[1:5]:
        np.testing.assert_allclose(row, VERMILLION)
    np.testing.assert_allclose(colours[5], GREY)
    assert residual_colours(np.zeros(0)).shape == (0, 3)


def test_colours_as_bytes() -> None:
    assert to_bytes((0.0, 0.5, 1.0)).tolist() == [0, 128, 255]
