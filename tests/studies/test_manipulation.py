"""Ways of manipulating edges, against the truth of the CAD model."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from acp_lab.errors import GeometryError
from acp_lab.generator.base import GeneratedEdges
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.homography import apply_homography, homography_from_points
from acp_lab.geometry.pose_step import move_pose
from acp_lab.studies.manipulation import ManipulationBench, ManipulationStudy
from acp_lab.tracking.frame_view import Estimate
from tests.prepared_sample import sample_model, sample_scene


@cache
def bench() -> ManipulationBench:
    scene = sample_scene()
    return ManipulationBench(sample_model(), scene.camera(0), scene.first_pose)


def moved(turn_deg: tuple[float, float, float], shift_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    step = np.concatenate([np.radians(turn_deg), shift_mm])
    return move_pose(bench().reference_pose, sample_model().part.box_centre, step)


def distances(study: ManipulationStudy) -> dict[str, float]:
    return {way.name: way.distance.symmetric for way in study.ways if way.distance is not None}


def test_where_nothing_moves_every_way_is_right() -> None:
    study = bench().study(bench().control_points, bench().reference_pose)
    assert study.misfit_px < 1e-6
    np.testing.assert_allclose(study.cam_T_obj, bench().reference_pose, atol=1e-6)
    found = distances(study)
    assert set(found) == {"homography", "thin-plate spline", "t(I) view templates"}
    assert found["homography"] < 1e-9
    assert found["thin-plate spline"] < 1e-9
    assert found["t(I) view templates"] < 0.2  # the nearest of few views may hide another sample
    assert {way.name: way.is_rigid for way in study.ways}["t(I) view templates"]


def test_a_turn_out_of_the_image_plane_is_more_than_a_homography_can() -> None:
    pose = moved((12.0, 0.0, 0.0))
    study = bench().study(bench().points_at(pose), pose)
    found = distances(study)
    assert study.misfit_px < 1e-6
    assert found["homography"] > 2.0
    assert found["thin-plate spline"] > 2.0
    assert found["t(I) view templates"] < 0.3


def test_the_homography_is_kornias_and_ours() -> None:
    points = bench().control_points + np.array([[8.0, 3], [-5, 9], [4, -6], [7, 2]])
    study = bench().study(points, bench().reference_pose)
    edges = study.ways[0].edges
    ours = apply_homography(homography_from_points(bench().control_points, points), bench().reference.points)
    np.testing.assert_allclose(edges.points, ours, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(edges.tangents, axis=1), 1.0)
    # No rigid part shows these points.
    assert study.misfit_px > 0.5


def test_edges_that_go_to_infinity_are_left_out() -> None:
    """Nearly collinear points put the vanishing line of the homography across the part."""
    camera = Camera(640, 512, 600.0, 600.0, 319.5, 255.5)
    far = ManipulationBench(sample_model(), camera, moved((0.0, 0.0, 0.0)))
    points = far.control_points.copy()
    points[2] = 0.55 * points[1] + 0.5 * points[3] - 0.05 * points[0]
    edges = far.study(points, far.reference_pose).ways[0].edges
    assert np.isfinite(edges.points).all()
    assert np.abs(edges.points).max() < 1e5


def test_an_edge_painter_works_in_the_canonical_frame_of_the_pose_of_the_points() -> None:
    """A painter that knows the answer, in place of the paper's trained network."""
    painted = ManipulationBench(sample_model(), bench().camera, bench().reference_pose)
    seen = []

    class Painter:
        def generate(self, at: Estimate, count: int) -> GeneratedEdges:
            seen.append(at.view)
            return painted.true_edges(at.cam_T_obj)

    painted._painter = Painter()
    pose = moved((0.0, 8.0, 0.0))
    study = painted.study(painted.points_at(pose), pose)
    (way,) = [way for way in study.ways if way.name == "t(I) auto-encoder"]
    assert not way.is_rigid
    assert way.distance.symmetric < 1e-3
    # The canonical frame's homography takes the canonical control points to I, exact at any depth.
    (view,) = seen
    canonical = view.canonical.project(view.points_obj)
    np.testing.assert_allclose(apply_homography(view.image_H_canonical, canonical), painted.points_at(pose), atol=1e-6)


def test_folded_points_are_refused() -> None:
    points = bench().control_points[[0, 2, 1, 3]]
    with pytest.raises(GeometryError, match="folded"):
        bench().study(points, bench().reference_pose)
