"""Which metric counts for a part, and that it is the plain one, taken of the part's own vertices."""

from __future__ import annotations

import math

import numpy as np
import pytest
import trimesh

from acp_lab.cad.models_info import Symmetries
from acp_lab.cad.part import Part
from acp_lab.evaluation import PartMetric, add_mm, adds_mm, closest_truth, metric_name, pose_error
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import disturb_pose, make_pose, so3_exp
from tests.made_parts import box, bracket, cylinder

HALF_TURN = make_pose(so3_exp(np.array([0.0, 0.0, math.pi])), np.zeros(3))
TRUTH = make_pose(so3_exp(np.array([0.4, -0.3, 0.2])), np.array([10.0, -5.0, 400.0]))


def symmetric_box() -> Part:
    plain = box()
    return Part.from_mesh(plain.vertices, plain.faces, "box", Symmetries(HALF_TURN[None]))


def tube() -> Part:
    """Finely meshed along its axis z, about which it may turn."""
    profile = [[8.0, 0.0], *([12.0, height] for height in range(61)), [8.0, 60.0], [8.0, 0.0]]
    mesh = trimesh.creation.revolve(np.array(profile, float), sections=120)
    about_z = Symmetries(np.zeros((0, 4, 4)), (((0.0, 0.0, 1.0), (0.0, 0.0, 0.0)),))
    return Part.from_mesh(mesh.vertices, mesh.faces, "tube", about_z)


def off(part: Part, seed: int = 0) -> FloatArray:
    return disturb_pose(TRUTH, part.box_centre, 4.0, 3.0, np.random.default_rng(seed))


def test_a_plain_part_is_measured_by_add() -> None:
    part = bracket()
    metric, estimate = PartMetric(part), off(part)
    expected = add_mm(part.vertices, estimate, TRUTH)
    assert metric.name == metric_name(part) == "ADD"
    assert metric.mm(estimate, TRUTH) == pytest.approx(expected, abs=1e-12)
    assert metric.share(estimate, TRUTH) == pytest.approx(expected / part.diameter)
    assert metric.percent(estimate, TRUTH) == pytest.approx(100.0 * expected / part.diameter)


def test_a_symmetric_part_is_measured_by_add_s() -> None:
    part = symmetric_box()
    metric, estimate = PartMetric(part), off(part)
    assert metric.name == metric_name(part) == "ADD-S"
    assert metric.mm(estimate, TRUTH) == pytest.approx(adds_mm(part.vertices, estimate, TRUTH))
    assert metric.percent(TRUTH @ HALF_TURN, TRUTH) == pytest.approx(0.0, abs=1e-6)
    assert add_mm(part.vertices, TRUTH @ HALF_TURN, TRUTH) > 0.3 * part.diameter


def test_without_truth_or_without_a_pose() -> None:
    for part in (bracket(), symmetric_box()):
        metric = PartMetric(part)
        assert math.isnan(metric.percent(TRUTH, None))
        assert metric.mm(np.full((4, 4), np.nan), TRUTH) == math.inf


def test_every_kth_vertex_is_enough() -> None:
    part = cylinder()
    few, estimate = PartMetric(part, 50), off(part)
    step = math.ceil(len(part.vertices) / 50)
    assert step > 1
    assert few.mm(estimate, TRUTH) == pytest.approx(add_mm(part.vertices[::step], estimate, TRUTH))


def test_the_nearest_point_of_add_s_is_sought_among_all_vertices() -> None:
    """A finely meshed turned part is near itself in every turn, at however many vertices that is asked."""
    part = tube()
    estimate = TRUTH @ make_pose(so3_exp(np.array([0.0, 0.0, np.radians(33.0)])), np.zeros(3))
    estimate[2, 3] += 0.005 * part.diameter
    assert PartMetric(part, 200).mm(estimate, TRUTH) == pytest.approx(PartMetric(part).mm(estimate, TRUTH), rel=0.1)


def test_the_closest_truth_is_the_one_that_the_errors_are_against() -> None:
    part = symmetric_box()
    estimate = off(part) @ HALF_TURN
    closest = closest_truth(estimate, TRUTH, part.symmetries)
    np.testing.assert_allclose(closest, TRUTH @ HALF_TURN, atol=1e-12)
    assert pose_error(estimate, TRUTH, part.symmetries) == pose_error(estimate, closest)
    assert closest_truth(estimate, TRUTH) is TRUTH
