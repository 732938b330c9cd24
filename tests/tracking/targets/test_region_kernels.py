"""The loops of the region target, against plain NumPy."""

from __future__ import annotations

import numpy as np

from acp_lab.cad.edges import sample_edges
from acp_lab.generator.base import VisibleSamples, project_samples
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import transform
from acp_lab.geometry.pose_step import image_directions
from acp_lab.tracking.targets.region_kernels import (
    expect_of_unseen,
    follow_scatter,
    free_lengths,
    keep_free,
    line_rays,
    mean_square_rest,
    outline_lines,
    weigh_lines,
)
from tests.made_parts import bracket, looking_at

CAMERA = Camera(640, 512, 900.0, 880.0, 319.5, 255.5)
PART = bracket()
EDGES = sample_edges(PART)
OFF = EDGES.normals_obj.sum(1)
POSE = looking_at(PART, np.array([1.0, 0.7, 0.5]), 250.0, 0.3)


def test_lines_are_the_first_outline_samples_and_point_off_the_part(rng: np.random.Generator) -> None:
    ids = rng.permutation(len(EDGES))[:80]
    outline = rng.random(80) < 0.6
    drawn = project_samples(EDGES, VisibleSamples(ids, outline, np.ones(80)), POSE, CAMERA)
    sample_ids = np.where(rng.random(80) < 0.1, -1, ids)
    most = 25
    rows, found_ids = np.empty((2, most), np.int64)
    (points, outward), px_per_mm = np.empty((2, most, 2)), np.empty(most)
    count = outline_lines(
        outline, sample_ids, drawn.points, drawn.normals, POSE, CAMERA.numbers, EDGES.points_obj, OFF, rows, found_ids,
        points, outward, px_per_mm,
    )  # fmt: skip
    expected = np.flatnonzero(outline & (sample_ids >= 0))[:most]
    assert count == most == len(expected)
    np.testing.assert_array_equal(rows, expected)
    np.testing.assert_array_equal(found_ids, ids[expected])
    across = image_directions(transform(POSE, EDGES.points_obj[found_ids]), drawn.normals[rows], CAMERA) @ POSE[:3, :3]
    side = np.sign(np.einsum("nj,nj->n", across, OFF[found_ids]))
    np.testing.assert_allclose(outward, side[:, None] * drawn.normals[rows], atol=1e-12)
    np.testing.assert_allclose(points, drawn.points[rows], atol=1e-12)
    np.testing.assert_allclose(px_per_mm, np.linalg.norm(across, axis=1), rtol=1e-9)


def test_rays_go_through_the_places_on_the_lines(rng: np.random.Generator) -> None:
    points, angles = rng.uniform(50.0, 400.0, (9, 2)), rng.uniform(0.0, 6.0, 9)
    outward, asked = np.stack([np.cos(angles), np.sin(angles)], 1), np.array([2, 5, 8])
    way = np.array([-6.0, -3.0, 3.0, 6.0])
    rays = np.empty((3, 4, 3))
    line_rays(asked, points, outward, POSE, CAMERA.numbers, way, rays)
    places = (points[asked, None] + way[:, None] * outward[asked, None]).reshape(-1, 2)
    np.testing.assert_allclose(rays.reshape(-1, 3), CAMERA.rays(places) @ POSE[:3, :3], rtol=1e-9, atol=1e-12)


def test_a_line_is_free_as_far_as_the_first_gap(rng: np.random.Generator) -> None:
    hit, free = rng.random((40, 2, 5)) < 0.7, np.full((2, 50), np.nan)
    ids = rng.permutation(50)[:40]
    step_mm = rng.random(40)
    free_lengths(ids, hit, step_mm, free)
    np.testing.assert_allclose(free[0, ids], step_mm * np.cumprod(hit[:, 0], axis=1).sum(1))
    np.testing.assert_allclose(free[1, ids], step_mm * np.cumprod(~hit[:, 1], axis=1).sum(1))
    assert np.isnan(np.delete(free, ids, axis=1)).all()


def test_lines_that_are_free_on_both_sides_come_to_the_front(rng: np.random.Generator) -> None:
    count = 30
    all_free = rng.integers(0, 3, (2, 60)).astype(np.float64)
    rows, ids = rng.permutation(90)[:count], rng.permutation(60)[:count]
    points, outward, px_per_mm = rng.random((count, 2)), rng.random((count, 2)), rng.random(count)
    before = [values.copy() for values in (rows, ids, points, outward, px_per_mm)]
    free = np.empty((2, count))
    kept = keep_free(all_free, rows, ids, points, outward, px_per_mm, free)
    keep = (all_free[:, before[1]] > 0.0).all(0)
    assert kept == keep.sum() > 3
    for now, was in zip((rows, ids, points, outward, px_per_mm), before, strict=True):
        np.testing.assert_array_equal(now[:kept], was[keep])
    np.testing.assert_allclose(free[:, :kept], (all_free[:, before[1]] * before[4])[:, keep])


def test_fine_levels_ask_what_is_known_of_a_line(rng: np.random.Generator) -> None:
    lines, samples, edges = 20, 50, 60
    rows, ids = rng.permutation(edges)[:lines], rng.permutation(samples)[:lines]
    found, outward = rng.random((2, lines)), rng.normal(size=(lines, 2))
    px_per_mm, offsets_mm, mean_square = rng.random(lines), rng.normal(size=samples), rng.random(samples)
    crease, normals = rng.random(samples) < 0.5, rng.normal(size=(edges, 2))
    for is_fine in (False, True):
        residuals, weights = np.zeros((2, edges))
        weigh_lines(
            0.8, is_fine, 0.25, 15.0, found, rows, ids, outward, px_per_mm, offsets_mm, mean_square, crease, normals,
            residuals, weights,
        )  # fmt: skip
        px, weight = found[0], 0.8 * found[1]
        if is_fine:
            px = px - offsets_mm[ids] * px_per_mm
            weight = weight * 0.25**2 / (0.25**2 + mean_square[ids]) * np.where(crease[ids], 1.0, 15.0)
        np.testing.assert_allclose(residuals[rows], px * np.einsum("nj,nj->n", outward, normals[rows]), rtol=1e-9)
        np.testing.assert_allclose(weights[rows], weight, rtol=1e-12)
        assert not np.delete(residuals, rows).any()
        assert not np.delete(weights, rows).any()


def test_the_rest_is_that_of_the_points_where_they_are_now(rng: np.random.Generator) -> None:
    residuals, weights = rng.normal(size=40), np.where(rng.random(40) < 0.5, rng.random(40), 0.0)
    start, points, directions = rng.normal(size=(3, 40, 2))
    rest = residuals - ((points - start) * directions).sum(1)
    expected = 0.5 * (weights * rest**2).mean()
    np.testing.assert_allclose(mean_square_rest(residuals, weights, start, points, directions), expected, rtol=1e-12)
    nothing = np.zeros((0, 2))
    assert mean_square_rest(np.zeros(0), np.zeros(0), nothing, nothing, nothing) == 0.0


def test_the_scatter_of_lines_is_followed(rng: np.random.Generator) -> None:
    ids, known = rng.permutation(60)[:40], rng.random(60) < 0.5
    found_px, weights, px_per_mm = rng.normal(0.0, 2.0, 40), rng.random(40), rng.uniform(1.0, 4.0, 40)
    offsets_mm, mean_square = rng.normal(0.0, 0.2, 60), rng.uniform(0.0, 4.0, 60)
    expected = mean_square.copy()
    rest = found_px - offsets_mm[ids] * px_per_mm
    square = np.where(weights > 0.15, np.minimum(rest**2, 9.0), 9.0)
    seen = rng.random(40) < 0.8
    expected[ids] += seen * np.where(known[ids], 0.2, 0.5) * (square - expected[ids])
    follow_scatter(ids, seen, found_px, weights, px_per_mm, offsets_mm, known, 0.2, mean_square)
    np.testing.assert_allclose(mean_square, expected, rtol=1e-12)


def test_what_is_expected_goes_to_samples_never_seen(rng: np.random.Generator) -> None:
    unseen, known, mean_square = np.sort(rng.permutation(60)[:40]), rng.random(60) < 0.3, rng.random(60)
    left, expected = unseen[~known[unseen]], mean_square.copy()
    expected[left] = 7.0
    count = expect_of_unseen(unseen, known, 7.0, mean_square)
    np.testing.assert_array_equal(unseen[:count], left)
    np.testing.assert_array_equal(mean_square, expected)
