"""3D edge samples: where they lie, in which order, which of them face an eye and which are hidden."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
import trimesh
from hypothesis import assume, given
from hypothesis import strategies as st

from acp_lab.cad import edges as module
from acp_lab.cad.edges import (
    MOST_CREASE_SAMPLES,
    EdgeSamples,
    check_has_edges,
    facing,
    nearly_showing,
    sample_edges,
    unoccluded,
    visible_samples,
)
from acp_lab.cad.part import Part
from acp_lab.cad.raycast import BruteForceCaster, make_caster
from acp_lab.errors import PartError
from acp_lab.geometry.arrays import BoolArray, FloatArray
from acp_lab.geometry.pose import so3_exp
from tests.geometry.geometry_strategies import directions
from tests.made_parts import box, bracket, cylinder, open_box, sheet

BRACKET = bracket()
BRACKET_EDGES = sample_edges(BRACKET)
CYLINDER_EDGES = sample_edges(cylinder())
RIM_EDGES = sample_edges(open_box())
VIEWS = np.array([[1.0, 0.8, 0.6], [-0.7, 1.0, 0.3], [0.2, -0.9, 1.0], [-1.0, -0.4, -0.8], [0.9, 1.0, -0.1]])


def edge_number(points: FloatArray, half: tuple[float, float, float]) -> FloatArray:
    """(n,) 0..11: on which edge of a box about the origin a point lies; fails when on none."""
    side = np.where(np.abs(np.abs(points) - half) < 1e-9, np.sign(points), 0.0)
    along = (side == 0.0).argmax(1)
    assert ((side == 0.0).sum(1) == 1).all(), "a sample lies on a corner, inside a face or off the box"
    others = np.array([[1, 2], [0, 2], [0, 1]])[along]
    signs = np.take_along_axis(side, others, 1) > 0
    return along * 4 + signs[:, 0] * 2 + signs[:, 1]


def test_a_box_has_twelve_creases_sampled_at_even_steps() -> None:
    edges = sample_edges(box(), spacing_mm=0.5)
    assert len(edges) == 720  # four each of 40, 30 and 20 mm
    assert edges.crease.all()
    assert edges.convex.all()
    number = edge_number(edges.points_obj, (20.0, 15.0, 10.0))
    for edge in range(12):
        axis = edge // 4
        at = np.sort(edges.points_obj[number == edge, axis])
        np.testing.assert_allclose(np.diff(at), 0.5, atol=1e-9)
        assert len(at) == 2 * (40, 30, 20)[axis]
        np.testing.assert_allclose(np.abs(edges.tangents_obj[number == edge]), np.eye(3)[[axis] * len(at)], atol=1e-12)


def test_a_sample_knows_the_normals_of_its_two_faces() -> None:
    edges = sample_edges(box(), spacing_mm=2.0)
    # On a box the two outward normals are the signs of the two coordinates that lie on its surface.
    expected = np.where(np.abs(np.abs(edges.points_obj) - [20.0, 15.0, 10.0]) < 1e-9, np.sign(edges.points_obj), 0.0)
    np.testing.assert_allclose(edges.normals_obj.sum(1), expected, atol=1e-9)
    assert np.abs(np.einsum("nkj,nj->nk", edges.normals_obj, edges.tangents_obj)).max() < 1e-9
    normals, offsets = edges.planes
    np.testing.assert_allclose(normals[1], edges.normals_obj[:, 1])
    np.testing.assert_allclose(offsets[1], (edges.normals_obj[:, 1] * edges.points_obj).sum(1))


def test_the_default_spacing_follows_the_size() -> None:
    assert sample_edges(box()).spacing_mm == pytest.approx(box().diameter / 160.0)


@pytest.mark.parametrize("count", [40, 100, 233, 500])
def test_every_prefix_covers_the_part_evenly(count: int) -> None:
    edges = sample_edges(box(), spacing_mm=0.5)
    number = edge_number(edges.points_obj[:count], (20.0, 15.0, 10.0))
    share = np.repeat([40.0, 30.0, 20.0], 4) / 360.0
    assert np.abs(np.bincount(number, minlength=12) - count * share).max() <= 2.0
    # No place on an edge is further from the prefix than two steps of an ideal one.
    gap = np.linalg.norm(edges.points_obj[:, None] - edges.points_obj[None, :count], axis=2).min(1)
    assert gap.max() < 2.0 * 360.0 / count


def test_the_order_is_the_same_every_time() -> None:
    np.testing.assert_array_equal(sample_edges(bracket()).points_obj, BRACKET_EDGES.points_obj)


def test_a_finely_tessellated_rim_gets_its_share_of_length_only() -> None:
    """Its mesh edges are 1 mm long, the steps 2 mm: one sample per mesh edge would be twice too many."""
    edges = sample_edges(cylinder(), spacing_mm=2.0)
    on_top = edges.crease & (edges.points_obj[:, 2] > 19.9)
    assert on_top.sum() == pytest.approx(2.0 * np.pi * 15.0 / 2.0, abs=1.0)
    angle = np.sort(np.arctan2(*edges.points_obj[on_top, :2].T))
    assert np.diff(angle).max() < 1.5 * 2.0 / 15.0


def test_curved_surfaces_are_thinned_to_the_limit() -> None:
    edges = sample_edges(cylinder(), max_smooth_samples=500)
    assert abs(int((~edges.crease).sum()) - 500) <= 1
    assert edges.crease.sum() == CYLINDER_EDGES.crease.sum()


def test_one_long_step_still_gives_a_sample() -> None:
    assert len(sample_edges(box(), spacing_mm=1e4)) == 1


def test_take_keeps_the_order_asked_for() -> None:
    rows = np.array([5, 2, 9])
    taken = BRACKET_EDGES.take(rows)
    np.testing.assert_array_equal(taken.points_obj, BRACKET_EDGES.points_obj[rows])
    np.testing.assert_array_equal(taken.convex, BRACKET_EDGES.convex[rows])
    assert len(BRACKET_EDGES.take(np.zeros(0, np.intp))) == 0
    assert not facing(BRACKET_EDGES.take(np.zeros(0, np.intp)), np.ones(3)).shows.any()


def test_flat_meshes_and_those_with_a_lining_are_refused() -> None:
    with pytest.raises(PartError, match=r"sheet: all faces lie in one plane; export"):
        sample_edges(sheet())
    part = box()
    lined = Part.from_mesh(part.vertices, np.concatenate([part.faces, part.faces[:, ::-1]]), "lined")
    with pytest.raises(PartError, match="lined: the mesh has no edges to track"):
        sample_edges(lined)


def test_a_smooth_body_has_its_outline_alone_and_a_ball_has_no_pose() -> None:
    ball = trimesh.creation.icosphere(subdivisions=3, radius=20.0)
    with pytest.raises(PartError, match="ball: a ball looks the same from all sides"):
        sample_edges(Part.from_mesh(ball.vertices, ball.faces, "ball"))
    with pytest.warns(RuntimeWarning, match=r"egg: no two faces .* tracked by its outline alone"):
        edges = sample_edges(Part.from_mesh(ball.vertices * [1.0, 1.2, 1.6], ball.faces, "egg"))
    eye = np.array([300.0, 0.0, 0.0])
    shows = facing(edges, eye)
    assert not edges.crease.any()
    assert shows.shows.sum() > 20
    np.testing.assert_array_equal(shows.shows, shows.outline)
    # The outline of an ellipsoid lies in the polar plane of the eye: x = a^2 / distance.
    np.testing.assert_allclose(edges.points_obj[shows.shows, 0], 20.0**2 / 300.0, atol=1.5)


def test_a_part_that_a_file_holds_twice_has_its_edges_once() -> None:
    part = box()
    vertices, faces = np.tile(part.vertices, (2, 1)), np.concatenate([part.faces, part.faces + len(part.vertices)])
    edges, once = sample_edges(Part.from_mesh(vertices, faces, "twice")), sample_edges(part)
    np.testing.assert_array_equal(edges.points_obj, once.points_obj)
    np.testing.assert_array_equal(edges.normals_obj, once.normals_obj)


# ---- which samples face an eye -------------------------------------------------------------------------------


def facing_one_by_one(edges: EdgeSamples, eye_obj: FloatArray) -> tuple[BoolArray, BoolArray]:
    """The rule of `facing`, told sample by sample."""
    shows, outline = np.zeros(len(edges), bool), np.zeros(len(edges), bool)
    for i in range(len(edges)):
        first, second = (float(normal @ (eye_obj - edges.points_obj[i])) > 0.0 for normal in edges.normals_obj[i])
        if edges.convex[i]:
            outline[i] = first != second
            shows[i] = (first or second) if edges.crease[i] else outline[i]
        else:
            shows[i] = first and second
    return shows, outline


@pytest.mark.parametrize("edges", [BRACKET_EDGES, CYLINDER_EDGES, RIM_EDGES], ids=["bracket", "cylinder", "open box"])
@given(direction=directions(), distance=st.floats(60.0, 2000.0))
def test_facing_agrees_with_the_rule_sample_by_sample(
    edges: EdgeSamples, direction: FloatArray, distance: float
) -> None:
    some = edges.take(np.arange(200))
    eye_obj = distance * direction
    height = np.einsum("nkj,nkj->nk", some.normals_obj, eye_obj - some.points_obj[:, None])
    assume(np.abs(height).min() > 1e-9)  # in the plane of a face either answer is right
    seen = facing(some, eye_obj)
    shows, outline = facing_one_by_one(some, eye_obj)
    np.testing.assert_array_equal(seen.shows, shows)
    np.testing.assert_array_equal(seen.outline, outline)


@given(direction=directions(), turn=directions(), margin_deg=st.floats(1.0, 10.0))
def test_nearly_showing_holds_what_shows_here_and_a_little_aside(
    direction: FloatArray, turn: FloatArray, margin_deg: float
) -> None:
    eye_obj = BRACKET.box_centre + 400.0 * direction
    # Turned about the centre; seen from a sample off the centre that is up to a tenth more or less.
    aside = BRACKET.box_centre + 400.0 * so3_exp(np.radians(0.8 * margin_deg) * turn) @ direction
    nearly = nearly_showing(BRACKET_EDGES, eye_obj, margin_deg)
    assert nearly[facing(BRACKET_EDGES, eye_obj).shows].all()
    assert nearly[facing(BRACKET_EDGES, aside).shows].all()


def test_nearly_showing_leaves_out_what_is_far_from_showing() -> None:
    edges = sample_edges(box())
    nearly = nearly_showing(edges, np.array([400.0, 350.0, 500.0]))
    on_side = edges.points_obj / [20.0, 15.0, 10.0]
    towards, away = (on_side > 1.0 - 1e-9).sum(1), (on_side < 1e-9 - 1.0).sum(1)
    assert nearly[towards >= 1].all()
    assert not nearly[away == 2].any()


def test_a_concave_crease_shows_only_when_both_its_faces_do() -> None:
    concave = ~BRACKET_EDGES.convex
    np.testing.assert_allclose(BRACKET_EDGES.points_obj[concave, :2], [[12.0, 10.0]] * concave.sum(), atol=1e-9)
    inside = facing(BRACKET_EDGES, np.array([200.0, 200.0, 15.0]))
    assert inside.shows[concave].all()
    for eye_obj in ([200.0, -200.0, 15.0], [-200.0, 200.0, 15.0]):
        assert not facing(BRACKET_EDGES, np.array(eye_obj)).shows[concave].any()
    assert not inside.outline[concave].any()


def test_the_rim_of_an_open_mesh_is_an_outline_from_everywhere() -> None:
    # The lid's rim and nothing else has a normal that points both ways.
    rim = np.linalg.norm(RIM_EDGES.normals_obj.sum(1), axis=1) < 1e-9
    np.testing.assert_allclose(RIM_EDGES.points_obj[rim, 2], 10.0)
    assert rim.sum() == pytest.approx(140.0 / RIM_EDGES.spacing_mm, abs=1.5)
    for direction in VIEWS:
        assert facing(RIM_EDGES, 300.0 * direction).outline[rim].all()


@given(longitude=st.floats(-np.pi, np.pi), distance=st.floats(30.0, 1000.0), height=st.floats(-60.0, 60.0))
def test_silhouettes_of_a_cylinder_lie_where_tangents_from_the_eye_touch_it(
    longitude: float, distance: float, height: float
) -> None:
    eye_obj = np.array([distance * np.cos(longitude), distance * np.sin(longitude), height])
    silhouette = facing(CYLINDER_EDGES, eye_obj).outline & ~CYLINDER_EDGES.crease
    points = CYLINDER_EDGES.points_obj[silhouette]
    np.testing.assert_allclose(np.hypot(points[:, 0], points[:, 1]), 15.0, atol=1e-6)
    touch = np.arccos(15.0 / distance)
    off = np.angle(np.exp(1j * (np.arctan2(points[:, 1], points[:, 0]) - longitude)))
    # The mesh has an edge every 2 pi / 96; the one nearest to where the tangent touches turns away first.
    assert np.abs(np.abs(off) - touch).max() < 2.0 * np.pi / 96
    assert (off > 0).any()
    assert (off < 0).any()


# ---- what hides what -----------------------------------------------------------------------------------------


def seen_by_first_hit(part: Part, edges: EdgeSamples, eye_obj: FloatArray, tolerance_mm: float) -> BoolArray:
    """(n,) bool: the ray from the eye towards a sample meets nothing before it, in float64 without any tree."""
    way = edges.points_obj - eye_obj
    reach = np.linalg.norm(way, axis=1)
    distance, _ = BruteForceCaster(part.vertices, part.faces).first_hit(
        np.tile(eye_obj, (len(edges), 1)), way / reach[:, None]
    )
    return distance > reach - tolerance_mm


@pytest.mark.parametrize("direction", VIEWS, ids=str)
@pytest.mark.parametrize("distance", [150.0, 600.0])
def test_visible_samples_agree_with_first_hits(direction: FloatArray, distance: float) -> None:
    eye_obj = BRACKET.box_centre + distance * direction / np.linalg.norm(direction)
    offset = 0.002 * BRACKET.diameter
    visible = visible_samples(BRACKET_EDGES, make_caster(BRACKET), eye_obj, offset)
    expected = facing(BRACKET_EDGES, eye_obj).shows & seen_by_first_hit(BRACKET, BRACKET_EDGES, eye_obj, 2.0 * offset)
    # Where one edge passes behind another, the lift off the surface decides about a sample or two.
    assert (visible != expected).sum() <= 3
    assert 0.2 < visible.mean() < 0.9


def test_nothing_of_a_convex_part_is_hidden_by_itself() -> None:
    part = box()
    edges = sample_edges(part)
    for direction in VIEWS:
        eye_obj = 200.0 * direction
        np.testing.assert_array_equal(
            visible_samples(edges, make_caster(part), eye_obj, 0.002 * part.diameter), facing(edges, eye_obj).shows
        )


def test_the_inside_of_an_open_box_is_seen_through_the_opening_only() -> None:
    part = open_box()
    bottom = RIM_EDGES.take(np.flatnonzero(RIM_EDGES.points_obj[:, 2] < -9.9))
    free = unoccluded(bottom, make_caster(part), np.array([0.0, 0.0, -200.0]), 0.002 * part.diameter)
    assert free.all()
    assert not unoccluded(bottom, make_caster(part), np.array([200.0, 0.0, 8.0]), 0.002 * part.diameter).all()


# --- meshes that are no machined part ---------------------------------------------------------------------


def loose_triangles(count: int) -> Part:
    rng = np.random.default_rng(0)
    corners = rng.uniform(-50.0, 50.0, (count, 1, 3)) + rng.uniform(-8.0, 8.0, (count, 3, 3))
    return Part.from_mesh(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3), "heap")


def rough_ball() -> Part:
    mesh = trimesh.creation.icosphere(subdivisions=5, radius=50.0)
    noise = 1.0 + 0.05 * np.random.default_rng(0).standard_normal((len(mesh.vertices), 1))
    return Part.from_mesh(mesh.vertices * noise, mesh.faces, "rough")


@pytest.mark.parametrize("part", [loose_triangles(1000), rough_ball()], ids=lambda part: part.name)
def test_a_mesh_of_too_many_edges_is_sampled_more_sparsely_and_says_so(part: Part) -> None:
    with pytest.warns(RuntimeWarning, match=f"{part.name}: .* {MOST_CREASE_SAMPLES} are taken, one every"):
        edges = sample_edges(part)
    assert edges.crease.sum() == pytest.approx(MOST_CREASE_SAMPLES, abs=2)
    assert len(edges) <= MOST_CREASE_SAMPLES + 6000 + 2
    assert edges.spacing_mm > part.diameter / 160.0
    # Even so, they lie everywhere: each eighth of the box has its share.
    octant = ((edges.points_obj > part.box_centre) @ [1, 2, 4]).astype(int)
    assert np.bincount(octant, minlength=8).min() > 0.07 * len(edges)


def test_creases_and_rims_share_one_limit() -> None:
    with pytest.warns(RuntimeWarning, match="100 are taken"):
        edges = sample_edges(open_box(), max_crease_samples=100)
    assert len(edges) == pytest.approx(100, abs=2)


@pytest.mark.filterwarnings("error")
def test_machined_parts_are_not_thinned_out() -> None:
    for part in (box(), bracket(), cylinder(), open_box()):
        assert sample_edges(part).spacing_mm == part.diameter / 160.0
    assert len(sample_edges(box(), spacing_mm=0.02)) == 18_000  # by one's own choice


def plain_chain_order(vertex_pairs: np.ndarray) -> list[int]:
    """The slow twin: at each vertex, all of its edges are looked through."""
    used: list[int] = []
    for seed in range(len(vertex_pairs)):
        edge, vertex = seed, vertex_pairs[seed, 1]
        while edge not in used:
            used.append(edge)
            onward = [e for e in np.flatnonzero((vertex_pairs == vertex).any(1)).tolist() if e not in used]
            if not onward:
                break
            edge = onward[0]
            vertex = vertex_pairs[edge].sum() - vertex
    return used


@pytest.mark.parametrize("seed", range(12))
def test_the_walk_along_edges_is_that_of_its_slow_twin(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pairs = rng.integers(0, 4 + 3 * seed, (60, 2))
    pairs = np.unique(np.sort(pairs[pairs[:, 0] != pairs[:, 1]], axis=1), axis=0)
    pairs = rng.permuted(rng.permutation(pairs), axis=1)
    np.testing.assert_array_equal(module._chain_order(pairs), plain_chain_order(pairs))


def test_a_hub_of_very_many_edges_is_walked_in_time() -> None:
    """Looking through all of them at each visit would take hours."""
    count = 200_000
    order = module._chain_order(np.column_stack([np.arange(1, count + 1), np.zeros(count, int)]))
    np.testing.assert_array_equal(order, np.arange(count))


def test_a_scan_full_of_noise_is_refused() -> None:
    with pytest.raises(PartError, match=r"heap: has \d+ times its diameter of edges, as of a scan"):
        sample_edges(loose_triangles(20_000))
    with pytest.raises(PartError, match="as of a scan"):
        check_has_edges(loose_triangles(20_000))


def test_memory_is_a_few_numbers_per_face() -> None:
    """A million loose triangles, three million edges, then fit below a gigabyte."""
    part = loose_triangles(20_000)
    tracemalloc.start()
    try:
        with pytest.warns(RuntimeWarning, match="12000 are taken"):
            sample_edges(part, max_crease_samples=MOST_CREASE_SAMPLES)  # at all; by default that many are refused
        assert tracemalloc.get_traced_memory()[1] / len(part.faces) < 750.0
    finally:
        tracemalloc.stop()
