"""Edges of a rigid part, drawn where its pose has them, and how they follow I."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.cad.edges import facing
from acp_lab.cad.part import Part
from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.errors import PreparationError
from acp_lab.generator.base import VisibleSamples
from acp_lab.generator.painted.edge_images import OUTLINE_SHARE_OF_BREAK
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import transform
from acp_lab.geometry.pose_step import move_pose
from acp_lab.prepared_part import PreparedPart
from acp_lab.tracking.frame_view import View
from acp_lab.tracking.sources import EdgeSource
from acp_lab.tracking.sources.painted import SampleSource
from acp_lab.tracking.sources.rigid import CadSamples, RigidSource, pose_flow, project_inset
from tests.made_parts import bracket, looking_at
from tests.tracking.rendered import CAMERA, prepared
from tests.tracking.views import LeftHalf, prior_of, view_at


@pytest.fixture
def view(part: Part) -> View:
    return view_at(part, looking_at(part, np.array([0.8, 0.6, 1.0]), 330.0, 0.3))


def shown(model: PreparedPart, ids: np.ndarray, pose: FloatArray) -> FloatArray:
    return CAMERA.project(transform(pose, model.edges.points_obj[ids]))


def test_edges_are_the_visible_samples_at_the_pose(view: View, model: PreparedPart) -> None:
    source = CadSamples().open(model, "mid-section")
    edges = source.generate(prior_of(view), 60)
    assert len(edges) == 60
    np.testing.assert_allclose(edges.points, shown(model, edges.sample_ids, view.prior), atol=1e-9)
    points_cam = transform(view.prior, model.edges.points_obj[edges.sample_ids])
    ahead = points_cam + 1e-3 * model.edges.tangents_obj[edges.sample_ids] @ view.prior[:3, :3].T
    assert np.abs(((CAMERA.project(ahead) - edges.points) * edges.normals).sum(1)).max() < 1e-5
    np.testing.assert_allclose(np.linalg.norm(edges.normals, axis=1), 1.0)


def test_edges_of_control_points_are_those_of_their_pose(view: View, model: PreparedPart) -> None:
    source = CadSamples().open(model, "mid-section")
    pose = move_pose(view.prior, view.part.box_centre, np.array([0.02, -0.01, 0.03, 1.0, 0.5, 2.0]))
    by_points = source.generate(view.at_points(view.at_pose(pose).control_points), 60)
    by_pose = source.generate(view.at_pose(pose), 60)
    np.testing.assert_array_equal(by_points.sample_ids, by_pose.sample_ids)
    np.testing.assert_allclose(by_points.points, by_pose.points, atol=1e-4)


@pytest.mark.parametrize("broken_mm", [0.0, 0.8])
def test_reprojected_edges_are_the_same_samples_at_the_pose(view: View, model: PreparedPart, broken_mm: float) -> None:
    # A pose from which another face is the outline's outer one.
    pose = move_pose(view.prior, view.part.box_centre, np.array([0.05, -0.08, 0.06, 2.0, -1.0, 3.0]))
    inset_mm = OUTLINE_SHARE_OF_BREAK * broken_mm
    rigid = RigidSource(model.best_generator(), inset_mm)
    painted = SampleSource(LeftHalf(), "regressed", model.edges, inset_mm, 0.05)  # type: ignore[arg-type]
    sources: tuple[EdgeSource, ...] = (rigid, painted)
    for source in sources:
        before = source.generate(prior_of(view), 200)
        after = source.reproject(view.at_pose(pose), before)
        np.testing.assert_array_equal(after.sample_ids, before.sample_ids)
        np.testing.assert_array_equal(after.weights, before.weights)
        outline = facing(model.edges, eye_position(pose)).outline[before.sample_ids]
        visible = VisibleSamples(before.sample_ids, outline, before.weights)
        expected = project_inset(model.edges, visible, view, pose, inset_mm)
        np.testing.assert_array_equal(after.points, expected.points)
        bare = shown(model, after.sample_ids, pose)
        assert (np.abs(after.points - bare).max() > 0.2) == (broken_mm > 0.0)
        assert np.abs(after.points - before.points).max() > 1.0


def test_outlines_are_drawn_where_a_part_with_broken_edges_shows_them(view: View, model: PreparedPart) -> None:
    """Against a part whose faces all lie 0.2 mm further in: its outline samples are those, moved along the normals."""
    edges = RigidSource(model.best_generator(), 0.2).generate(prior_of(view), 400)
    inner = prepared(bracket(shift=(-400.0, -300.0, -500.0), inset_mm=0.2))
    drawn = RigidSource(inner.best_generator(), 0.0).generate(prior_of(view), 30_000)
    gap = edges.points[edges.outline][:, None] - drawn.points[None]
    off = np.abs(np.einsum("nmj,nj->nm", gap, edges.normals[edges.outline]))
    nearest = np.linalg.norm(gap, axis=2).argmin(1)
    inset_px = 0.2 * CAMERA.fx / 330.0
    # Both faces of an edge lie further in, so an outline seen askew moves by up to 1.4 times as much.
    assert np.median(off[np.arange(len(off)), nearest]) < 0.5 * inset_px
    np.testing.assert_allclose(
        edges.points[~edges.outline], shown(model, edges.sample_ids[~edges.outline], view.prior), rtol=0.0, atol=1e-9
    )


def test_the_flow_through_pnp_agrees_with_differences_of_pnp(view: View, model: PreparedPart) -> None:
    source = RigidSource(model.best_generator(), 0.0)
    start = prior_of(view)
    edges = source.generate(start, 200)
    by_chain, by_differences = (source.flow(start, edges, way) for way in (False, True))
    assert by_chain.shape == (len(edges), 2, 8)
    np.testing.assert_allclose(by_chain, by_differences, atol=0.02)


def test_the_flow_by_a_pose_is_what_projections_do(view: View, model: PreparedPart) -> None:
    ids = RigidSource(model.best_generator(), 0.0).generate(prior_of(view), 50).sample_ids
    flow = pose_flow(view, view.prior, model.edges.points_obj[ids])
    for k in range(6):
        step = 1e-5 * np.eye(6)[k]
        ahead, behind = (
            shown(model, ids, move_pose(view.prior, view.part.box_centre, side * step)) for side in (1.0, -1.0)
        )
        np.testing.assert_allclose(flow[:, :, k], (ahead - behind) / 2e-5, rtol=1e-4, atol=1e-3)


@pytest.mark.parametrize("generator", ["learned", "templates"])
def test_a_missing_generator_names_the_command(model: PreparedPart, generator: str) -> None:
    bare = PreparedPart(model.part, model.edges)
    with pytest.raises(PreparationError, match=f"acp-lab prepare .* --generator {generator}"):
        CadSamples(generator=generator).open(bare, "mid-section")  # type: ignore[arg-type]
    with pytest.raises(PreparationError, match="no generator is prepared"):
        CadSamples().open(bare, "mid-section")
