"""Regression of W: it lowers e_3d, also on pairs that it never saw, the same way in both forms."""

from __future__ import annotations

from dataclasses import asdict, replace
from itertools import pairwise

import numpy as np
import pytest

from acp_lab.cad.edges import EdgeSamples
from acp_lab.cad.part import Part
from acp_lab.cad.raycast import RayCaster
from acp_lab.control_points.coplanar_points import mid_section_points
from acp_lab.control_points.regression import RegressionConfig, regress_points
from acp_lab.control_points.view_regions import ALL_REGIONS

SMALL = RegressionConfig(views=12, size=192, points=150, steps=25, rate=0.08)
REGION = ALL_REGIONS[5]  # most of the L is far from the box's middle here


def test_it_lowers_the_loss_on_old_and_new_pairs(part: Part, edges: EdgeSamples, caster: RayCaster) -> None:
    points, report = regress_points(part, edges, caster, REGION, SMALL, seed=0)
    assert report.residual_after < 0.97 * report.residual_before
    assert report.exact_px < report.after_px < report.before_px
    assert report.held_out_after_px < report.held_out_before_px
    assert points.shape == (4, 3)
    # Corner for corner the mid-section, moved along the axis.
    moved = points - mid_section_points(part.box_min, part.box_max, REGION.axis)
    np.testing.assert_allclose(np.delete(moved, REGION.axis, axis=1), 0.0, atol=1e-12)
    assert np.abs(moved[:, REGION.axis]).max() > 0.5


def test_all_eleven_degrees_of_freedom_end_in_the_same_plane(part: Part, edges: EdgeSamples, caster: RayCaster) -> None:
    config = replace(SMALL, steps=8)
    three, _ = regress_points(part, edges, caster, REGION, config, seed=0)
    eleven, report = regress_points(part, edges, caster, REGION, replace(config, form="printed"), seed=0)
    np.testing.assert_allclose(eleven, three, atol=1e-3)
    assert report.form == "printed"


def test_it_is_repeatable_and_tells_its_progress(part: Part, edges: EdgeSamples, caster: RayCaster) -> None:
    config = replace(SMALL, views=6, steps=5)
    told: list[tuple[int, int]] = []
    first, report = regress_points(part, edges, caster, REGION, config, 1, lambda *at: told.append(at))
    again, report_again = regress_points(part, edges, caster, REGION, config, 1)
    np.testing.assert_array_equal(first, again)
    assert asdict(replace(report, train_s=0.0)) == asdict(replace(report_again, train_s=0.0))
    assert told[-1] == (11, 11)
    assert all(earlier < later for earlier, later in pairwise(told))


@pytest.mark.parametrize("steps", [0, 1])
def test_few_steps_never_make_it_worse(part: Part, edges: EdgeSamples, caster: RayCaster, steps: int) -> None:
    _, report = regress_points(part, edges, caster, REGION, replace(SMALL, views=3, steps=steps, rate=5.0), seed=0)
    assert report.residual_after <= report.residual_before
