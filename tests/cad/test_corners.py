"""Corners: where creases meet, and which of them a view shows."""

from __future__ import annotations

import numpy as np

from acp_lab.cad.corners import corner_points, visible_points
from acp_lab.cad.raycast import make_caster
from tests.made_parts import box, bracket, cylinder


def test_a_box_has_eight_corners_and_shows_seven() -> None:
    part = box()
    corners = corner_points(part)
    np.testing.assert_allclose(np.unique(np.abs(corners), axis=0), [[20.0, 15.0, 10.0]])
    assert len(corners) == 8
    eye = np.array([200.0, 150.0, 120.0])
    seen = visible_points(make_caster(part), corners, eye, 0.005 * part.diameter)
    assert seen.sum() == 7
    np.testing.assert_allclose(corners[~seen], [[-20.0, -15.0, -10.0]])


def test_an_extruded_l_has_twelve() -> None:
    assert len(corner_points(bracket())) == 12


def test_a_round_rim_has_none() -> None:
    assert corner_points(cylinder()).shape == (0, 3)
    assert visible_points(make_caster(cylinder()), np.zeros((0, 3)), np.array([0.0, 0, 200]), 0.1).shape == (0,)
