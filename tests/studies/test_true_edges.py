"""True edges: sampled, hidden ones removed, projected."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.cad.edges import facing, sample_edges
from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import transform
from acp_lab.studies.true_edges import TrueEdges
from tests.made_parts import box, bracket, looking_at

CAMERA = Camera(320, 240, 400.0, 400.0, 159.5, 119.5)


def test_a_box_shows_the_nine_edges_that_turn_to_the_camera() -> None:
    truth = TrueEdges(box((40.0, 30.0, 20.0)))
    pose = looking_at(truth.part, np.array([1.0, 0.8, 0.9]), 300.0)
    rows = truth.rows(pose)
    np.testing.assert_array_equal(rows, np.flatnonzero(facing(truth.edges, eye_position(pose)).shows))
    far_corner = truth.part.box_min
    on_far_edges = (np.abs(truth.edges.points_obj[rows] - far_corner) < 1e-6).sum(1) == 2
    assert not on_far_edges.any(), "the three edges at the far corner are hidden"
    assert len(rows) / len(truth.edges) == pytest.approx(0.75, abs=0.03)


def test_a_bracket_hides_some_of_its_edges_and_the_rest_is_projected() -> None:
    truth = TrueEdges(bracket())
    pose = looking_at(truth.part, np.array([-1.0, 0.5, 0.3]), 330.0)
    rows = truth.rows(pose)
    shows = np.flatnonzero(facing(truth.edges, eye_position(pose)).shows)
    assert set(rows) < set(shows)
    at = truth.at(pose, CAMERA)
    np.testing.assert_array_equal(at.sample_ids, rows)
    np.testing.assert_allclose(at.points, CAMERA.project(transform(pose, truth.edges.points_obj[rows])))
    some = truth.project(rows[:5], pose, CAMERA)
    np.testing.assert_array_equal(some.points, at.points[:5])


def test_samples_of_a_prepared_part_are_taken_as_they_are() -> None:
    part = box()
    coarse = sample_edges(part, spacing_mm=5.0)
    assert TrueEdges(part, coarse).edges is coarse
    assert len(TrueEdges(part).edges) > len(coarse)
