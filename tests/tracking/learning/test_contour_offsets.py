"""Offsets of image edges from the CAD's edges: the prior, what is learnt, and which way is out."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from acp_lab.cad.edges import EdgeSamples, facing, sample_edges
from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.errors import TrackingError
from acp_lab.generator.base import image_tangents
from acp_lab.geometry.arrays import BoolArray, FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import transform
from acp_lab.geometry.pose_step import image_directions
from acp_lab.tracking.learning.contour_offsets import (
    ContourOffsets,
    ExpectedOffsets,
    OffsetConfig,
    _add_moved,
    _inner_creases,
    _scatter_after_fit,
)
from tests.made_parts import box, bracket, looking_at

CAMERA = Camera(width=640, height=512, fx=900.0, fy=900.0, cx=319.5, cy=255.5)
CONFIG = OffsetConfig()
PART = box()
EDGES = sample_edges(PART)
POSE = looking_at(PART, np.array([1.0, 0.7, 0.5]), 250.0, 0.3)


def seen_at(edges: EdgeSamples, pose: FloatArray) -> tuple[np.ndarray, BoolArray, FloatArray, FloatArray]:
    """Ids, outline, image normals and directions (object frame) of what faces the camera."""
    seen = facing(edges, eye_position(pose))
    ids = np.flatnonzero(seen.shows)
    points_cam = transform(pose, edges.points_obj[ids])
    tangents = image_tangents(points_cam, edges.tangents_obj[ids] @ pose[:3, :3].T, CAMERA)
    normals = np.stack([-tangents[:, 1], tangents[:, 0]], 1)
    return ids, seen.outline[ids], normals, image_directions(points_cam, normals, CAMERA) @ pose[:3, :3]


def fresh(edge_break_mm: float = 0.25, edges: EdgeSamples = EDGES, diameter: float = PART.diameter) -> ContourOffsets:
    return ContourOffsets(edges, diameter, CONFIG.expected_mm(edge_break_mm), CONFIG)


def residuals_for(expected: ExpectedOffsets, offset_mm: float) -> FloatArray:
    """What is still to go, px, when every edge lies `offset_mm` outward."""
    return (offset_mm - expected.offsets_mm) * expected.px_per_mm


# ---- which way is out ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("way", [(1.0, 0.7, 0.5), (-0.6, 1.0, -0.3), (0.2, 0.1, 1.0), (1.0, -1.0, -1.0)], ids=str)
@pytest.mark.parametrize("made", [box, bracket], ids=["box", "bracket"])
def test_outward_leads_off_the_part(way: tuple[float, float, float], made) -> None:  # type: ignore[no-untyped-def]
    """An outline sample moved outward is farther from the image of the part's material next to it."""
    part = made()
    edges = sample_edges(part)
    pose = looking_at(part, np.array(way), 300.0, 0.7)
    ids, outline, normals, directions = seen_at(edges, pose)
    expected = fresh(0.25, edges, part.diameter).expect(ids, outline, directions)
    sign = np.sign(expected.px_per_mm)
    assert (sign[~outline] == 1.0).all()
    # A step into the metal, along the mean of the two inward normals, must run against "outward".
    inward = -edges.normals_obj[ids].sum(1)
    points = CAMERA.project(transform(pose, edges.points_obj[ids]))
    inside = CAMERA.project(transform(pose, edges.points_obj[ids] + 0.01 * inward))
    along = ((inside - points) * normals).sum(1)
    assert (sign[outline] == -np.sign(along[outline])).all()


def test_scale_is_pixels_per_millimetre_across_the_edge() -> None:
    ids, outline, normals, directions = seen_at(EDGES, POSE)
    expected = fresh().expect(ids, outline, directions)
    # Move each point by 0.1 mm along the steepest direction; the image moves by as much as is said.
    steepest = directions / np.linalg.norm(directions, axis=1)[:, None]
    points = CAMERA.project(transform(POSE, EDGES.points_obj[ids]))
    moved = CAMERA.project(transform(POSE, EDGES.points_obj[ids] + 0.1 * steepest))
    np.testing.assert_allclose(((moved - points) * normals).sum(1) / 0.1, np.abs(expected.px_per_mm), rtol=2e-3)


# ---- the prior -----------------------------------------------------------------------------------------------


def test_outlines_are_expected_inside_by_a_share_of_the_edge_break() -> None:
    ids, outline, _, directions = seen_at(EDGES, POSE)
    expected = fresh(0.4).expect(ids, outline, directions)
    np.testing.assert_allclose(expected.offsets_mm[outline], -CONFIG.break_share * 0.4)
    np.testing.assert_array_equal(expected.offsets_mm[~outline], 0.0)
    np.testing.assert_allclose(expected.offsets_px, expected.offsets_mm * expected.px_per_mm)
    assert (expected.weights > 0.0).all()
    assert (expected.weights <= 1.0).all()


def test_without_an_edge_break_nothing_is_expected() -> None:
    ids, outline, _, directions = seen_at(EDGES, POSE)
    np.testing.assert_array_equal(fresh(0.0).expect(ids, outline, directions).offsets_px, 0.0)


# ---- learning ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("offset_mm", [-0.2, 0.15])
def test_a_measured_offset_is_recovered(offset_mm: float) -> None:
    offsets = fresh()
    ids, outline, _, directions = seen_at(EDGES, POSE)
    for _ in range(10):
        expected = offsets.expect(ids, outline, directions)
        offsets.learn(ids, outline, expected, residuals_for(expected, offset_mm))
    expected = offsets.expect(ids, outline, directions)
    np.testing.assert_allclose(expected.offsets_mm[outline], offset_mm, atol=0.02)


def test_an_outline_seen_further_in_is_a_negative_offset() -> None:
    """Told in pixels and image normals alone: the part looks smaller by 0.2 mm all around."""
    offsets = fresh(0.0)
    ids, outline, normals, directions = seen_at(EDGES, POSE)
    expected = offsets.expect(ids, outline, directions)
    points = CAMERA.project(transform(POSE, EDGES.points_obj[ids]))
    inset = np.linalg.norm(directions, axis=1) * 0.2
    middle = CAMERA.project(transform(POSE, PART.box_centre[None]))[0]
    towards_middle = np.sign(((middle - points) * normals).sum(1))
    offsets.learn(ids, outline, expected, towards_middle * inset)
    learnt = offsets.expect(ids, outline, directions)
    assert (learnt.offsets_mm[outline] < 0.0).all()
    assert ((learnt.offsets_px * towards_middle)[outline] > 0.0).all()


def test_one_measurement_counts_for_more_than_the_prior_of_many() -> None:
    offsets = fresh(0.25)
    ids, outline, _, directions = seen_at(EDGES, POSE)
    first = offsets.expect(ids, outline, directions)
    offsets.learn(ids, outline, first, residuals_for(first, 0.0))
    now = offsets.expect(ids, outline, directions)
    assert (np.abs(now.offsets_mm[outline]) < np.abs(first.offsets_mm[outline])).all()
    assert (now.weights[outline] > first.weights[outline]).all()


def test_neighbours_that_were_not_seen_take_the_mean_of_their_cell() -> None:
    offsets = fresh(0.0)
    ids, outline, _, directions = seen_at(EDGES, POSE)
    measured = outline & (np.arange(len(ids)) % 2 == 0)
    for _ in range(30):
        expected = offsets.expect(ids, outline, directions)
        offsets.learn(ids, outline, expected, np.where(measured, residuals_for(expected, -0.3), np.nan))
    now = offsets.expect(ids, outline, directions)
    others = outline & ~measured
    np.testing.assert_allclose(now.offsets_mm[others], -0.3, atol=0.05)
    assert (now.weights[others] < now.weights[measured].min()).all()
    assert (now.weights[others] > fresh(0.0).expect(ids, outline, directions).weights[others]).all()


def test_far_cells_take_the_mean_of_all_outlines() -> None:
    offsets = fresh(0.0)
    ids, outline, _, directions = seen_at(EDGES, POSE)
    near = EDGES.points_obj[ids] @ [1.0, 0.7, 0.5] > 0.0
    expected = offsets.expect(ids, outline, directions)
    offsets.learn(ids, outline, expected, np.where(near, residuals_for(expected, -0.3), np.nan))
    now = offsets.expect(ids, outline, directions)
    count = int((outline & near).sum())
    far = outline & (EDGES.points_obj[ids] @ [1.0, 0.7, 0.5] < -5.0)
    assert far.any()
    np.testing.assert_allclose(now.offsets_mm[far], -0.3 * count / (count + CONFIG.class_inertia))


def test_the_two_roles_of_an_edge_are_kept_apart() -> None:
    offsets = fresh(0.0)
    ids, outline, _, directions = seen_at(EDGES, POSE)
    inner = np.zeros_like(outline)
    expected = offsets.expect(ids, inner, directions)
    offsets.learn(ids, inner, expected, residuals_for(expected, 0.4))
    assert (offsets.expect(ids, inner, directions).offsets_mm > 0.1).all()
    np.testing.assert_array_equal(offsets.expect(ids, np.ones_like(outline), directions).offsets_mm, 0.0)


def test_wild_measurements_are_cut_and_missing_ones_ignored() -> None:
    offsets = fresh(0.0)
    ids, outline, _, directions = seen_at(EDGES, POSE)
    expected = offsets.expect(ids, outline, directions)
    offsets.learn(ids, outline, expected, np.full(len(ids), np.nan))
    np.testing.assert_array_equal(offsets.expect(ids, outline, directions).offsets_mm, 0.0)
    for _ in range(50):
        offsets.learn(ids, outline, expected, np.full(len(ids), 1e6))
    assert np.abs(offsets.expect(ids, outline, directions).offsets_mm).max() <= CONFIG.largest + 1e-9


def test_forgetting_brings_the_prior_back() -> None:
    offsets = fresh(0.3)
    ids, outline, _, directions = seen_at(EDGES, POSE)
    first = offsets.expect(ids, outline, directions)
    offsets.learn(ids, outline, first, residuals_for(first, 0.5))
    offsets.forget()
    np.testing.assert_array_equal(offsets.expect(ids, outline, directions).offsets_mm, first.offsets_mm)


def test_samples_without_a_direction_or_an_outside_give_no_nan() -> None:
    """An edge that points at the eye has no normal in the image; the rim of a sheet has no outside."""
    offsets = fresh()
    ids, outline = np.arange(5), np.ones(5, bool)
    expected = offsets.expect(ids, outline, np.zeros((5, 3)))
    np.testing.assert_array_equal(expected.offsets_px, 0.0)
    offsets.learn(ids, outline, expected, np.ones(5))
    for values in vars(offsets.expect(ids, outline, np.ones((5, 3)))).values():
        assert np.isfinite(values).all()
    nothing = offsets.expect(np.zeros(0, np.intp), np.zeros(0, bool), np.zeros((0, 3)))
    assert len(nothing.offsets_px) == 0


# ---- the slow twins ------------------------------------------------------------------------------------------


def plain_expectation(
    offsets: ContourOffsets, ids: np.ndarray, outline: BoolArray, directions: FloatArray
) -> tuple[FloatArray, ...]:
    """The fields of `ExpectedOffsets` in NumPy."""
    scale = np.linalg.norm(directions, axis=1)
    outward = np.sign(np.einsum("nj,nj->n", directions, EDGES.normals_obj[ids].sum(1)))
    px_per_mm = np.where(outline, outward, 1.0) * scale
    role, cell = outline.astype(int), offsets._cell_of[ids]
    count, total = offsets._cell_count, offsets._cell_sum
    of_class = (CONFIG.class_inertia * offsets.prior_mm + total.sum()) / (CONFIG.class_inertia + count.sum())
    of_cell = (CONFIG.cell_inertia * of_class + total[cell]) / (CONFIG.cell_inertia + count[cell])
    seen = offsets._sample_count[ids, role]
    known = CONFIG.sample_inertia * np.where(outline, of_cell, 0.0) + offsets._sample_sum[ids, role]
    offsets_mm = known / (CONFIG.sample_inertia + seen)
    spread = np.where(count[cell] > 2, CONFIG.cell_spread, CONFIG.unknown_spread)
    spread = np.where(outline, np.where(seen > 0, CONFIG.known_spread, spread), offsets.inner_spread_mm)
    weights = CONFIG.edge_spread_px**2 / (CONFIG.edge_spread_px**2 + (spread * scale) ** 2)
    return offsets_mm * px_per_mm, weights, offsets_mm, px_per_mm


def test_what_is_expected_and_followed_is_that_of_the_slow_twin(rng: np.random.Generator) -> None:
    ids, outline, _, directions = seen_at(EDGES, POSE)
    offsets = fresh()
    half = rng.random(len(ids)) < 0.5
    some = ids[half], outline[half]
    offsets.learn(*some, offsets.expect(*some, directions[half]), np.full(half.sum(), 0.2))
    role = outline.astype(int)
    for _ in range(2):
        expected = offsets.expect(ids, outline, directions)
        fields = (expected.offsets_px, expected.weights, expected.offsets_mm, expected.px_per_mm)
        for found, plain in zip(fields, plain_expectation(offsets, ids, outline, directions), strict=True):
            np.testing.assert_allclose(found, plain, rtol=1e-9, atol=1e-12)
        residuals = np.where(rng.random(len(ids)) < 0.2, np.nan, rng.normal(0.0, 1.5, len(ids)))
        sums, near = offsets._sample_sum.copy(), np.flatnonzero(np.abs(residuals) < 2.0)
        count = offsets._sample_count[ids, role]
        spread = np.where(count > 0, CONFIG.known_spread, CONFIG.unknown_spread)
        spread = np.where(outline, spread, offsets.inner_spread_mm)
        share = CONFIG.follow_rate * spread**2 / (spread**2 + CONFIG.follow_noise**2)
        there = np.clip(expected.offsets_mm + share * residuals / expected.px_per_mm, -CONFIG.largest, CONFIG.largest)
        sums[ids[near], role[near]] += ((there - expected.offsets_mm) * (CONFIG.sample_inertia + count))[near]
        offsets.follow(ids, outline, expected, residuals)
        np.testing.assert_allclose(offsets._sample_sum, sums, rtol=1e-9, atol=1e-12)


def test_the_scatter_is_what_a_robust_fit_leaves(rng: np.random.Generator) -> None:
    jacobian = rng.normal(size=(80, 6)) * [40.0, 40.0, 40.0, 1.0, 1.0, 0.1]
    residuals = jacobian @ rng.normal(size=6) * 0.02 + rng.normal(0.0, 0.3, 80)
    residuals[::9] += 4.0
    scaled, rest, step = jacobian / np.sqrt((jacobian**2).mean(0)), residuals, np.zeros(6)
    for _ in range(3):
        weights = 1.0 / (1.0 + (rest / 0.5) ** 2) ** 2
        hessian = (scaled * weights[:, None]).T @ scaled + 1e-3 * weights.sum() * np.eye(6)
        step = step + np.linalg.solve(hessian, (scaled * weights[:, None]).T @ rest)
        rest = residuals - scaled @ step
    expected = float(np.median(np.abs(rest)))
    assert _scatter_after_fit(residuals, jacobian) == pytest.approx(expected, rel=1e-6)
    assert expected < 0.7 * float(np.median(np.abs(residuals))), "the step explains much of it"


def test_only_inner_creases_that_were_measured_scatter(rng: np.random.Generator) -> None:
    ids, outline, counts = rng.permutation(60)[:40], rng.random(40) < 0.5, rng.integers(0, 3, (60, 2)).astype(float)
    residuals, jacobian = np.where(rng.random(40) < 0.3, np.nan, rng.normal(size=40)), rng.normal(size=(40, 6))
    rest, rows = np.empty(40), np.empty((40, 6))
    count = _inner_creases(ids, outline, residuals, jacobian, counts, rest, rows)
    chosen = np.isfinite(residuals) & ~outline & (counts[ids, 0] > 0)
    np.testing.assert_array_equal(rest[:count], residuals[chosen])
    np.testing.assert_array_equal(rows[:count], jacobian[chosen])


def test_what_was_measured_moves_with_the_traits() -> None:
    """Measured where edges were told with some traits, offsets are what they would be with others."""
    ids, outline, _, directions = seen_at(EDGES, POSE)
    first = fresh().expect(ids, outline, directions)
    rng = np.random.default_rng(0)
    slopes_px, change = rng.normal(0.0, 0.05, (len(ids), 2)), np.array([0.4, -0.7])
    residuals_px = rng.normal(0.0, 0.05, len(ids))
    before, after = fresh(), fresh()
    before.learn(ids, outline, first, residuals_px, slopes_px)
    before.move(change)
    after.learn(ids, outline, first, residuals_px + slopes_px @ change, slopes_px)
    moved, measured = (each.expect(ids, outline, directions).offsets_mm for each in (before, after))
    np.testing.assert_allclose(moved, measured, atol=1e-9)
    assert np.abs(moved - first.offsets_mm).max() > 0.01


@pytest.mark.parametrize(
    "values",
    [
        {"class_inertia": 0.0}, {"cell_inertia": 0.0}, {"sample_inertia": 0.0}, {"cell_in_diameters": 0.0},
        {"edge_spread_px": float("nan")}, {"follow_rate": 1.5}, {"inner_limits": (1.0, 0.15)},
    ],
    ids=str,
)  # fmt: skip
def test_nonsense_is_refused(values: dict[str, Any]) -> None:
    with pytest.raises(TrackingError, match=f"learning.offsets.{next(iter(values))} = "):
        OffsetConfig(**values)


def test_nothing_measured_nothing_moves() -> None:
    ids, outline, _, directions = seen_at(EDGES, POSE)
    offsets = fresh()
    offsets.move(np.ones(2))
    np.testing.assert_array_equal(
        offsets.expect(ids, outline, directions).offsets_mm, fresh().expect(ids, outline, directions).offsets_mm
    )


# ---- what was measured from one side -------------------------------------------------------------------------


def turned(turn_deg: float) -> FloatArray:
    """(3,) mm towards the camera, turned about the object's z axis."""
    return 300.0 * np.array([np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg)), 0.0])


def test_what_was_measured_counts_less_the_farther_the_view_has_turned() -> None:
    ids, outline, _, directions = seen_at(EDGES, POSE)
    offsets = fresh()
    before = offsets.expect(ids, outline, directions)
    offsets.see_from(turned(0.0))
    offsets.learn(ids, outline, before, residuals_for(before, 0.3), np.full((len(ids), 2), 0.5))
    near = offsets.expect(ids, outline, directions)
    offsets.see_from(turned(1.0))  # a pose that trembles
    offsets.see_from(turned(0.0))
    np.testing.assert_array_equal(offsets.expect(ids, outline, directions).offsets_mm, near.offsets_mm)
    moved, gone = [], []
    for turn_deg in (0.0, 8.0, 30.0, 170.0):
        offsets.see_from(turned(turn_deg))
        expected = offsets.expect(ids, outline, directions, np.full(len(ids), 0.4))
        moved.append(np.abs(expected.offsets_mm - before.offsets_mm))
        gone.append(expected.weights)
    for earlier, later in pairwise(moved):
        assert (later < earlier - 1e-4).all()
    for earlier, later in pairwise(gone):
        assert (later <= earlier).all()
    np.testing.assert_allclose(moved[-1], 0.0, atol=1e-3)
    # As if nothing had been measured; what traits would move of it is gone, too.
    unknown = fresh().expect(ids, outline, directions, np.full(len(ids), 0.4))
    np.testing.assert_allclose(gone[-1], unknown.weights, rtol=1e-3)
    offsets.move(np.array([1.0, -0.5]))
    np.testing.assert_allclose(offsets.expect(ids, outline, directions).offsets_mm, before.offsets_mm, atol=1e-3)


def test_a_view_turned_in_steps_forgets_as_much_as_at_once() -> None:
    ids, outline, _, directions = seen_at(EDGES, POSE)
    found = []
    for steps in ((24.0,), (1.0, 3.0, 4.0, 9.0, 14.0, 15.0, 19.0, 24.0)):
        offsets = fresh()
        expected = offsets.expect(ids, outline, directions)
        offsets.see_from(turned(0.0))
        offsets.learn(ids, outline, expected, residuals_for(expected, 0.3))
        for turn_deg in steps:
            offsets.see_from(turned(turn_deg))
        found.append(offsets.expect(ids, outline, directions).offsets_mm)
    np.testing.assert_allclose(found[0], found[1], atol=1e-9)


def test_offsets_that_are_the_parts_alone_do_not_fade() -> None:
    ids, outline, _, directions = seen_at(EDGES, POSE)
    offsets = ContourOffsets(EDGES, PART.diameter, 0.0, OffsetConfig(view_deg=0.0))
    expected = offsets.expect(ids, outline, directions)
    offsets.see_from(turned(0.0))
    offsets.learn(ids, outline, expected, residuals_for(expected, 0.3))
    measured = offsets.expect(ids, outline, directions).offsets_mm
    offsets.see_from(turned(120.0))
    np.testing.assert_array_equal(offsets.expect(ids, outline, directions).offsets_mm, measured)


@pytest.mark.parametrize("view_deg", [-3.0, float("inf"), float("nan")])
def test_impossible_turns(view_deg: float) -> None:
    with pytest.raises(TrackingError, match="view_deg"):
        OffsetConfig(view_deg=view_deg)


def test_sums_are_moved_as_numpy_moves_them(rng: np.random.Generator) -> None:
    sums, slopes, traits = rng.normal(size=40), rng.normal(size=(40, 3)), rng.normal(size=3)
    expected = sums + slopes @ traits
    _add_moved(sums, slopes, traits)
    np.testing.assert_allclose(sums, expected, rtol=1e-12, atol=1e-12)
