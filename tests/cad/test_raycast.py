"""Rays hit what they should; Embree, the NumPy twin and the z-buffer agree; no half pixel is lost."""

from __future__ import annotations

import gc
import sys
import weakref

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from meshes import bushing, plate

from acp_lab.cad.part import Part
from acp_lab.cad.raycast import (
    BruteForceCaster,
    EmbreeCaster,
    RayCaster,
    caster_of,
    depth_map,
    hit_map,
    make_caster,
    normal_map,
)
from acp_lab.cad.zbuffer import rasterise
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import make_pose, so3_exp, transform

SMALL = Camera(96, 80, 150.0, 160.0, 47.5, 39.25)


@pytest.fixture(params=[EmbreeCaster, BruteForceCaster])
def kind(request: pytest.FixtureRequest) -> type[EmbreeCaster] | type[BruteForceCaster]:
    if request.param is EmbreeCaster:
        pytest.importorskip("embreex", reason="embreex is not installed")
    return request.param


def _at(z: float) -> np.ndarray:
    return make_pose(np.eye(3), np.array([0.0, 0.0, z]))


def test_distances_count_lengths_of_the_direction(kind: type) -> None:
    part = plate(-10.0, -10.0, 10.0, 10.0, z=50.0)
    caster: RayCaster = kind(part.vertices, part.faces)
    origins = np.zeros((4, 3))
    directions = np.array([[0, 0, 1.0], [0, 0, 5.0], [0.1, 0.1, 1.0], [0, 0, -1.0]])
    distance, face = caster.first_hit(origins, directions)
    np.testing.assert_allclose(distance, [50.0, 10.0, 50.0, np.inf], rtol=1e-6)
    assert distance.dtype == np.float64
    assert face.dtype == np.int64
    assert (face >= 0).tolist() == [True, True, True, False]
    assert face[3] == -1


def test_faces_are_seen_from_both_sides(kind: type) -> None:
    part = plate(-10.0, -10.0, 10.0, 10.0)
    caster: RayCaster = kind(part.vertices, part.faces)
    distance, _ = caster.first_hit([[1.0, 2.0, 30.0], [1.0, 2.0, -30.0]], [[0, 0, -1.0], [0, 0, 1.0]])
    np.testing.assert_allclose(distance, 30.0, rtol=1e-6)


def test_occluded_asks_for_anything_nearer(kind: type) -> None:
    part = plate(-10.0, -10.0, 10.0, 10.0, z=50.0)
    caster: RayCaster = kind(part.vertices, part.faces)
    origins, directions = np.zeros((6, 3)), np.tile([0.0, 0.0, 2.0], (6, 1))
    limits = np.array([24.9, 25.1, np.inf, 0.0, -1.0, 1e30])
    occluded = caster.occluded(origins, directions, limits)
    assert occluded.tolist() == [False, True, True, False, False, True]
    assert occluded.dtype == bool
    assert caster.occluded(origins, directions, 30.0).all()
    assert not caster.occluded(origins, -directions, np.inf).any()


def test_no_rays_and_wrong_shapes(kind: type) -> None:
    part = plate(-10.0, -10.0, 10.0, 10.0)
    caster: RayCaster = kind(part.vertices, part.faces)
    distance, face = caster.first_hit(np.zeros((0, 3)), np.zeros((0, 3)))
    assert distance.shape == face.shape == (0,)
    assert caster.occluded(np.zeros((0, 3)), np.zeros((0, 3)), 1.0).shape == (0,)
    for origins, directions in ((np.zeros(3), np.ones(3)), (np.zeros((2, 3)), np.ones((3, 3)))):
        with pytest.raises(ValueError, match="must both be"):
            caster.first_hit(origins, directions)


def test_no_ray_slips_between_two_faces(kind: type) -> None:
    # Rays from the middle of a ball through its vertices and through the middles of its edges.
    ball = trimesh.creation.icosphere(3, radius=20.0)
    caster: RayCaster = kind(ball.vertices, ball.faces)
    middles = ball.vertices[ball.edges_unique].mean(axis=1)
    directions = np.vstack([ball.vertices, middles])
    distance, face = caster.first_hit(np.zeros_like(directions), directions)
    assert (face >= 0).all()
    np.testing.assert_allclose(distance, 1.0, rtol=1e-5)


@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1))
def test_embree_agrees_with_its_numpy_twin(seed: int) -> None:
    pytest.importorskip("embreex", reason="embreex is not installed")
    rng = np.random.default_rng(seed)
    part = bushing()
    origins = part.box_centre + rng.normal(size=(300, 3)) * 60.0
    directions = part.box_centre + rng.normal(size=(300, 3)) * 10.0 - origins
    embree, twin = (kind(part.vertices, part.faces) for kind in (EmbreeCaster, BruteForceCaster))
    near, face = embree.first_hit(origins, directions)
    near_twin, face_twin = twin.first_hit(origins, directions)
    np.testing.assert_allclose(near, near_twin, rtol=1e-4)
    assert (face == face_twin).mean() > 0.99  # on an edge either face is right
    hit = np.isfinite(near)
    assert hit.any()
    assert not hit.all()
    assert embree.occluded(origins, directions, near + 1e-3)[hit].all()
    assert not embree.occluded(origins[hit], directions[hit], near[hit] - 1e-3).any()


@settings(max_examples=12)
@given(st.integers(0, 2**32 - 1), st.sampled_from([8.0, 60.0, 150.0]))
def test_the_three_ways_to_a_depth_map_agree(seed: int, distance: float) -> None:
    # At 8 mm the camera is inside the part's box: faces cross the camera's plane.
    pytest.importorskip("embreex", reason="embreex is not installed")
    rng = np.random.default_rng(seed)
    part = bushing()
    rotation = so3_exp(rng.normal(size=3) * 2.0)
    shift = np.array([*rng.uniform(-0.3, 0.3, size=2) * distance, distance])
    cam_T_obj = make_pose(rotation, shift - rotation @ part.box_centre)
    embree, embree_face = hit_map(part, EmbreeCaster(part.vertices, part.faces), SMALL, cam_T_obj)
    twin = BruteForceCaster(part.vertices, part.faces)
    zbuffer, face = hit_map(part, twin, SMALL, cam_T_obj)
    v, u = np.mgrid[: SMALL.height, : SMALL.width]
    rays = SMALL.rays(np.column_stack([u.ravel(), v.ravel()]))
    rays_obj = rays @ rotation
    origin = np.tile(-rotation.T @ cam_T_obj[:3, 3], (len(rays), 1))
    brute, brute_face = (values.reshape(zbuffer.shape) for values in twin.first_hit(origin, rays_obj))
    # A ray along an edge may go either way, so a few pixels may differ.
    np.testing.assert_array_equal(zbuffer > 0.0, face >= 0)
    np.testing.assert_array_equal(embree > 0.0, embree_face >= 0)
    assert ((face >= 0) != (brute_face >= 0)).sum() <= 1
    assert ((face >= 0) != (embree_face >= 0)).sum() <= 3
    both = (face >= 0) & (brute_face >= 0) & (embree_face >= 0)
    assert np.quantile(np.abs(zbuffer - brute)[both], 0.999, method="lower") < 1e-9
    assert np.quantile(np.abs(embree - brute)[both], 0.99, method="lower") < 1e-3


@pytest.mark.parametrize(("left", "right", "first", "last"), [(10.4, 20.6, 11, 20), (9.9, 20.1, 10, 20)])
def test_pixels_are_asked_at_their_centres(
    kind: type, left: float, right: float, first: int, last: int
) -> None:
    # At depth 100 with f = 100 and the principal point at pixel (0, 0) a mm is a pixel.
    camera = Camera(40, 30, 100.0, 100.0, 0.0, 0.0)
    part = plate(left, left - 5.0, right, right - 5.0)
    depth = depth_map(part, kind(part.vertices, part.faces), camera, _at(100.0))
    rows, columns = np.nonzero(depth)
    assert (columns.min(), columns.max()) == (first, last)
    assert (rows.min(), rows.max()) == (first - 5, last - 5)
    np.testing.assert_allclose(depth[rows, columns], 100.0, rtol=1e-6)
    assert depth.shape == (30, 40)


def test_the_centroid_of_a_ball_is_its_projection(kind: type) -> None:
    ball = trimesh.creation.icosphere(3, radius=20.0)
    part = Part.from_mesh(ball.vertices, ball.faces, "ball")
    camera = Camera(120, 100, 1500.0, 1500.0, 58.3, 51.8)
    depth = depth_map(part, kind(part.vertices, part.faces), camera, _at(1000.0))
    rows, columns = np.nonzero(depth)
    np.testing.assert_allclose([columns.mean(), rows.mean()], [58.3, 51.8], atol=0.05)
    assert depth[52, 58] == pytest.approx(980.0, abs=0.3)


def test_normals_face_the_camera(kind: type) -> None:
    ball = trimesh.creation.icosphere(4, radius=20.0)
    # Wound inside out and open: the normals of the map face the camera all the same.
    part = Part.from_mesh(ball.vertices, ball.faces[1:, ::-1], "ball")
    caster = kind(part.vertices, part.faces)
    cam_T_obj = make_pose(so3_exp(np.array([0.4, 1.0, -0.3])), np.array([1.0, -2.0, 90.0]))
    normals = normal_map(part, caster, SMALL, cam_T_obj)
    depth, face = hit_map(part, caster, SMALL, cam_T_obj)
    seen = face >= 0
    assert (normals[~seen] == 0.0).all()
    np.testing.assert_allclose(np.linalg.norm(normals[seen], axis=1), 1.0)
    v, u = np.nonzero(seen)
    rays = SMALL.rays(np.column_stack([u, v]))
    assert (np.einsum("ij,ij->i", normals[seen], rays) <= 0.0).all()
    radial = (rays * depth[seen][:, None] - cam_T_obj[:3, 3]) / 20.0
    outside = np.linalg.norm(radial, axis=1) > 0.99
    assert (np.einsum("ij,ij->i", normals[seen], radial)[outside] > 0.98).mean() > 0.99


def test_a_part_out_of_sight_leaves_an_empty_map(kind: type) -> None:
    part = bushing()
    caster = kind(part.vertices, part.faces)
    for shift in ([500.0, 0.0, 100.0], [0.0, -500.0, 100.0], [0.0, 0.0, -100.0]):
        depth, face = hit_map(part, caster, SMALL, make_pose(np.eye(3), np.array(shift)))
        assert (depth == 0.0).all()
        assert (face == -1).all()
        assert (normal_map(part, caster, SMALL, make_pose(np.eye(3), np.array(shift))) == 0.0).all()


def test_the_rasteriser_keeps_the_nearest_of_many_layers() -> None:
    plates = [plate(-50.0, -50.0, 50.0, 50.0, z=z) for z in (30.0, 10.0, 20.0)]
    vertices = np.vstack([p.vertices for p in plates])
    faces = np.vstack([p.faces + 4 * i for i, p in enumerate(plates)])
    depth, face = rasterise(transform(_at(100.0), vertices), faces, SMALL)
    np.testing.assert_allclose(depth, 110.0)
    assert set(np.unique(face)) == {2, 3}


def test_without_embreex_numpy_takes_over_with_a_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "embreex.rtcore_scene", None)
    monkeypatch.setitem(sys.modules, "embreex.mesh_construction", None)
    with pytest.warns(RuntimeWarning, match="embreex does not load"):
        caster = make_caster(bushing())
    assert isinstance(caster, BruteForceCaster)


def test_with_embreex_there_is_no_warning(recwarn: pytest.WarningsRecorder) -> None:
    pytest.importorskip("embreex", reason="embreex is not installed")
    assert isinstance(make_caster(bushing()), EmbreeCaster)
    assert not recwarn.list


def test_a_part_has_one_caster_and_takes_it_along() -> None:
    part, twin = bushing(), bushing()
    assert caster_of(part) is caster_of(part)
    assert caster_of(part) is not caster_of(twin)
    gone = weakref.ref(caster_of(part))
    del part
    gc.collect()
    assert gone() is None
