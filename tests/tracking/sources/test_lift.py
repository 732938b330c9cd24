"""From edge points back to the CAD model."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.cad.part import Part
from acp_lab.generator.base import GeneratedEdges
from acp_lab.prepared_part import PreparedPart
from acp_lab.tracking.frame_view import View
from acp_lab.tracking.sources.lift import EdgeLifter
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
