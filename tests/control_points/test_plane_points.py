"""Parametrisations of W: coplanar, starting at the mid-section, open to every direction of the region."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from acp_lab.control_points.coplanar_points import mid_section_points
from acp_lab.control_points.motion_pairs import view_frame
from acp_lab.control_points.plane_points import LARGEST_TILT, Form, PlanePoints
from acp_lab.control_points.view_regions import ALL_REGIONS, HYSTERESIS, sample_directions
from acp_lab.geometry.homography import check_quad, corner_areas
from tests.made_parts import box

FORMS: tuple[Form, Form] = ("plane", "printed")
numbers = st.lists(st.floats(-3.0, 3.0), min_size=11, max_size=11)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("region", ALL_REGIONS, ids=lambda region: region.name)
def test_zero_is_the_mid_section(form: Form, region: object) -> None:
    part = box((40.0, 30.0, 4.0), (5.0, -6.0, 7.0))
    which = next(one for one in ALL_REGIONS if one == region)
    points = PlanePoints.of(part, which, form)
    expected = mid_section_points(part.box_min, part.box_max, which.axis)
    np.testing.assert_allclose(points.points_obj(points.zero()).numpy(), expected, atol=1e-12)


@given(values=numbers, index=st.integers(0, 5), form=st.sampled_from(FORMS))
def test_points_are_coplanar_and_inside_bounds_a_convex_quad(values: list[float], index: int, form: Form) -> None:
    part, region = box((60.0, 30.0, 6.0)), ALL_REGIONS[index]
    points = PlanePoints.of(part, region, form)
    parameters = points.bounded(torch.tensor(values, dtype=torch.float64)[: len(points.zero())])
    w = points.points_obj(parameters).numpy()
    spread = np.linalg.svd(w - w.mean(0), compute_uv=False)
    assert spread[2] < 1e-9 * spread[0]
    flat = np.delete(w, region.axis, axis=1)
    check_quad(100.0 * flat / np.ptp(flat, axis=0), minimum_px=10.0)


@given(values=numbers)
def test_bounds_change_nothing_inside_them(values: list[float]) -> None:
    points = PlanePoints.of(box(), ALL_REGIONS[0], "printed")
    inside = points.bounded(torch.tensor(values, dtype=torch.float64))
    torch.testing.assert_close(points.bounded(inside), inside)
    assert inside[1:3].abs().sum() <= LARGEST_TILT + 1e-12
    assert inside.abs().max() <= 1.0


@pytest.mark.parametrize("size", [(60.0, 40.0, 30.0), (50.0, 50.0, 50.0), (80.0, 60.0, 4.0)], ids=str)
@pytest.mark.parametrize("tilts", [(1.0, 0.0), (0.5, 0.5), (-0.5, 0.5), (0.0, -1.0)], ids=str)
def test_the_steepest_plane_stays_open_from_all_over_the_region(
    size: tuple[float, float, float], tilts: tuple[float, float]
) -> None:
    """The bound of the module: 0.4 of the mid-section's area, the same side up, also where hysteresis holds on."""
    part = box(size)
    for region in ALL_REGIONS:
        points = PlanePoints.of(part, region, "plane")
        steep = torch.tensor([0.0, LARGEST_TILT * tilts[0], LARGEST_TILT * tilts[1]], dtype=torch.float64)
        for direction in sample_directions(region, 0.5 * part.box_size, 60, overlap=HYSTERESIS - 1.0):
            # From afar: the bound is on directions.
            frame = view_frame(part, region, direction, 100.0 * part.diameter, 0.0, 512)
            straight, tilted = (
                corner_areas(frame.project(points.points_obj(p).numpy()))[0] for p in (points.zero(), steep)
            )
            assert tilted / straight > 0.4
