"""t(I) of rigid generators: PnP, visible samples, projections; and the edge image drawn from them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from acp_lab.cad.edges import EdgeSamples, sample_edges
from acp_lab.control_points.coplanar_points import mid_section_points
from acp_lab.control_points.view_regions import choose_region
from acp_lab.errors import GeometryError
from acp_lab.generator.base import (
    GeneratedEdges,
    RigidGenerator,
    VisibleSamples,
    generate_edges,
    image_tangents,
    project_samples,
)
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import disturb_pose, transform
from tests.geometry.geometry_strategies import directions
from tests.made_parts import bracket, looking_at

PART = bracket()
EDGES = sample_edges(PART)
CAMERA = Camera(width=640, height=512, fx=600.0, fy=620.0, cx=319.5, cy=250.25)


class EverySecond:
    """A generator that shows every second sample, and keeps what it was asked."""

    name = "every second"

    def __init__(self, edges: EdgeSamples) -> None:
        self.edges = edges
        self.asked: tuple[FloatArray, int, int] | None = None

    def visible(self, cam_T_obj: FloatArray, region: int, count: int) -> VisibleSamples:
        self.asked = (cam_T_obj, region, count)
        ids = np.arange(0, len(self.edges), 2)[:count]
        return VisibleSamples(ids, np.zeros(len(ids), bool), np.full(len(ids), 0.75))


def generate(generator: RigidGenerator, control_points: FloatArray, prior: FloatArray, count: int) -> GeneratedEdges:
    points_obj = mid_section_points(PART.box_min, PART.box_max, 2)
    return generate_edges(
        generator, control_points, points_obj, CAMERA, prior, 0.5 * PART.box_size, PART.box_centre, count
    )


@pytest.mark.parametrize("direction", [(0.3, 0.2, 1.0), (-0.4, 0.5, 1.0), (0.2, -0.3, -1.0)], ids=str)
def test_control_points_give_the_projection_at_their_pose(direction: tuple[float, float, float]) -> None:
    pose = looking_at(PART, np.array(direction), 300.0, 0.4)
    points_obj = mid_section_points(PART.box_min, PART.box_max, 2)
    control_points = CAMERA.project(transform(pose, points_obj))
    prior = disturb_pose(pose, PART.box_centre, 3.0, 5.0, np.random.default_rng(0))
    generator = EverySecond(EDGES)
    edges = generate(generator, control_points, prior, 100)
    expected = CAMERA.project(transform(pose, EDGES.points_obj[0:200:2]))
    np.testing.assert_allclose(edges.points, expected, atol=1e-5)
    np.testing.assert_array_equal(edges.sample_ids, np.arange(0, 200, 2))
    assert (edges.weights == 0.75).all()
    assert len(edges) == 100
    assert generator.asked is not None
    asked_pose, region, count = generator.asked
    np.testing.assert_allclose(asked_pose, pose, atol=1e-4)
    assert region == choose_region(np.array(direction), 0.5 * PART.box_size)
    assert count == 100


def test_the_prior_decides_between_the_two_poses_of_a_plane() -> None:
    """Far away the two tilts of a plane look alike; each prior gets the one on its side."""
    points_obj = mid_section_points(PART.box_min, PART.box_max, 2)
    left, right = (looking_at(PART, np.array([x, 0.0, 1.0]), 900.0, 0.0) for x in (-0.3, 0.3))
    for pose in (left, right):
        generator = EverySecond(EDGES)
        generate(generator, CAMERA.project(transform(pose, points_obj)), pose, 10)
        assert generator.asked is not None
        np.testing.assert_allclose(generator.asked[0], pose, atol=1e-3)


def test_degenerate_control_points_are_refused() -> None:
    pose = looking_at(PART, np.array([0.3, 0.2, 1.0]), 300.0)
    in_line = np.array([[100.0, 100.0], [150.0, 100.0], [200.0, 100.0], [250.0, 100.0]])
    with pytest.raises(GeometryError):
        generate(EverySecond(EDGES), in_line, pose, 10)


@given(direction=directions(), roll=st.floats(-np.pi, np.pi))
def test_tangents_are_where_a_small_step_along_the_edge_leads(direction: FloatArray, roll: float) -> None:
    pose = looking_at(PART, direction, 250.0, roll)
    some = EDGES.take(np.arange(100))
    step = 1e-4 * some.tangents_obj
    ahead, behind = (CAMERA.project(transform(pose, some.points_obj + sign * step)) for sign in (1.0, -1.0))
    length = np.linalg.norm(ahead - behind, axis=1)
    tangents = image_tangents(transform(pose, some.points_obj), some.tangents_obj @ pose[:3, :3].T, CAMERA)
    # An edge that points at the eye has no direction in the image.
    clear = length > 2e-6
    np.testing.assert_allclose(tangents[clear], ((ahead - behind) / length[:, None])[clear], atol=1e-4)
    assert np.isfinite(tangents).all()


def test_an_edge_that_points_at_the_eye_gives_no_nan() -> None:
    points = np.array([[0.0, 0.0, 100.0], [10.0, 20.0, 100.0]])
    tangents = image_tangents(points, points / np.linalg.norm(points, axis=1)[:, None], CAMERA)
    assert np.isfinite(tangents).all()
    assert (np.linalg.norm(tangents, axis=1) <= 1.0 + 1e-9).all()


def test_project_samples_keeps_ids_and_weights() -> None:
    pose = looking_at(PART, np.array([0.3, 0.2, 1.0]), 300.0)
    ids = np.array([3, 8, 11])
    edges = project_samples(EDGES, VisibleSamples(ids, np.ones(3, bool), np.array([0.5, 0.6, 0.7])), pose, CAMERA)
    np.testing.assert_allclose(edges.points, CAMERA.project(transform(pose, EDGES.points_obj[ids])))
    np.testing.assert_array_equal(edges.sample_ids, ids)
    np.testing.assert_array_equal(edges.weights, [0.5, 0.6, 0.7])
    np.testing.assert_allclose(np.linalg.norm(edges.tangents, axis=1), 1.0)


# ---- the edge image ------------------------------------------------------------------------------------------


def edges_of(points: list[list[float]], tangents: list[list[float]]) -> GeneratedEdges:
    n = len(points)
    return GeneratedEdges(np.array(points).reshape(n, 2), np.array(tangents).reshape(n, 2), np.ones(n), np.full(n, -1))


def test_strokes_run_along_the_tangents() -> None:
    image = edges_of([[10.0, 5.0], [20.0, 15.0]], [[1.0, 0.0], [0.0, 1.0]]).image(32, 24)
    assert image.shape == (24, 32)
    assert image.dtype == np.uint8
    drawn = {(int(x), int(y)) for y, x in np.argwhere(image == 255)}
    assert drawn == {(9, 5), (10, 5), (11, 5), (20, 14), (20, 15), (20, 16)}
    assert set(np.unique(image)) == {0, 255}


def test_longer_strokes_close_the_gaps() -> None:
    points = [[float(x), 8.0] for x in range(4, 28, 4)]
    short, long = (edges_of(points, [[1.0, 0.0]] * 6).image(32, 16, half) for half in (0.5, 2.0))
    assert (short[8, 4:25] == 0).any()
    assert (long[8, 4:25] == 255).all()


@pytest.mark.parametrize(
    "points", [[], [[np.nan, 5.0]], [[1e9, 5.0]], [[-50.0, -50.0]]], ids=["none", "nan", "far", "outside"]
)
def test_points_that_cannot_be_drawn_leave_the_image_black(points: list[list[float]]) -> None:
    assert not edges_of(points, [[1.0, 0.0]] * len(points)).image(32, 24).any()
