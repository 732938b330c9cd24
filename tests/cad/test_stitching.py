"""Faces that meet without sharing an edge are put together again, and nothing else is touched."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from meshes import box, bushing

from acp_lab.cad import stitching
from acp_lab.cad.edges import sample_edges
from acp_lab.cad.part import Part
from acp_lab.cad.stitching import stitched
from acp_lab.geometry.arrays import FloatArray, IntArray


def _torn(part: Part, seed: int, needles: bool) -> tuple[FloatArray, IntArray]:
    """A part of which many faces have one to three vertices more on a side than the face beside them.

    needles: the gap is filled with triangles that have no height.
    """
    rng = np.random.default_rng(seed)
    mesh = trimesh.Trimesh(part.vertices, part.faces, process=False)
    vertices, faces, taken = list(part.vertices), [face.tolist() for face in part.faces], set[int]()
    for k in rng.permutation(len(mesh.face_adjacency)).tolist():
        face, other = mesh.face_adjacency[k].tolist()
        if face in taken or other in taken:
            continue
        taken |= {face, other}
        corners = part.faces[face].tolist()
        apex = next(place for place in range(3) if corners[place] not in mesh.face_adjacency_edges[k])
        c, a, b = corners[apex], corners[(apex + 1) % 3], corners[(apex + 2) % 3]
        on_side = [a]
        for along in sorted((0.1 * rng.choice(np.arange(1, 10), rng.integers(1, 4), replace=False)).tolist()):
            on_side.append(len(vertices))
            vertices.append((1.0 - along) * part.vertices[a] + along * part.vertices[b])
        on_side.append(b)
        fan = [[first, second, c] for first, second in pairwise(on_side)]
        faces[face] = fan[0]
        faces += fan[1:]
        if needles:
            faces += [[a, on_side[i + 1], on_side[i]] for i in range(1, len(on_side) - 1)]
    return np.array(vertices), np.array(faces)


@given(st.integers(0, 2**32 - 1), st.booleans(), st.sampled_from([0.0, 3e-7]))
def test_a_torn_part_is_whole_again(seed: int, needles: bool, off: float) -> None:
    whole = bushing()
    vertices, faces = _torn(whole, seed, needles)
    vertices = vertices + off * whole.diameter * np.random.default_rng(seed).uniform(-1.0, 1.0, vertices.shape)
    mended = Part.from_mesh(vertices, faces, "torn")
    assert mended.is_closed
    before = trimesh.Trimesh(whole.vertices, whole.faces, process=False)
    after = trimesh.Trimesh(mended.vertices, mended.faces, process=False)
    assert after.volume == pytest.approx(before.volume, rel=1e-4)
    assert after.area == pytest.approx(before.area, rel=1e-4)
    # Every piece lies in the face that it was cut from.
    heights = 2.0 * after.area_faces / np.linalg.norm(np.diff(after.triangles[:, [0, 1, 2, 0]], axis=1), axis=2).max(1)
    assert heights.min() > 0.1


def test_a_torn_part_has_the_edges_of_the_whole_one() -> None:
    whole = bushing()
    mended, edges = Part.from_mesh(*_torn(whole, 1, needles=False), "torn"), sample_edges(whole)
    found = sample_edges(mended)
    assert found.crease.sum() == pytest.approx(edges.crease.sum(), rel=0.01)
    rims = (found.normals_obj[:, 0] == -found.normals_obj[:, 1]).all(1)
    assert not rims.any()


def test_a_torn_part_that_is_inside_out_is_turned() -> None:
    vertices, faces = _torn(bushing(), 2, needles=True)
    part = Part.from_mesh(vertices, faces[:, ::-1], "torn")
    assert part.is_closed
    assert trimesh.Trimesh(part.vertices, part.faces, process=False).volume > 0.0


def test_a_gap_that_is_wider_than_the_tolerance_stays() -> None:
    vertices = np.array([[0.0, 0, 0], [10, 0, 0], [5, 8, 0], [5, 0.02, 0], [5, -8, 0]])
    faces = np.array([[0, 1, 2], [0, 4, 3], [3, 4, 1]])
    np.testing.assert_array_equal(stitched(vertices, faces, 0.01), faces)
    assert len(stitched(vertices, faces, 0.03)) == 4


def test_a_thin_face_is_not_cut_at_its_own_corner() -> None:
    faces = np.array([[0, 1, 2]])
    assert stitched(np.array([[0.0, 0, 0], [10, 0, 0], [5, 0.005, 0]]), faces, 0.01) is faces


def test_vertices_on_all_three_sides_of_a_face() -> None:
    vertices = np.array([[0.0, 0, 0], [10, 0, 0], [0, 10, 0], [3, 0, 0], [6, 0, 0], [5, 5, 0], [0, 4, 0]])
    outside = np.array([[11.0, -9, 0], [9, 9, 0], [-9, 1, 0]])
    around = [[3, 0, 7], [4, 3, 7], [1, 4, 7], [5, 1, 8], [2, 5, 8], [6, 2, 9], [0, 6, 9]]
    faces = stitched(np.vstack([vertices, outside]), np.array([[0, 1, 2], *around]), 1e-3)
    np.testing.assert_array_equal(faces[: len(around)], around)
    pieces = vertices[faces[len(around) :]]
    assert len(pieces) == 5
    areas = 0.5 * np.cross(pieces[:, 1] - pieces[:, 0], pieces[:, 2] - pieces[:, 0])[:, 2]
    assert (areas > 1.0).all()  # all wound as the face was
    assert areas.sum() == pytest.approx(50.0)


@pytest.mark.parametrize(
    ("vertices", "faces"),
    [
        # A vertex on two sides of a sharp corner, one beyond the third corner of a thin face, and two beside one place.
        ([[0, 0, 0], [100, 0, 0], [100, 0.05, 0], [1, 0.0002, 0], [1, -5, 3], [2, -5, -3]], [[0, 1, 2], [3, 4, 5]]),
        ([[0, 0, 0], [100, 0, 0], [50, 3e-4, 0], [30, 8e-4, 0], [30, 50, 0], [60, 50, 0]], [[0, 1, 2], [3, 5, 4]]),
        (
            [
                *([0, 0, 0], [100, 0, 0], [50, 40, 0], [50, 0, -9e-4], [40, -50, 0], [60, -50, 0], [50, 0, 9e-4]),
                *([40, -50, 20], [60, -50, 20]),
            ],
            [[0, 1, 2], [3, 4, 5], [6, 7, 8]],
        ),
    ],
)
def test_no_piece_is_turned_over_or_flat(vertices: list[list[float]], faces: list[list[int]]) -> None:
    before, after = np.array(faces), Part.from_mesh(vertices, faces, "odd")
    triangles = after.vertices[after.faces]
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    assert (np.linalg.norm(normals, axis=1) > 1e-4).all()
    if len(after.faces) == len(before):
        np.testing.assert_array_equal(after.faces, before)


@pytest.mark.parametrize("tolerances", [0.5, 2.0, 5.0, 9.0, 11.0, 5000.0])
def test_an_inside_out_box_with_a_needle_anywhere_is_turned(tolerances: float) -> None:
    vertices, faces = np.array(box((100.0, 100.0, 100.0)).vertices), box().faces.tolist()
    a, b, c = faces[0]
    along = (vertices[b] - vertices[a]) / np.linalg.norm(vertices[b] - vertices[a])
    vertices = np.vstack([vertices, vertices[a] + 1e-4 * tolerances * along])
    faces = [[a, 8, c], [8, b, c], [a, b, 8], *faces[1:]]
    part = Part.from_mesh(vertices, np.array(faces)[:, ::-1], "box")
    assert part.is_closed
    assert trimesh.Trimesh(part.vertices, part.faces, process=False).volume == pytest.approx(1e6)


def test_patches_that_are_cut_alike_are_there_once() -> None:
    vertices = [[0.0, 0, 0], [100, 0, 0], [50, 40, 0], [50, 0, 0], [50, 20, 50]]
    assert len(Part.from_mesh(vertices, [[0, 1, 2], [0, 3, 2], [3, 1, 2]], "patch").faces) == 2


def test_a_slot_far_from_the_origin_stays_open() -> None:
    sheet = np.array([[0.0, 0, 0], [50, 0, 0], [50, 50, 0], [0, 50, 0]])
    other = sheet[[0, 1, 2, 3]] * [0.5, 1.0, 1.0] + [10.0, -50.05, 0.0]
    vertices = np.vstack([sheet, other]) + np.array([20_000.0, 0.0, 0.0])
    faces = [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]]
    assert len(Part.from_mesh(vertices.astype(np.float32), faces, "slot").faces) == 4


@pytest.mark.parametrize("faces", [box().faces, box().faces[2:]], ids=["closed", "open"])
def test_a_mesh_with_nothing_to_put_together_comes_back_as_it_is(faces: IntArray) -> None:
    assert stitched(np.array(box().vertices), faces, 1e-3) is faces


@pytest.mark.parametrize("limit", ["MOST_PAIRS", "MOST_ON_SIDES"])
def test_a_heap_of_loose_triangles_is_left_as_it_is(limit: str, monkeypatch: pytest.MonkeyPatch) -> None:
    vertices, faces = _torn(bushing(), 3, needles=False)
    assert len(stitched(vertices, faces, 1e-3)) > len(faces)
    monkeypatch.setattr(stitching, limit, 0)
    assert stitched(vertices, faces, 1e-3) is faces


def test_memory_chunks_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    vertices, faces = _torn(bushing(), 4, needles=False)
    at_once = stitched(vertices, faces, 1e-3)
    monkeypatch.setattr(stitching, "_CHUNK", 50)
    np.testing.assert_array_equal(stitched(vertices, faces, 1e-3), at_once)
    assert len(at_once) > len(faces)
