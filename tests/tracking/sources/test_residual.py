"""The residual homography: rigid edges moved to an I that no rigid motion makes."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.cad.part import Part
from acp_lab.errors import GeometryError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.homography import apply_homography, homography_from_points
from acp_lab.prepared_part import PreparedPart
from acp_lab.tracking.frame_view import Estimate, View
from acp_lab.tracking.motions import ControlPointVariables, PoseVariables
from acp_lab.tracking.sources.lift import EdgeLifter
from acp_lab.tracking.sources.residual import ResidualHomography, rigid_neighbour
from acp_lab.tracking.sources.rigid import RigidSource
from tests.made_parts import looking_at
from tests.tracking.views import differences, prior_of, view_at

PULL = np.array([[6.0, -3.0], [-2.0, 4.0], [1.0, 5.0], [-4.0, -2.0]])


@pytest.fixture
def view(part: Part) -> View:
    return view_at(part, looking_at(part, np.array([0.8, 0.6, 1.0]), 330.0, 0.3))


@pytest.fixture
def bare(model: PreparedPart) -> RigidSource:
    return RigidSource(model.best_generator(), 0.0)


@pytest.fixture
def pulled(view: View) -> Estimate:
    """Control points several px off what any pose shows."""
    at = view.at_points(prior_of(view).control_points + PULL)
    assert np.abs(rigid_neighbour(at).control_points - at.control_points).max() > 1.0
    return at


def test_a_rigid_i_is_generated_as_it_is(view: View, bare: RigidSource) -> None:
    source = ResidualHomography(bare)
    expected = bare.generate(prior_of(view), 200)
    np.testing.assert_array_equal(source.generate(prior_of(view), 200).points, expected.points)
    of_points = view.at_points(prior_of(view).control_points)
    found = source.generate(of_points, 200)
    np.testing.assert_array_equal(found.sample_ids, expected.sample_ids)
    np.testing.assert_allclose(found.points, expected.points, atol=1e-3)


def test_what_is_not_rigid_moves_edges_by_the_homography_of_the_rest(
    view: View, bare: RigidSource, pulled: Estimate
) -> None:
    neighbour = rigid_neighbour(pulled)
    rigid, found = bare.generate(neighbour, 200), ResidualHomography(bare).generate(pulled, 200)
    rest = homography_from_points(neighbour.control_points, pulled.control_points)
    np.testing.assert_allclose(found.points, apply_homography(rest, rigid.points), atol=1e-6)
    # Without it the edges are those of the neighbour: the rest is lost.
    np.testing.assert_allclose(bare.generate(pulled, 200).points, rigid.points, atol=1e-9)
    assert np.abs(found.points - rigid.points).max() > 1.0
    ahead = apply_homography(rest, rigid.points + 1e-4 * rigid.tangents) - apply_homography(rest, rigid.points)
    np.testing.assert_allclose(found.tangents, ahead / np.linalg.norm(ahead, axis=1)[:, None], atol=1e-4)
    again = ResidualHomography(bare).reproject(pulled, found)
    np.testing.assert_allclose(again.points, found.points, atol=1e-6)


def test_edges_move_on_from_a_pulled_i_as_their_rows_say(
    bare: RigidSource, pulled: Estimate, model: PreparedPart
) -> None:
    """A level's edges start from the rest and follow the homography: both together are one from the neighbour."""
    variables = ControlPointVariables(residual="homography")
    source = variables.around(bare)
    edges = source.generate(pulled, 200)
    motion = variables.motion(source, edges, pulled, EdgeLifter(model.part, model.edges), 200)
    step = np.array([2.0, -1.0, 0.5, 1.0, -1.5, 0.0, 2.0, 1.0])
    there = motion.moved(pulled, step)
    neighbour = rigid_neighbour(pulled)
    whole = homography_from_points(neighbour.control_points, there.control_points)
    expected = apply_homography(whole, bare.generate(neighbour, 200).points)
    at, rows = motion.linearised(there)
    np.testing.assert_allclose(at.points, expected, atol=1e-6)
    by_differences = np.einsum("nj,njk->nk", edges.normals, differences(motion, there, 8, 1e-3))
    np.testing.assert_allclose(rows(edges.normals), by_differences, atol=1e-4)


@pytest.mark.parametrize("share", [0.0, 1e-12, 1e-6, 1e-3])
def test_nearly_collinear_control_points_are_refused_or_give_finite_edges(
    share: float, view: View, bare: RigidSource
) -> None:
    """The quad squeezed to a line: an error that a solver catches, or numbers, but never NaN."""
    start = prior_of(view).control_points
    flat: FloatArray = start.mean(0) + (start - start.mean(0)) * np.array([1.0, share])
    try:
        found = ResidualHomography(bare).generate(view.at_points(flat), 200)
    except GeometryError:
        assert share < 0.1
    else:
        assert share > 0.0
        assert np.isfinite(found.points).all()


def test_only_free_control_points_have_a_rest(bare: RigidSource) -> None:
    assert PoseVariables().around(bare) is bare
    assert ControlPointVariables().around(bare) is bare
    wrapped = ControlPointVariables(residual="homography").around(bare)
    assert isinstance(wrapped, ResidualHomography)
    for name in ("name", "regions", "knows_samples", "canonical_size"):
        assert getattr(wrapped, name) == getattr(bare, name)
