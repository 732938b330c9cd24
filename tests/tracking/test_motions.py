"""How edges move with the variables: every Jacobian against differences, and against each other."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from acp_lab.cad.part import Part
from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.errors import GeometryError, TrackingError
from acp_lab.generator.base import GeneratedEdges
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import transform
from acp_lab.geometry.pose_step import move_pose
from acp_lab.prepared_part import PreparedPart
from acp_lab.tracking.frame_view import Estimate, View
from acp_lab.tracking.method import METHODS
from acp_lab.tracking.motions import (
    ControlPointVariables,
    HomographyMotion,
    NeighbourMotion,
    PoseVariables,
    RegeneratedMotion,
    RigidMotion,
)
from acp_lab.tracking.solvers import Problem, WeightedMeasure
from acp_lab.tracking.sources.lift import EdgeLifter
from acp_lab.tracking.sources.rigid import RigidSource, pose_flow
from tests.made_parts import looking_at
from tests.tracking.rendered import CAMERA
from tests.tracking.views import differences, prior_of, view_at

NUDGE_PX = 1e-3
# A few degrees and millimetres away from the start of a level.
ASIDE = np.array([0.04, -0.05, 0.03, 2.0, 1.5, -6.0])


@pytest.fixture
def view(part: Part) -> View:
    return view_at(part, looking_at(part, np.array([0.8, 0.6, 1.0]), 330.0, 0.3))


@pytest.fixture
def start(view: View) -> Estimate:
    return prior_of(view)


@pytest.fixture
def source(model: PreparedPart) -> RigidSource:
    return RigidSource(model.best_generator(), 0.0)


@pytest.fixture
def edges(source: RigidSource, start: Estimate) -> GeneratedEdges:
    return source.generate(start, 200)


@pytest.fixture
def lifter(model: PreparedPart) -> EdgeLifter:
    return EdgeLifter(model.part, model.edges)


def rows_along(points: FloatArray, directions: FloatArray) -> FloatArray:
    """(n, k) motion along directions (n, 2) from the motion of points (n, 2, k)."""
    return np.einsum("nj,njk->nk", directions, points)


def any_directions(count: int) -> FloatArray:
    angles = np.random.default_rng(4).uniform(0.0, 2.0 * np.pi, count)
    return np.column_stack([np.cos(angles), np.sin(angles)])


# ---- control points ------------------------------------------------------------------------------------------


def test_the_homography_moves_edges_as_its_rows_say(start: Estimate, edges: GeneratedEdges) -> None:
    motion = HomographyMotion(edges, start.control_points)
    there = motion.moved(start, np.array([1.0, -2.0, 0.5, 1.0, -1.5, 0.0, 2.0, 1.0]))
    at, rows = motion.linearised(there)
    np.testing.assert_array_equal(at.points, motion.edges(there).points)
    directions = any_directions(len(edges))
    expected = rows_along(differences(motion, there, 8, NUDGE_PX), directions)
    np.testing.assert_allclose(rows(directions), expected, atol=1e-5)
    # Each control point carries the edges: four corners that move alike move everything alike.
    shifted = motion.edges(motion.moved(start, np.tile([3.0, -1.0], 4))).points
    np.testing.assert_allclose(shifted, motion.edges(start).points + np.array([3.0, -1.0]), atol=1e-9)


def test_tangents_go_with_the_homography(view: View, start: Estimate, edges: GeneratedEdges) -> None:
    quarter = np.array([[0.0, -1.0], [1.0, 0.0]])
    points = start.control_points
    turned = view.at_points((points - points.mean(0)) @ quarter + points.mean(0))
    found = HomographyMotion(edges, points).edges(turned)
    np.testing.assert_allclose(found.tangents, edges.tangents @ quarter, atol=1e-6)


def test_a_step_of_control_points_is_added(start: Estimate, edges: GeneratedEdges) -> None:
    moved = HomographyMotion(edges, start.control_points).moved(start, np.arange(8.0))
    np.testing.assert_array_equal(moved.control_points, start.control_points + np.arange(8.0).reshape(4, 2))
    assert moved.pose is None, "the pose of a free I is PnP's"


def test_the_flow_along_rigid_motions_is_the_rigid_motion(
    view: View, start: Estimate, source: RigidSource, model: PreparedPart
) -> None:
    edges, rows = RegeneratedMotion(source, 200, by_differences=False).linearised(start)
    rigid = pose_flow(view, view.prior, model.edges.points_obj[edges.sample_ids])
    along = rows(edges.normals) @ view.control_jacobian(view.prior)
    np.testing.assert_allclose(along, rows_along(rigid, edges.normals), atol=1e-6)


@pytest.mark.parametrize("by_differences", [False, True])
def test_regenerated_edges_move_as_their_rows_say(start: Estimate, source: RigidSource, by_differences: bool) -> None:
    """Through PnP, whose choice of a rigid motion differs a little between the two."""
    motion = RegeneratedMotion(source, 60, by_differences)
    edges, rows = motion.linearised(start)
    np.testing.assert_array_equal(edges.points, source.generate(start, 60).points)
    expected = differences(motion, start, 8, 0.05)
    np.testing.assert_allclose(rows(edges.normals), rows_along(expected, edges.normals), atol=0.02)


def test_degenerate_control_points_are_refused(
    view: View, start: Estimate, source: RigidSource, edges: GeneratedEdges
) -> None:
    flat = view.at_points(np.column_stack([start.control_points[:, 0], np.full(4, 50.0)]))
    with pytest.raises(GeometryError):
        source.generate(flat, 200)
    with pytest.raises(GeometryError):
        HomographyMotion(edges, start.control_points).edges(flat)


# ---- control points, edges beside their rigid neighbour ---------------------------------------------------------


@pytest.mark.parametrize(("pull_px", "close"), [(0.0, 1e-3), (0.5, 0.03), (2.0, 0.12)])
def test_edges_follow_the_rigid_neighbour_as_their_rows_say(
    view: View, start: Estimate, source: RigidSource, lifter: EdgeLifter, pull_px: float, close: float
) -> None:
    """Exact where I is rigid, to first order in what is not."""
    variables = ControlPointVariables(direction="rigid", residual="homography")
    pull = pull_px * np.array([[1.0, -0.5], [-0.4, 0.7], [0.2, 0.9], [-0.8, -0.3]])
    at = view.at_points(start.control_points + pull)
    whole = variables.around(source)
    generated = whole.generate(at, 200)
    motion = variables.motion(whole, generated, at, lifter, 200)
    edges, rows = motion.linearised(at)
    np.testing.assert_allclose(edges.points, generated.points, atol=1e-6)
    np.testing.assert_allclose(edges.tangents, generated.tangents, atol=1e-6)
    np.testing.assert_array_equal(motion.kept(generated).sample_ids, generated.sample_ids)
    directions = any_directions(len(edges))
    expected = rows_along(differences(motion, at, 8, NUDGE_PX), directions)
    assert np.abs(rows(directions) - expected).max() < close * np.abs(expected).max()
    # A step takes them where the source would draw the same samples.
    there = motion.moved(at, np.array([1.0, -2.0, 0.5, 1.0, -1.5, 0.0, 2.0, 1.0]))
    np.testing.assert_allclose(motion.edges(there).points, whole.reproject(there, generated).points, atol=1e-6)
    # Its pose goes on from the one before the step, and is that of planar PnP.
    assert there.near is at.cam_T_obj
    np.testing.assert_allclose(there.cam_T_obj, view.at_points(there.control_points).cam_T_obj, atol=1e-3)


def test_rigid_where_i_moves_like_a_part_and_a_homography_beside_that(
    view: View, start: Estimate, edges: GeneratedEdges, lifter: EdgeLifter, model: PreparedPart
) -> None:
    free = view.at_points(start.control_points)
    _, rows = NeighbourMotion(edges, free, lifter).linearised(free)
    directions = any_directions(len(edges))
    rigid = rows_along(pose_flow(view, view.prior, model.edges.points_obj[edges.sample_ids]), directions)
    by_pose = view.control_jacobian(view.prior)
    np.testing.assert_allclose(rows(directions) @ by_pose, rigid, rtol=1e-5, atol=1e-3)
    basis, _ = np.linalg.qr(by_pose, mode="complete")
    homography = HomographyMotion(edges, start.control_points).linearised(start)[1](directions)
    np.testing.assert_allclose((rows(directions) - homography) @ basis[:, 6:], 0.0, atol=1e-5)
    assert np.abs((rows(directions) - homography) @ basis[:, :6]).max() > 0.05


def test_a_tilt_takes_edges_off_the_plane_elsewhere_than_a_homography(
    view: View, start: Estimate, source: RigidSource, edges: GeneratedEdges, lifter: EdgeLifter
) -> None:
    tilted = view.at_pose(move_pose(view.prior, view.part.box_centre, np.array([0.08, 0.05, 0.0, 0.0, 0.0, 0.0])))
    there = view.at_points(tilted.control_points)
    expected = source.reproject(tilted, edges).points
    found = NeighbourMotion(edges, start, lifter).edges(there).points
    np.testing.assert_allclose(found, expected, atol=1e-2)
    by_homography = HomographyMotion(edges, start.control_points).edges(there).points
    assert np.abs(by_homography - expected).max() > 1.0


def test_only_points_near_the_cad_follow_a_rigid_neighbour(
    view: View, start: Estimate, edges: GeneratedEdges, lifter: EdgeLifter
) -> None:
    """Painted points have no samples: those far from any edge of the CAD are inventions and stay out."""
    painted = GeneratedEdges(edges.points + 0.3, edges.tangents, edges.weights, np.full(len(edges), -1))
    astray = np.arange(0, len(edges), 5)
    painted.points[astray] = np.array([3.0, 4.0]) + 0.01 * astray[:, None]
    motion = NeighbourMotion(painted, view.at_points(start.control_points), lifter)
    kept = motion.kept(painted)
    np.testing.assert_allclose(kept.points, np.delete(painted.points, astray, 0), atol=1e-6)
    assert motion.linearised(start)[1](kept.normals).shape == (len(kept), 8)


@pytest.mark.parametrize("share", [0.0, 1e-12, 1e-6, 1e-3])
def test_nearly_collinear_control_points_give_finite_rows_or_are_refused(
    share: float, view: View, start: Estimate, edges: GeneratedEdges, lifter: EdgeLifter
) -> None:
    motion = NeighbourMotion(edges, start, lifter)
    points = start.control_points
    flat = view.at_points(points.mean(0) + (points - points.mean(0)) * np.array([1.0, share]))
    try:
        moved, rows = motion.linearised(flat)
    except GeometryError:
        assert share < 0.1
    else:
        assert share > 0.0
        assert np.isfinite(moved.points).all()
        assert np.isfinite(rows(moved.normals)).all()


# ---- a pose --------------------------------------------------------------------------------------------------


def test_a_pose_moves_lifted_edges_as_its_rows_say(
    view: View, start: Estimate, edges: GeneratedEdges, lifter: EdgeLifter
) -> None:
    motion = RigidMotion(edges, lifter.lift(edges, start), start)
    there = motion.moved(start, ASIDE)
    np.testing.assert_array_equal(there.cam_T_obj, move_pose(view.prior, view.part.box_centre, ASIDE))
    directions = any_directions(len(edges))
    _, rows = motion.linearised(there)
    expected = rows_along(differences(motion, there, 6, 1e-5), directions)
    np.testing.assert_allclose(rows(directions), expected, rtol=1e-4, atol=1e-3)


def test_rows_of_a_level_are_those_of_its_start(start: Estimate, edges: GeneratedEdges, lifter: EdgeLifter) -> None:
    points_obj = lifter.lift(edges, start)
    by_step, by_level = (RigidMotion(edges, points_obj, start, per_level) for per_level in (False, True))
    there = by_level.moved(start, ASIDE)
    first, second = any_directions(len(edges)), edges.normals
    at_start = differences(by_level, start, 6, 1e-5)
    for directions in (first, second, first):  # asked for in turn, as two measures of one problem do
        found = by_level.linearised(there)[1](directions)
        np.testing.assert_allclose(found, rows_along(at_start, directions), rtol=1e-4, atol=1e-3)
        assert np.abs(found - by_step.linearised(there)[1](directions)).max() > 0.1
    # Where the edges are is not linearised.
    np.testing.assert_array_equal(by_level.edges(there).points, by_step.edges(there).points)


def test_what_the_lift_moved_an_edge_point_by_stays_with_it(
    view: View, start: Estimate, edges: GeneratedEdges, model: PreparedPart
) -> None:
    """A painted point is half a pixel from the CAD's edge that it is lifted to; its level starts where it was."""
    painted = GeneratedEdges(
        edges.points + np.array([0.6, -0.4]), edges.tangents, edges.weights, np.full(len(edges), -1)
    )
    points_obj = model.edges.points_obj[edges.sample_ids]
    motion = RigidMotion(painted, points_obj, start)
    np.testing.assert_allclose(motion.edges(start).points, painted.points, atol=1e-9)
    there = motion.moved(start, ASIDE)
    bare = CAMERA.project(transform(there.cam_T_obj, points_obj))
    np.testing.assert_allclose(motion.edges(there).points, bare + np.array([0.6, -0.4]), atol=1e-9)


@pytest.mark.parametrize("inset_mm", [0.0, 0.3])
def test_edges_of_a_level_move_on_from_where_the_source_drew_them(
    start: Estimate, model: PreparedPart, lifter: EdgeLifter, inset_mm: float
) -> None:
    """Outlines that are drawn inside the CAD's stay inside; without insets nothing is added to the projection."""
    source = RigidSource(model.best_generator(), inset_mm)
    edges = source.generate(start, 200)
    motion = PoseVariables().motion(source, edges, start, lifter, 200)
    near = motion.moved(start, 0.02 * ASIDE)
    np.testing.assert_allclose(motion.edges(start).points, edges.points, atol=1e-9)
    np.testing.assert_allclose(motion.edges(near).points, source.reproject(near, edges).points, atol=0.02)
    bare = CAMERA.project(transform(near.cam_T_obj, model.edges.points_obj[edges.sample_ids]))
    assert (np.abs(motion.edges(near).points - bare).max() > 0.2) == (inset_mm > 0.0)


def test_edges_without_a_3d_point_are_left_out(start: Estimate, edges: GeneratedEdges, lifter: EdgeLifter) -> None:
    points_obj = lifter.lift(edges, start).copy()
    points_obj[::3] = np.nan
    kept = np.delete(np.arange(len(edges)), np.s_[::3])
    motion = RigidMotion(edges, points_obj, start)
    np.testing.assert_allclose(motion.edges(start).points, edges.points[kept], atol=1e-9)
    assert motion.linearised(start)[1](edges.normals[kept]).shape == (len(kept), 6)


# ---- variables -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("linearise", ["step", "level"])
def test_variables_choose_their_motion(
    start: Estimate, source: RigidSource, edges: GeneratedEdges, lifter: EdgeLifter, linearise: str
) -> None:
    by_pose = PoseVariables(linearise=linearise).motion(source, edges, start, lifter, 200)  # type: ignore[arg-type]
    there = by_pose.moved(start, ASIDE)
    at_start, at_there = (by_pose.linearised(at)[1](edges.normals) for at in (start, there))
    assert (np.abs(at_there - at_start).max() < 1e-9) == (linearise == "level")
    for direction, kind in (
        ("homography", HomographyMotion),
        ("rigid", NeighbourMotion),
        ("autograd", RegeneratedMotion),
        ("differences", RegeneratedMotion),
    ):
        variables = ControlPointVariables(direction=direction)  # type: ignore[arg-type]
        assert type(variables.motion(source, edges, start, lifter, 200)) is kind


def test_the_control_points_follow_a_pose_as_their_jacobian_says(view: View, start: Estimate) -> None:
    found = PoseVariables().control_jacobian(start)
    assert found.shape == (8, 6)
    for k in range(6):
        step = 1e-5 * np.eye(6)[k]
        ahead, behind = (
            view.at_pose(move_pose(view.prior, view.part.box_centre, side * step)).control_points
            for side in (1.0, -1.0)
        )
        np.testing.assert_allclose(found[:, k], (ahead - behind).ravel() / 2e-5, rtol=1e-5, atol=1e-3)
    np.testing.assert_array_equal(ControlPointVariables().control_jacobian(start), np.eye(8))


def test_one_unit_of_each_pose_variable_moves_the_rim_by_about_a_pixel(view: View, start: Estimate) -> None:
    scale = PoseVariables().scale(view)
    assert isinstance(scale, np.ndarray)
    part = view.part
    ends = part.box_centre + 0.5 * part.diameter * np.concatenate([np.eye(3), -np.eye(3)]) @ view.prior[:3, :3]
    there = CAMERA.project(transform(view.prior, ends))
    for k in range(5):  # the sixth is along the line of sight and moves the rim by a fraction
        step = np.zeros(6)
        step[k] = scale[k]
        moved = CAMERA.project(transform(move_pose(view.prior, part.box_centre, step), ends))
        assert 0.5 < np.linalg.norm(moved - there, axis=1).max() < 1.5
    assert ControlPointVariables().scale(view) == 1.0


# ---- what the image says of a pose ---------------------------------------------------------------------------


def test_what_is_known_of_control_points_is_known_of_the_pose(view: View, rng: np.random.Generator) -> None:
    """On the plane of W the homography moves edges as the pose does, so both variables say the same of a pose."""
    corners = view.points_obj
    shares = rng.uniform(-0.2, 1.2, (40, 2))
    points_obj = corners[0] + shares @ (corners[[1, 3]] - corners[0])
    start = prior_of(view)
    none = np.zeros(40)
    edges = GeneratedEdges(view.camera.project(transform(view.prior, points_obj)), any_directions(40), none, none)
    weights = rng.uniform(0.1, 1.0, 40)

    @dataclass(frozen=True)
    class Said:
        residuals: FloatArray
        directions: FloatArray
        weights: FloatArray
        loss: float

    def measure(seen: GeneratedEdges) -> Said:
        return Said(none, edges.normals, weights, 0.0)

    def beside(seen: GeneratedEdges, directions: FloatArray) -> FloatArray:
        return shares

    found, together = [], []
    for variables, motion in (
        (ControlPointVariables(), HomographyMotion(edges, start.control_points)),
        (PoseVariables(), RigidMotion(edges, points_obj, start)),
    ):
        problem = Problem(motion, [WeightedMeasure(measure, 3.0)])  # type: ignore[arg-type]
        found.append(variables.pose_information(problem.information(start).matrix, start))
        together.append(variables.pose_information(problem.information(start, beside).matrix, start))
    np.testing.assert_allclose(found[0], found[1], rtol=1e-6, atol=1e-6 * np.abs(found[1]).max())
    # Of what is unknown beside the pose they say the same, too.
    np.testing.assert_allclose(together[0], together[1], rtol=1e-6, atol=1e-6 * np.abs(found[1]).max())
    np.testing.assert_allclose(together[1][:6, :6], found[1], rtol=1e-12)
    np.testing.assert_allclose(together[1][6:, 6:], shares.T @ (3.0 * weights[:, None] * shares), rtol=1e-9)
    rows = pose_flow(view, view.prior, points_obj)
    along = rows_along(rows, edges.normals)
    np.testing.assert_allclose(found[1], along.T @ (3.0 * weights[:, None] * along), rtol=1e-9)
    # From a pose step to I and back.
    by_points = ControlPointVariables().pose_jacobian(start) @ PoseVariables().control_jacobian(start)
    np.testing.assert_allclose(by_points, PoseVariables().pose_jacobian(start), atol=1e-9)


# ---- lengths -------------------------------------------------------------------------------------------------


def painted(edges: GeneratedEdges) -> GeneratedEdges:
    """The same edges, as a painting knows them: of no sample."""
    return replace(edges, sample_ids=np.full(len(edges), -1, np.int64))


def foreshortening(start: Estimate, edges: GeneratedEdges, model: PreparedPart) -> FloatArray:
    """(n,) mm on the part per mm across the line of sight, by the projection of a short piece of each edge."""
    eye_obj = eye_position(start.cam_T_obj)
    rays = model.edges.points_obj[edges.sample_ids] - eye_obj
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    along = model.edges.tangents_obj[edges.sample_ids]
    across = along - np.einsum("ij,ij->i", rays, along)[:, None] * rays
    return 1.0 / np.linalg.norm(across, axis=1)


@pytest.mark.parametrize(("eye", "most"), [((0.8, 0.6, 1.0), 1.3), ((0.05, 0.1, 1.0), 3.0)])
def test_painted_edges_count_by_their_length_on_the_part(
    eye: tuple[float, float, float],
    most: float,
    part: Part,
    source: RigidSource,
    lifter: EdgeLifter,
    model: PreparedPart,
) -> None:
    """From nearly above, upright edges are seen nearly end-on, and the weight has a limit."""
    start = prior_of(view_at(part, looking_at(part, np.array(eye), 330.0, 0.3)))
    edges = source.generate(start, 400)
    expected = foreshortening(start, edges, model)
    assert expected.max() > most, "some edges are foreshortened"
    counted = lifter.by_length_on_part(painted(edges), edges.sample_ids, start)
    np.testing.assert_allclose(counted.weights, edges.weights * np.minimum(expected, 3.0), rtol=1e-6)
    np.testing.assert_array_equal(counted.points, edges.points)


def test_samples_and_edges_of_no_sample_count_as_before(
    start: Estimate, edges: GeneratedEdges, lifter: EdgeLifter
) -> None:
    """Samples of the CAD model are spread by length on the part already."""
    np.testing.assert_array_equal(lifter.by_length_on_part(edges, edges.sample_ids, start).weights, edges.weights)
    unknown = np.full(len(edges), -1, np.int64)
    np.testing.assert_array_equal(lifter.by_length_on_part(painted(edges), unknown, start).weights, edges.weights)


@pytest.mark.parametrize(
    "variables", [ControlPointVariables("rigid", residual="homography"), PoseVariables(), PoseVariables("level")]
)
def test_motions_weigh_painted_edges_when_asked(
    variables: ControlPointVariables | PoseVariables,
    start: Estimate,
    source: RigidSource,
    edges: GeneratedEdges,
    lifter: EdgeLifter,
) -> None:
    seen = painted(edges)
    plain, weighed = (
        replace(variables, lengths=lengths).motion(source, seen, start, lifter, 200).kept(seen)
        for lengths in ("image", "part")
    )
    np.testing.assert_allclose(weighed.points, plain.points)
    ratios = weighed.weights / plain.weights
    assert ratios.min() >= 1.0 - 1e-9
    assert 1.3 < ratios.max() <= 3.0 + 1e-9
    asked = lifter.by_length_on_part(seen, lifter.samples(seen, start), start).weights
    known = np.isfinite(lifter.lift(seen, start)).all(1)
    np.testing.assert_allclose(weighed.weights, asked[known], rtol=1e-3)


def test_lengths_on_the_part_need_the_cad_edge_of_an_edge_point() -> None:
    """A homography of painted ridges knows none; a rigid direction and samples of the CAD model do."""
    paper = METHODS["acp-paper"]
    assert isinstance(paper.variables, ControlPointVariables)
    by_homography = replace(paper.variables, direction="homography")
    with pytest.raises(TrackingError, match=r"variables\.lengths.*direction = \"rigid\", or lengths = \"image\""):
        replace(paper, variables=by_homography)
    for good in (
        {"variables": replace(by_homography, lengths="image")},
        {"variables": PoseVariables(lengths="part")},
        {"source": METHODS["acp"].source, "variables": by_homography},
    ):
        assert replace(paper, **good) != paper  # type: ignore[arg-type]
