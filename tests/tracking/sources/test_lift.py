"""From edge points back to the CAD model."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from acp_lab.cad.edges import visible_samples
from acp_lab.cad.part import Part
from acp_lab.cad.raycast import make_caster
from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.generator.base import GeneratedEdges
from acp_lab.generator.templates import RAY_OFFSET_IN_DIAMETERS
from acp_lab.geometry.pose import transform
from acp_lab.prepared_part import PreparedPart
from acp_lab.tracking.frame_view import View
from acp_lab.tracking.sources.lift import EdgeLifter, may_be_within, nearest_within
from acp_lab.tracking.sources.rigid import RigidSource
from tests.made_parts import looking_at
from tests.tracking.views import prior_of, view_at


@pytest.fixture
def view(part: Part) -> View:
    return view_at(part, looking_at(part, np.array([0.8, 0.6, 1.0]), 330.0, 0.3))


@pytest.fixture
def edges(view: View, model: PreparedPart) -> GeneratedEdges:
    return RigidSource(model.best_generator(), 0.0).generate(prior_of(view), 200)


def test_lifted_edges_are_where_the_generator_has_them(view: View, edges: GeneratedEdges, model: PreparedPart) -> None:
    painted = GeneratedEdges(edges.points, edges.tangents, edges.weights, np.full(len(edges), -1))
    lifted = EdgeLifter(model.part, model.edges).lift(painted, prior_of(view))
    known = np.isfinite(lifted).all(1)
    assert known.mean() > 0.9
    exact = model.edges.points_obj[edges.sample_ids[known]]
    # Crossing edges are near in the image and far in space; few samples lie there.
    assert np.quantile(np.linalg.norm(lifted[known] - exact, axis=1), 0.9) < 0.02 * model.part.diameter


def test_known_samples_are_what_they_are(view: View, edges: GeneratedEdges, model: PreparedPart) -> None:
    lifted = EdgeLifter(model.part, model.edges).lift(edges, prior_of(view))
    np.testing.assert_array_equal(lifted, model.edges.points_obj[edges.sample_ids])


def test_edges_far_from_the_part_are_not_lifted(view: View, model: PreparedPart) -> None:
    stray = GeneratedEdges(np.array([[2.0, 2.0]]), np.array([[1.0, 0.0]]), np.ones(1), np.array([-1]))
    assert np.isnan(EdgeLifter(model.part, model.edges).lift(stray, prior_of(view))).all()


def test_the_point_is_that_of_the_nearest_sample_which_rays_find_visible(
    view: View, edges: GeneratedEdges, model: PreparedPart, rng: np.random.Generator
) -> None:
    """Against the plain way: rays for all samples, then the nearest of those that are seen."""
    at, points = prior_of(view), edges.points + rng.normal(0.0, 3.0, edges.points.shape)
    painted = GeneratedEdges(points, edges.tangents, edges.weights, np.full(len(edges), -1))
    offset_mm = RAY_OFFSET_IN_DIAMETERS * model.part.diameter
    samples = model.edges.take(np.arange(min(len(model.edges), 3000)))
    seen = visible_samples(samples, make_caster(model.part), eye_position(at.cam_T_obj), offset_mm)
    seen_obj = samples.points_obj[seen]
    places = view.camera.project(transform(at.cam_T_obj, seen_obj))
    distances, nearest = cKDTree(places).query(points, distance_upper_bound=4.0)
    near = np.isfinite(distances)
    assert 0.3 < near.mean() < 1.0
    lifted = EdgeLifter(model.part, model.edges).lift(painted, at)
    np.testing.assert_array_equal(np.isfinite(lifted).all(1), near)
    np.testing.assert_array_equal(lifted[near], seen_obj[nearest[near]])


@given(st.integers(0, 60), st.integers(0, 60), st.integers(0, 10_000))
def test_nearest_within_is_the_nearest_of_all(count: int, asked: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    places, points = rng.uniform(0.0, 30.0, (count, 2)), rng.uniform(0.0, 30.0, (asked, 2))
    places[: count // 4, 0] = 15.0  # many of one x
    places[count - count // 5 :] = np.nan
    found = nearest_within(places, points, 3.0)
    away = np.linalg.norm(points[:, None] - places[None], axis=2)
    away[np.isnan(away)] = np.inf
    for k in range(asked):
        best = away[k].min(initial=np.inf)
        assert (found[k] == -1) if best >= 3.0 else away[k, found[k]] == pytest.approx(best, abs=1e-12)


# ---- the quick look before rays are cast -----------------------------------------------------------------------


@given(seed=st.integers(0, 10_000), far_px=st.sampled_from([0.5, 4.0, 30.0]), spread=st.sampled_from([3.0, 80.0]))
def test_what_is_near_may_be_near(seed: int, far_px: float, spread: float) -> None:
    """The quick look leaves out nothing that the exact one finds, and little else than what is near."""
    rng = np.random.default_rng(seed)
    places, points = (rng.normal(0.0, spread, (count, 2)) for count in (20, 60))
    places[0] = points[0] = np.nan
    may_be = may_be_within(places, points, far_px)
    assert (nearest_within(places, points, far_px) < 0)[~may_be].all()
    off = np.abs(points[may_be, None] - places[1:]).max(2).min(1)
    assert (off <= 2.0 * far_px).all()


def test_nothing_is_near_no_place() -> None:
    points = np.zeros((3, 2))
    for places in (np.empty((0, 2)), np.full((2, 2), np.nan)):
        assert not may_be_within(places, points, 4.0).any()
    assert not may_be_within(points, np.full((2, 2), 1e300), 4.0).any()
    assert len(may_be_within(points, np.empty((0, 2)), 4.0)) == 0


def test_places_far_apart_need_no_large_board() -> None:
    places = np.array([[0.0, 0.0], [1e9, 1e9]])
    points = np.array([[3.0, 0.0], [1e9, 1e9 - 3.0], [500.0, 500.0], [np.nan, 0.0]])
    np.testing.assert_array_equal(may_be_within(places, points, 4.0), [True, True, False, False])
    for far in (1e17, 1e200, 1e300):
        assert may_be_within(np.full((1, 2), far), np.array([[far, far], [0.0, 0.0]]), 4.0).tolist() == [True, False]
        assert may_be_within(np.array([[0.0, 0.0], [far, far]]), np.zeros((1, 2)), 4.0).all()
