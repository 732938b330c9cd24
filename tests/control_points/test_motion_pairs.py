"""Motion pairs: the asked motion exactly, the part inside the image, edges where they are drawn."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from acp_lab.cad.edges import EdgeSamples, sample_edges
from acp_lab.cad.part import Part
from acp_lab.cad.raycast import RayCaster, make_caster
from acp_lab.control_points.motion_pairs import (
    MotionPairs,
    PairConfig,
    draw_samples,
    make_motion_pairs,
    stroke_ends,
    visible_rows,
)
from acp_lab.control_points.view_regions import ALL_REGIONS, region_scores
from acp_lab.errors import GeometryError
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import rotation_angle_deg, transform
from tests.control_points.conftest import PAIRS
from tests.made_parts import box, looking_at


def test_the_part_moves_by_exactly_what_was_asked(part: Part, pairs: MotionPairs) -> None:
    assert len(pairs) == PAIRS.views
    for before, after in zip(pairs.before_T_obj, pairs.after_T_obj, strict=True):
        assert rotation_angle_deg(before[:3, :3], after[:3, :3]) == pytest.approx(PAIRS.turn_deg)
        moved = transform(after, part.box_centre) - transform(before, part.box_centre)
        assert np.linalg.norm(moved) == pytest.approx(PAIRS.shift_mm)


def test_views_lie_in_the_region_and_its_overlap_at_the_asked_distances(part: Part, pairs: MotionPairs) -> None:
    eyes = np.stack([-pose[:3, :3].T @ pose[:3, 3] for pose in pairs.before_T_obj]) - part.box_centre
    scores = region_scores(eyes, 0.5 * part.box_size)
    assert (scores[:, 4] * (1.0 + PAIRS.overlap) >= scores.max(1)).all()
    distances = np.linalg.norm(eyes, axis=1) / part.diameter
    assert PAIRS.nearest <= distances.min() < distances.max() <= PAIRS.farthest


def test_the_part_stays_in_the_image_and_fills_most_of_it(part: Part, pairs: MotionPairs) -> None:
    for matrix, after in zip(pairs.camera_matrices, pairs.after_T_obj, strict=True):
        camera = Camera.from_matrix(matrix, PAIRS.size, PAIRS.size)
        pixels = camera.project(transform(after, part.vertices))
        assert 0.0 <= pixels.min() < pixels.max() <= PAIRS.size - 1
        assert np.ptp(pixels, axis=0).max() > 0.4 * PAIRS.size


def test_points_after_the_motion_lie_on_the_edges_drawn_there(pairs: MotionPairs) -> None:
    column, row = np.round(pairs.points_after).astype(int).T
    off = pairs.distances[pairs.view_of_point, row, column]
    # A few edges that showed before are hidden after; the others are where a pixel can be.
    assert np.quantile(off, 0.9) <= 1.5
    moved = np.linalg.norm(pairs.points_after - pairs.points, axis=1)
    assert moved.mean() > 1.0


def test_strokes_run_along_the_edges(part: Part, edges: EdgeSamples, caster: RayCaster, camera: Camera) -> None:
    cam_T_obj = looking_at(part, np.array([0.3, 0.4, 1.0]), 200.0)
    rows = visible_rows(part, edges, caster, cam_T_obj)
    ends = stroke_ends(edges, rows, camera, cam_T_obj)
    middles = camera.project(transform(cam_T_obj, edges.points_obj[rows]))
    np.testing.assert_allclose(ends.mean(1), middles, atol=0.02)
    drawn = draw_samples(edges, rows, camera, cam_T_obj)
    for points in (ends[:, 0], middles, ends[:, 1]):
        column, row = np.round(points).astype(int).T
        near = [drawn[r - 1 : r + 2, c - 1 : c + 2].any() for r, c in zip(row, column, strict=True)]
        assert all(near)


def test_the_same_seed_gives_the_same_pairs(part: Part, edges: EdgeSamples, caster: RayCaster) -> None:
    config = replace(PAIRS, views=2)
    first, again, other = (make_motion_pairs(part, edges, caster, ALL_REGIONS[1], config, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.points, again.points)
    np.testing.assert_array_equal(first.distances, again.distances)
    assert not np.array_equal(first.after_T_obj, other.after_T_obj)


def test_a_small_part_shifts_by_a_tenth_of_its_diameter() -> None:
    part = box((4.0, 3.0, 2.0))
    small = make_motion_pairs(part, sample_edges(part), make_caster(part), ALL_REGIONS[0], replace(PAIRS, views=2), 0)
    for before, after in zip(small.before_T_obj, small.after_T_obj, strict=True):
        moved = transform(after, part.box_centre) - transform(before, part.box_centre)
        assert np.linalg.norm(moved) == pytest.approx(0.1 * part.diameter)


@pytest.mark.parametrize("bad", [{"nearest": 0.5}, {"nearest": 5.0, "farthest": 4.0}, {"size": 16}])
def test_views_from_inside_the_part_are_refused(
    part: Part, edges: EdgeSamples, caster: RayCaster, bad: dict[str, float]
) -> None:
    with pytest.raises(GeometryError, match="motion pairs at"):
        make_motion_pairs(part, edges, caster, ALL_REGIONS[0], replace(PairConfig(), **bad), seed=0)
