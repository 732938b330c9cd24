"""How edges move with the variables: every Jacobian against differences, and against each other."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.cad.edges import facing
from acp_lab.cad.part import Part
from acp_lab.control_points.canonical_frame import canonical_frame, eye_position
from acp_lab.control_points.coplanar_points import mid_section_points
from acp_lab.control_points.view_regions import ALL_REGIONS, choose_region
from acp_lab.errors import GeometryError
from acp_lab.generator.base import GeneratedEdges, VisibleSamples
from acp_lab.generator.painted.edge_points import ridge
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.homography import homography_from_points
from acp_lab.geometry.planar_pnp import solve_planar_pnp
from acp_lab.geometry.pose_step import move_pose
from acp_lab.prepared_part import PreparedPart
from acp_lab.tracking.frame_solver import RigidWish
from acp_lab.tracking.frame_view import EdgeSource, View, pose_flow
from acp_lab.tracking.learning.contour_offsets import ContourOffsets, OffsetConfig
from acp_lab.tracking.motions import HomographyMotion, Motion, RegeneratedMotion, RigidMotion
from acp_lab.tracking.sources.lift import EdgeLifter
from acp_lab.tracking.sources.painted import RidgeSource, SampleSource, view_to_canonical
from acp_lab.tracking.sources.rigid import RigidEdgeSource, project_with_offsets
from tests.made_parts import looking_at
from tests.tracking.rendered import CAMERA

NUDGE_PX = 1e-3


def make_view(part: Part, cam_T_obj: FloatArray) -> View:
    region = ALL_REGIONS[choose_region(eye_position(cam_T_obj) - part.box_centre, 0.5 * part.box_size)]
    frame = canonical_frame(eye_position(cam_T_obj), part.box_centre, part.radius, region)
    w = mid_section_points(part.box_min, part.box_max, region.axis)
    return View(CAMERA, cam_T_obj, region.index, w, part.box_centre, frame, frame.homography_to(CAMERA, cam_T_obj))


@pytest.fixture
def view(part: Part) -> View:
    return make_view(part, looking_at(part, np.array([0.8, 0.6, 1.0]), 330.0, 0.3))


@pytest.fixture
def source(model: PreparedPart) -> RigidEdgeSource:
    generator = model.best_generator()
    return RigidEdgeSource(generator, ContourOffsets(generator.edges, model.part.diameter, 0.0, OffsetConfig()), 200)


def differences(motion: Motion, variables: FloatArray, size: int, step: float) -> FloatArray:
    columns = []
    for k in range(size):
        nudge = np.zeros(size)
        nudge[k] = step
        ahead, behind = (motion.edges(motion.moved(variables, sign * nudge)).points for sign in (1.0, -1.0))
        columns.append((ahead - behind) / (2.0 * step))
    return np.stack(columns, 2)


def test_the_homography_moves_edges_as_its_jacobian_says(view: View, source: EdgeSource) -> None:
    start = view.project(view.prior)
    motion = HomographyMotion(source.generate(view, start), start)
    there = start + np.array([[1.0, -2.0], [0.5, 1.0], [-1.5, 0.0], [2.0, 1.0]])
    edges, jacobian = motion.linearised(there)
    np.testing.assert_array_equal(edges.points, motion.edges(there).points)
    np.testing.assert_allclose(jacobian, differences(motion, there, 8, NUDGE_PX), atol=1e-5)
    # Each control point carries the edges: four corners that move alike move everything alike.
    shifted = motion.edges(start + np.array([3.0, -1.0])).points
    np.testing.assert_allclose(shifted, motion.edges(start).points + np.array([3.0, -1.0]), atol=1e-9)


def test_tangents_go_with_the_homography(view: View, source: EdgeSource) -> None:
    start = view.project(view.prior)
    edges = source.generate(view, start)
    quarter = np.array([[0.0, -1.0], [1.0, 0.0]])
    centre = start.mean(0)
    turned = HomographyMotion(edges, start).edges((start - centre) @ quarter + centre)
    np.testing.assert_allclose(turned.tangents, edges.tangents @ quarter, atol=1e-6)


def test_a_pose_moves_lifted_edges_as_its_jacobian_says(view: View, source: EdgeSource, model: PreparedPart) -> None:
    edges = source.generate(view, view.project(view.prior))
    points_obj = EdgeLifter(model.part, model.edges).lift(edges, view.prior, CAMERA)
    motion = RigidMotion(edges, points_obj, view, view.prior)
    there = move_pose(view.prior, view.centre_obj, np.array([0.01, -0.02, 0.01, 0.5, 0.3, -1.0]))
    _, found = motion.linearised(there)
    np.testing.assert_allclose(found, differences(motion, there, 6, 1e-5), rtol=1e-4, atol=1e-3)


def test_lifted_edges_are_where_the_generator_has_them(view: View, source: EdgeSource, model: PreparedPart) -> None:
    edges = source.generate(view, view.project(view.prior))
    painted = GeneratedEdges(edges.points, edges.tangents, edges.weights, np.full(len(edges), -1))
    lifted = EdgeLifter(model.part, model.edges).lift(painted, view.prior, CAMERA)
    known = np.isfinite(lifted).all(1)
    assert known.mean() > 0.9
    exact = model.edges.points_obj[edges.sample_ids[known]]
    # Crossing edges are near in the image and far in space; few samples lie there.
    assert np.quantile(np.linalg.norm(lifted[known] - exact, axis=1), 0.9) < 0.02 * model.part.diameter


def test_edges_far_from_the_part_are_not_lifted(view: View, model: PreparedPart) -> None:
    stray = GeneratedEdges(np.array([[2.0, 2.0]]), np.array([[1.0, 0.0]]), np.ones(1), np.array([-1]))
    assert np.isnan(EdgeLifter(model.part, model.edges).lift(stray, view.prior, CAMERA)).all()


def test_the_prior_needs_no_pnp(view: View) -> None:
    found = solve_planar_pnp(view.points_obj, view.prior_points, CAMERA).nearest(view.prior)
    np.testing.assert_allclose(found, view.prior, atol=1e-5)
    assert view.pose(view.prior_points) is view.prior
    assert view.pose(view.prior_points + 0.1) is not view.prior


def test_the_flow_through_pnp_agrees_with_differences_of_pnp(view: View, source: RigidEdgeSource) -> None:
    start = view.project(view.prior)
    edges = source.generate(view, start)
    by_chain = source.flow(view, start, edges, by_differences=False)
    by_differences = source.flow(view, start, edges, by_differences=True)
    np.testing.assert_allclose(by_chain, by_differences, atol=0.02)


def test_the_flow_along_rigid_motions_is_the_rigid_motion(
    view: View, source: RigidEdgeSource, model: PreparedPart
) -> None:
    start = view.project(view.prior)
    edges = source.generate(view, start)
    _, flow = RegeneratedMotion(source, view, by_differences=False).linearised(start)
    rigid = pose_flow(view, view.prior, model.edges.points_obj[edges.sample_ids])
    np.testing.assert_allclose(flow @ view.control_jacobian(view.prior), rigid, atol=1e-6)


class PaintedLines:
    """An image generator of which all is known: two soft lines through the control points' midpoints."""

    regions = tuple(range(6))

    def edge_images(self, points: FloatArray, region: int, point_set: str = "regressed") -> FloatArray:
        return np.stack([self.edge_image(p, region, point_set) for p in points])

    def edge_image(self, points: FloatArray, region: int, point_set: str = "regressed") -> FloatArray:
        y, x = np.mgrid[:128, :128].astype(np.float64)
        upright = points[:, 0].mean() + 0.2 * (y - 63.5) / 64.0 * (points[1, 0] - points[0, 0])
        level = points[:, 1].mean()
        near = np.minimum(np.abs(x - upright), np.abs(y - level))
        image: FloatArray = np.exp(-0.5 * (near / 1.0) ** 2).astype(np.float32)
        return image

    def edge_image_derivatives(self, points: FloatArray, region: int, point_set: str) -> tuple[FloatArray, FloatArray]:
        nudges = np.eye(8).reshape(8, 4, 2) * 1e-2
        ahead, behind = (self.edge_images(points + side * nudges, region) for side in (1.0, -1.0))
        return self.edge_image(points, region), np.moveaxis(ahead - behind, 0, -1) / 2e-2


@pytest.mark.parametrize("by_differences", [False, True])
def test_painted_edges_come_to_the_image_and_flow_with_the_control_points(view: View, by_differences: bool) -> None:
    source = RidgeSource(PaintedLines(), "regressed", ridge, 0.3, 400)  # type: ignore[arg-type]
    start = view.project(view.prior)
    edges = source.generate(view, start)
    flow = source.flow(view, start, edges, by_differences)
    assert flow.shape == (len(edges), 2, 8)
    # The whole quad shifted: each painted line goes along, as far as it is free to.
    shift = np.array([0.6, -0.4])
    moved = source.generate(view, start + shift)
    across = (edges.normals * (flow @ np.tile(shift, 4))).sum(1)
    pairs = np.linalg.norm(edges.points[:, None] - moved.points[None], axis=2)
    row = pairs.argmin(1)
    # Along each normal to the line through the nearest moved point.
    gap, along = moved.points[row] - edges.points, moved.tangents[row]
    seen = (gap[:, 0] * along[:, 1] - gap[:, 1] * along[:, 0]) / (
        edges.normals[:, 0] * along[:, 1] - edges.normals[:, 1] * along[:, 0]
    )
    # Where the lines cross they have no motion of their own; elsewhere both agree.
    known = np.isfinite(across)
    assert known.mean() > 0.8
    # A ridge's sub-pixel place is off by up to a tenth of a pixel, and so is where it seems to go.
    assert np.median(np.abs(across - seen)[known]) < 0.15
    assert (np.abs(across - seen)[known] < 0.3).mean() > 0.9
    assert np.abs(seen[known]).mean() > 0.4
    assert np.abs(seen).max() > 0.3


def test_painted_points_lie_on_the_ridges(view: View) -> None:
    source = RidgeSource(PaintedLines(), "regressed", ridge, 0.3, 100_000)  # type: ignore[arg-type]
    start = view.project(view.prior)
    canonical = view.canonical.project(view.points_obj)
    found = ridge(PaintedLines().edge_image(canonical, 0).astype(np.float32), 0.3)
    edges = source.generate(view, start)
    assert len(edges) == len(found)
    back = homography_from_points(start, canonical)
    rows = np.column_stack([edges.points, np.ones(len(edges))]) @ back.T
    np.testing.assert_allclose(rows[:, :2] / rows[:, 2:], found.points, atol=1e-3)


def test_settled_edges_are_the_same_samples_at_the_pose(view: View, model: PreparedPart) -> None:
    # Broken edges, so that samples have offsets, and a pose from which another face is the outline's outer one.
    offsets = ContourOffsets(model.edges, model.part.diameter, 0.8, OffsetConfig())
    pose = move_pose(view.prior, view.centre_obj, np.array([0.05, -0.08, 0.06, 2.0, -1.0, 3.0]))
    start, points = view.prior_points, view.project(pose)
    rigid = RigidEdgeSource(model.best_generator(), offsets, 200)
    painted = SampleSource(LeftHalf(), "regressed", offsets, 0.05, 300)  # type: ignore[arg-type]
    for source in (rigid, painted):
        before = source.generate(view, start)
        after = source.settled(view, points, pose, before)
        np.testing.assert_array_equal(after.sample_ids, before.sample_ids)
        np.testing.assert_array_equal(after.weights, before.weights)
        outline = facing(model.edges, eye_position(pose)).outline[before.sample_ids]
        visible = VisibleSamples(before.sample_ids, outline, before.weights)
        expected = project_with_offsets(offsets, visible, view, pose)
        np.testing.assert_array_equal(after.points, expected.points)
        bare = CAMERA.project(model.edges.points_obj[after.sample_ids] @ pose[:3, :3].T + pose[:3, 3])
        assert np.abs(after.points - bare).max() > 0.2
        assert np.abs(after.points - before.points).max() > 1.0


def test_settled_ridges_are_painted_anew(view: View) -> None:
    source = RidgeSource(PaintedLines(), "regressed", ridge, 0.3, 400)  # type: ignore[arg-type]
    before = source.generate(view, view.prior_points)
    points = view.prior_points + np.array([0.6, -0.4])
    after = source.settled(view, points, view.prior, before)
    np.testing.assert_array_equal(after.points, source.generate(view, points).points)


def test_the_rigid_wish_sees_what_no_rigid_motion_makes(view: View, rng: np.random.Generator) -> None:
    start = view.project(view.prior)
    wish = RigidWish.at(view, start, 1.0)
    np.testing.assert_allclose(wish.jacobian @ wish.jacobian.T, np.eye(2), atol=1e-9)
    np.testing.assert_allclose(wish.residual(start), 0.0, atol=1e-3)
    for step in rng.normal(size=(10, 6)) * ([0.002] * 3 + [0.1] * 3):
        moved = view.project(move_pose(view.prior, view.centre_obj, step))
        assert np.abs(wish.residual(moved)).max() < 0.02 * np.abs(moved - start).max()
    bent = start + np.array([[1.0, 0.0], [-1.0, 0.0], [1.0, 0.0], [-1.0, 0.0]])
    assert np.linalg.norm(wish.residual(bent)) > 0.5


def test_degenerate_control_points_are_refused(view: View, source: EdgeSource) -> None:
    start = view.project(view.prior)
    flat = np.column_stack([start[:, 0], np.full(4, 50.0)])
    with pytest.raises(GeometryError):
        source.generate(view, flat)
    with pytest.raises(GeometryError):
        HomographyMotion(source.generate(view, start), start).edges(flat)


class LeftHalf:
    """An image generator that paints everything left of the middle of the canonical frame, and nothing else."""

    regions = tuple(range(6))

    def edge_image(self, points: FloatArray, region: int, point_set: str = "regressed") -> FloatArray:
        image = np.zeros((128, 128), np.float32)
        image[:, :64] = 1.0
        return image


def test_a_painted_image_chooses_among_the_samples_of_the_model(view: View, model: PreparedPart) -> None:
    offsets = ContourOffsets(model.edges, model.part.diameter, 0.0, OffsetConfig())
    source = SampleSource(LeftHalf(), "regressed", offsets, 0.05, 300)  # type: ignore[arg-type]
    start = view.project(view.prior)
    edges = source.generate(view, start)
    assert 50 < len(edges) <= 300
    assert view_to_canonical(view, edges.points)[:, 0].max() < 64.0
    # Where they are is the model's affair alone.
    points_cam = model.edges.points_obj[edges.sample_ids] @ view.prior[:3, :3].T + view.prior[:3, 3]
    np.testing.assert_allclose(edges.points, CAMERA.project(points_cam), atol=1e-3)
    by_chain, by_differences = (source.flow(view, start, edges, way) for way in (False, True))
    np.testing.assert_allclose(by_chain, by_differences, atol=0.02)
