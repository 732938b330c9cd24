"""What all edges have in common: how they move in the image when all of them are broken by more."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from acp_lab.cad.edges import sample_edges
from acp_lab.cad.part import Part
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import disturb_pose, transform
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.edge_breaks import BrokenEdges, into_material
from acp_lab.tracking.frame_solver import FrameSolver
from acp_lab.tracking.frame_view import Estimate
from acp_lab.tracking.method import ACP
from acp_lab.tracking.motions import ControlPointVariables
from acp_lab.tracking.schedule import Level
from acp_lab.tracking.solution import SeenFrame
from acp_lab.tracking.stopwatch import Stopwatch
from tests.made_parts import bracket
from tests.tracking.rendered import MadeSequence


@pytest.fixture
def solver(model: PreparedPart) -> FrameSolver:
    return FrameSolver(model, ACP)


@pytest.fixture
def seen(solver: FrameSolver, sequence: MadeSequence) -> SeenFrame:
    (frame,) = sequence.frames(1)
    assert isinstance(frame, Frame)
    found = solver.look(frame.image, frame.camera, sequence.first_pose, solver.choose_region(sequence.first_pose))
    assert found is not None
    return found


@pytest.fixture
def at(seen: SeenFrame) -> Estimate:
    return seen.view.at_pose(seen.view.prior)


def test_broken_edges_lie_in_the_material_and_filled_corners_off_it() -> None:
    part = bracket()
    samples = sample_edges(part)
    into = into_material(samples)
    assert samples.convex.any()
    assert not samples.convex.all()
    np.testing.assert_allclose(np.linalg.norm(into, axis=1), 1.0, atol=1e-9)
    # A little that way and the point lies behind both faces of a convex edge, before both of a concave one.
    heights = np.einsum("nkj,nj->nk", samples.normals_obj, into)
    assert (heights[samples.convex] < 0.0).all()
    assert (heights[~samples.convex] > 0.0).all()


def test_the_rim_of_an_open_mesh_goes_nowhere() -> None:
    part = bracket()
    faces = part.faces[1:]
    samples = sample_edges(Part.from_mesh(part.vertices, faces, "open"))
    rims = np.linalg.norm(samples.off_obj, axis=1) < 1e-9
    assert rims.any()
    assert (into_material(samples)[rims] == 0.0).all()


def test_rows_are_what_projecting_broken_edges_gives(solver: FrameSolver, model: PreparedPart, at: Estimate) -> None:
    edges, into = solver.source.generate(at, 400), into_material(model.edges)
    assert edges.outline.any()
    assert not edges.outline.all()
    turned = np.random.default_rng(5).normal(size=(len(edges), 2))
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    points_obj, camera, step_mm = model.edges.points_obj[edges.sample_ids], at.view.camera, 1e-4

    def projected(by_mm: float) -> FloatArray:
        moved = points_obj + by_mm * into[edges.sample_ids]
        return camera.project(transform(at.cam_T_obj, moved))

    motion = (projected(step_mm) - projected(-step_mm)) / (2.0 * step_mm)
    for directions in (edges.normals, turned):
        rows = BrokenEdges(model.edges, into, at)(edges, directions)
        along = np.einsum("nj,nj->n", motion, directions)
        np.testing.assert_allclose(rows.sum(1), along, atol=1e-6)
        assert (rows[edges.outline, 1] == 0.0).all()
        assert (rows[~edges.outline, 0] == 0.0).all()


def test_edge_points_of_no_known_sample_say_nothing_of_breaks(
    solver: FrameSolver, model: PreparedPart, at: Estimate
) -> None:
    edges = solver.source.generate(at, 400)
    ids = edges.sample_ids.copy()
    ids[::2] = -1
    rows = BrokenEdges(model.edges, into_material(model.edges), at)(replace(edges, sample_ids=ids), edges.normals)
    assert (rows[::2] == 0.0).all()
    assert (rows[1::2] != 0.0).any()


def test_a_solution_knows_breaks_less_than_it_seems(solver: FrameSolver, seen: SeenFrame, at: Estimate) -> None:
    solution = solver.solve(seen, at, Stopwatch())
    assert solution is not None
    assert solution.information is not None
    assert solution.pose_information is not None
    information = solution.information
    np.testing.assert_array_equal(solution.pose_information, information[:6, :6])
    assert information.shape == (8, 8)
    np.testing.assert_allclose(information, information.T, rtol=1e-9)
    np.testing.assert_array_less(0.0, np.linalg.eigvalsh(information))
    # Whoever knows the breaks knows the pose better.
    told = np.diag(np.linalg.inv(information[:6, :6]))
    untold = np.diag(np.linalg.inv(information))[:6]
    assert (untold > told).all()
    assert untold[5] > 1.2 * told[5], "the distance above all"


def test_weighing_gives_what_a_solve_says_where_it_ends(
    solver: FrameSolver, seen: SeenFrame, at: Estimate, part: Part
) -> None:
    start = seen.view.at_pose(disturb_pose(at.cam_T_obj, part.box_centre, 0.2, 0.2, np.random.default_rng(2)))
    solution = solver.solve(seen, start, Stopwatch())
    assert solution is not None
    looked = solver.look_at(seen, solution.estimate, Level(6, 1.0), Stopwatch())
    assert looked is not None
    assert looked.information is None
    weighed = solver.weigh(seen, looked)
    assert weighed.information is not None
    assert solution.information is not None
    # Searched again from where the other ended, so about the same.
    np.testing.assert_allclose(np.diag(weighed.information), np.diag(solution.information), rtol=0.15)
    assert weighed.estimate is looked.estimate


def test_control_points_know_their_breaks_too(model: PreparedPart, sequence: MadeSequence) -> None:
    method = replace(ACP, variables=ControlPointVariables(direction="rigid", residual="homography"), priors=())
    solver = FrameSolver(model, method)
    (frame,) = sequence.frames(1)
    assert isinstance(frame, Frame)
    pose = sequence.first_pose
    seen = solver.look(frame.image, frame.camera, pose, solver.choose_region(pose))
    assert seen is not None
    by_points = solver.solve(seen, seen.view.at_pose(pose), Stopwatch())
    by_pose = FrameSolver(model, replace(ACP, priors=())).solve(seen, seen.view.at_pose(pose), Stopwatch())
    assert by_points is not None
    assert by_pose is not None
    assert by_points.information is not None
    assert by_pose.information is not None
    assert by_points.information.shape == (8, 8)
    np.testing.assert_allclose(np.diag(by_points.information), np.diag(by_pose.information), rtol=0.2)
