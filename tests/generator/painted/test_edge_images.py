"""True edge images: where the edges are drawn, and that a jittered picture is what another camera would see."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from acp_lab.cad.edges import sample_edges
from acp_lab.cad.part import Part
from acp_lab.cad.raycast import RayCaster, make_caster
from acp_lab.control_points.canonical_frame import CanonicalFrame, canonical_frame
from acp_lab.control_points.view_regions import ALL_REGIONS
from acp_lab.errors import PreparationError
from acp_lab.generator.painted.edge_images import (
    EdgeImageConfig,
    EdgeView,
    analytic_view,
    canny_view,
    draw_strokes,
    draw_views,
    jitter_homographies,
    jitter_homography,
    make_edge_views,
    moved_strokes,
    true_points,
)
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.homography import apply_homography
from acp_lab.imaging.chamfer import chamfer, nearest_distances
from tests.made_parts import box, bracket

REGION = ALL_REGIONS[4]
CONFIG = EdgeImageConfig(views=6, held_out=2)
PART = bracket()


def frame_at(part: Part, direction: tuple[float, float, float], diameters: float) -> tuple[FloatArray, CanonicalFrame]:
    towards = np.array(direction) / np.linalg.norm(direction)
    eye_obj = part.box_centre + diameters * part.diameter * towards
    return eye_obj, canonical_frame(eye_obj, part.box_centre, part.radius, REGION)


# ---- drawing -------------------------------------------------------------------------------------------------


def test_brightness_is_the_gaussian_of_the_distance_to_the_nearest_stroke() -> None:
    strokes = np.array([[[10.3, 12.2], [20.8, 15.1]], [[22.0, 6.0], [22.0, 6.0]]])
    pieces = np.concatenate([np.linspace(*stroke, 30) for stroke in strokes])
    short = np.stack([pieces[:-1], pieces[1:]], 1)[np.arange(59) != 29]
    image = draw_strokes(short, np.zeros(len(short), int), 1, 32, 0.8)[0]
    pixels = np.stack(np.meshgrid(np.arange(32.0), np.arange(32.0)), -1).reshape(-1, 2)
    dense = np.concatenate([np.linspace(*stroke, 4000) for stroke in strokes])
    expected = np.exp(-0.5 * (nearest_distances(pixels, dense) / 0.8) ** 2).reshape(32, 32)
    # Beyond two pixels the picture is black, where the Gaussian has not quite fallen to nothing.
    np.testing.assert_allclose(image, expected, atol=0.05)
    near = expected > 0.1
    np.testing.assert_allclose(image[near], expected[near], atol=2e-3)


def test_each_stroke_goes_into_its_own_image_and_none_over_the_border() -> None:
    at = np.array([[8.0, 8.0], [0.4, 8.0], [8.0, 15.2], [-30.0, 5.0], [4.0, 11.0]])
    images = draw_strokes(np.stack([at, at], 1), np.array([0, 0, 1, 1, 2]), 3, 16, 0.8)
    assert images.shape == (3, 16, 16)
    assert images.dtype == np.float32
    assert [np.unravel_index(image.argmax(), image.shape) for image in images[[0, 2]]] == [(8, 8), (11, 4)]
    assert not images[1].any()
    assert images[0, 8, 0] < 1e-6


# ---- jitter --------------------------------------------------------------------------------------------------


@given(
    roll=st.floats(-0.3, 0.3),
    x=st.floats(-9.0, 9.0),
    y=st.floats(-9.0, 9.0),
    scale=st.floats(0.9, 1.1),
    diameters=st.floats(0.8, 20.0),
)
def test_jitter_is_another_camera_at_the_same_eye(
    roll: float, x: float, y: float, scale: float, diameters: float
) -> None:
    """The homography moves projections of points of any depth to where a turned, rolled, zoomed camera sees them."""
    eye_obj, frame = frame_at(PART, (0.3, -0.4, 1.0), diameters)
    moved = apply_homography(jitter_homography(frame, roll, np.array([x, y]), scale), frame.project(PART.vertices))
    # The same camera made in another way: from three directions in space that it must see at given pixels.
    middle, focal = 0.5 * (frame.size - 1), scale * frame.focal_px
    centre = apply_homography(
        jitter_homography(frame, roll, np.array([x, y]), scale), frame.project(PART.box_centre[None])
    )
    np.testing.assert_allclose(centre[0], (middle + x, middle + y), atol=1e-8)
    rays_before = np.column_stack([(frame.project(PART.vertices) - middle) / frame.focal_px, np.ones(len(moved))])
    rays_after = np.column_stack([(moved - middle) / focal, np.ones(len(moved))])
    before, after = (r / np.linalg.norm(r, axis=1)[:, None] for r in (rays_before, rays_after))
    # A camera that only turned sees the same angles between all points.
    np.testing.assert_allclose(after @ after.T, before @ before.T, atol=1e-9)
    assert np.linalg.norm(eye_obj - PART.box_centre) == pytest.approx(diameters * PART.diameter)


def test_jitter_without_spread_changes_nothing() -> None:
    _, frame = frame_at(PART, (0.1, 0.2, 1.0), 4.0)
    still = replace(CONFIG, roll_deg=0.0, shift=0.0, scale=0.0)
    h = jitter_homographies([frame], still, np.random.default_rng(0))[0]
    np.testing.assert_allclose(h / h[2, 2], np.eye(3), atol=1e-9)


def test_jitter_stays_within_its_limits(rng: np.random.Generator) -> None:
    _, frame = frame_at(PART, (0.1, 0.2, 1.0), 4.0)
    middle = np.full(2, 0.5 * (frame.size - 1))
    h = jitter_homographies([frame] * 200, CONFIG, rng)
    shifts = np.array([apply_homography(each, middle[None])[0] - middle for each in h])
    assert 0.9 * CONFIG.shift * CONFIG.size < np.abs(shifts).max() <= CONFIG.shift * CONFIG.size + 1e-9


# ---- views ---------------------------------------------------------------------------------------------------


def test_both_sources_show_the_nine_edges_of_a_box_seen_from_a_corner() -> None:
    part = box()
    caster = make_caster(part)
    eye_obj, frame = frame_at(part, (0.6, 0.7, 1.0), 5.0)
    pairs = [(a, b) for a in range(8) for b in range(a) if np.sum(part.vertices[a] != part.vertices[b]) == 1]
    hidden = int(np.argmin(part.vertices @ np.ones(3)))
    seen = [frame.project(np.linspace(*part.vertices[[a, b]], 1500)) for a, b in pairs if hidden not in (a, b)]
    assert len(seen) == 9
    analytic = analytic_view(part, sample_edges(part), caster, eye_obj, frame)
    for view, within in ((analytic, (0.02, 0.15)), (canny_view(part, caster, frame, 2), (0.4, 0.45))):
        found = chamfer(true_points(view, np.eye(3)), np.concatenate(seen))
        assert found.a_to_b < within[0]
        assert found.b_to_a < within[1]


def test_both_sources_agree_where_edges_have_different_normals(part: Part, caster: RayCaster) -> None:
    analytic, normals = (
        make_edge_views(part, caster, REGION, replace(CONFIG, source=source), 4, seed=1)
        for source in ("analytic", "normals")
    )
    for a, b in zip(analytic, normals, strict=True):
        np.testing.assert_array_equal(a.frame.canonical_T_obj, b.frame.canonical_T_obj)
        assert chamfer(true_points(b, np.eye(3)), true_points(a, np.eye(3))).a_to_b < 0.6


@pytest.mark.parametrize("oversampling", [1, 2, 4, 8])
def test_rendered_edges_lie_where_the_part_is(oversampling: int) -> None:
    """A box seen from straight above is centred in its image; so are its edges, whatever the rendering's size.

    But for half a pixel of the rendering: of the two pixels beside a step Canny always takes the left or the upper one.
    """
    part = box()
    _, frame = frame_at(part, (0.0, 0.0, 1.0), 5.0)
    points = canny_view(part, make_caster(part), frame, oversampling).strokes[:, 0]
    middle = 0.5 * (points.min(0) + points.max(0)) - 0.5 * (frame.size - 1)
    np.testing.assert_allclose(middle, -0.5 / oversampling, atol=1e-6)


def test_an_unknown_source_is_refused(part: Part, caster: RayCaster) -> None:
    with pytest.raises(PreparationError, match="'photographs': choose analytic or normals"):
        make_edge_views(part, caster, REGION, replace(CONFIG, source="photographs"), 1, seed=0)  # type: ignore[arg-type]


def test_views_are_repeatable_and_differ_by_seed(part: Part, caster: RayCaster) -> None:
    first, again, other = (make_edge_views(part, caster, REGION, CONFIG, 3, seed) for seed in (0, 0, 1))
    for a, b in zip(first, again, strict=True):
        np.testing.assert_array_equal(a.strokes, b.strokes)
    assert not np.array_equal(first[0].frame.canonical_T_obj, other[0].frame.canonical_T_obj)


def test_outlines_lie_inside_by_the_inset() -> None:
    """A box seen from straight above has one outline, a rectangle; each of its sides moves towards the middle."""
    part = box()
    eye_obj, frame = frame_at(part, (0.0, 0.0, 1.0), 6.0)
    edges, caster = sample_edges(part), make_caster(part)
    plain, inset = (analytic_view(part, edges, caster, eye_obj, frame, mm) for mm in (0.0, 0.5))
    px_per_mm = frame.focal_px / (6.0 * part.diameter - 10.0)
    moved = inset.strokes - plain.strokes
    np.testing.assert_allclose(np.linalg.norm(moved, axis=2), 0.5 * px_per_mm, atol=1e-9)
    along = plain.strokes[:, 1] - plain.strokes[:, 0]
    np.testing.assert_allclose(np.einsum("nkj,nj->nk", moved, along), 0.0, atol=1e-9)
    outwards = plain.strokes.mean(1) - 0.5 * (frame.size - 1)
    assert (np.einsum("nj,nj->n", moved.mean(1), outwards) < -5.0).all()


def test_inner_creases_are_not_inset(part: Part, caster: RayCaster) -> None:
    eye_obj, frame = frame_at(part, (0.7, 0.6, 1.0), 5.0)
    edges = sample_edges(part)
    plain, inset = (analytic_view(part, edges, caster, eye_obj, frame, mm) for mm in (0.0, 0.4))
    moved = np.linalg.norm((inset.strokes - plain.strokes).mean(1), axis=1)
    still = moved == 0.0
    assert 0.1 < still.mean() < 0.9
    assert (moved[~still] > 0.1).all()


def test_true_points_follow_the_drawn_picture(part: Part, caster: RayCaster, rng: np.random.Generator) -> None:
    views = make_edge_views(part, caster, REGION, CONFIG, 3, seed=2)
    homographies = jitter_homographies([view.frame for view in views], CONFIG, rng)
    images = draw_views(views, homographies, CONFIG.line_sigma_px)
    for view, h, image in zip(views, homographies, images, strict=True):
        at = np.round(true_points(view, h)).astype(int)
        assert image[at[:, 1], at[:, 0]].min() > 0.6
        assert len(true_points(view, h)) <= 3 * len(view.strokes)


def test_points_near_the_border_are_left_out() -> None:
    _, frame = frame_at(PART, (0.1, 0.2, 1.0), 4.0)
    at = np.array([[1.0, 50.0], [2.0, 50.0], [64.0, 126.5], [64.0, 125.0]])
    view = EdgeView(frame, np.stack([at, at], 1), np.full((len(at), 3), np.nan))
    assert len(true_points(view, np.eye(3))) == 6
    np.testing.assert_array_equal(moved_strokes(view, np.eye(3)), view.strokes)
