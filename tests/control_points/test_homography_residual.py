"""How much a homography explains: all of a flat part's motion, nothing of what leaves the plane."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from acp_lab.cad.edges import EdgeSamples, sample_edges
from acp_lab.cad.part import Part
from acp_lab.cad.raycast import RayCaster, make_caster
from acp_lab.control_points.coplanar_points import mid_section_points
from acp_lab.control_points.homography_residual import homography_residual
from acp_lab.control_points.view_regions import ALL_REGIONS
from acp_lab.geometry.camera import Camera
from tests.made_parts import box

REGION = ALL_REGIONS[4]


def test_a_plate_in_the_plane_of_its_control_points_moves_by_their_homography(camera: Camera) -> None:
    plate = box((60.0, 40.0, 0.02))
    points = mid_section_points(plate.box_min, plate.box_max, 2)
    found = homography_residual(
        plate, sample_edges(plate), make_caster(plate), REGION, points, camera, 400.0, 2.0, 4.0, views=5
    )
    assert found.moved_px > 1.0
    assert found.share < 0.01


def test_more_motion_leaves_more_unexplained(part: Part, edges: EdgeSamples, caster: RayCaster, camera: Camera) -> None:
    points = mid_section_points(part.box_min, part.box_max, 2)
    one, two = (
        homography_residual(part, edges, caster, REGION, points, camera, 300.0, turn_deg, 0.0, views=8)
        for turn_deg in (1.0, 2.0)
    )
    assert two.moved_px == pytest.approx(2.0 * one.moved_px, rel=0.05)
    assert two.unexplained_px == pytest.approx(2.0 * one.unexplained_px, rel=0.05)
    assert one.share > 0.3
    shifted = homography_residual(part, edges, caster, REGION, points, camera, 300.0, 0.0, 4.0, views=8)
    assert shifted.share < 0.2


def test_px_are_those_of_the_camera(part: Part, edges: EdgeSamples, caster: RayCaster, camera: Camera) -> None:
    points = mid_section_points(part.box_min, part.box_max, 2)
    twice = replace(camera, fx=2.0 * camera.fx, fy=2.0 * camera.fy)
    one, other = (
        homography_residual(part, edges, caster, REGION, points, view, 300.0, 1.0, 1.0, views=3)
        for view in (camera, twice)
    )
    assert other.moved_px == pytest.approx(2.0 * one.moved_px)
    assert other.unexplained_px == pytest.approx(2.0 * one.unexplained_px)
    assert "unexplained" in str(one)
    assert np.isfinite(one.share)
