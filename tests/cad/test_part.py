"""A part's mesh is clean, its sizes are right, and a wrong unit is noticed."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from meshes import box, bushing
from scipy.spatial import ConvexHull
from scipy.spatial.distance import cdist

from acp_lab.cad.edges import sample_edges
from acp_lab.cad.part import Part, PartInfo, Symmetries, clean_mesh, largest_distance, read_models_info
from acp_lab.errors import InputFileError, PartError
from acp_lab.sample import sample_dataset


def _soup(mesh: trimesh.Trimesh) -> tuple[np.ndarray, np.ndarray]:
    """The mesh as STL stores it: every face with three vertices of its own."""
    vertices = np.array(mesh.vertices)[mesh.faces].reshape(-1, 3)
    return vertices, np.arange(len(vertices)).reshape(-1, 3)


def test_duplicate_vertices_are_merged_and_the_order_stays() -> None:
    mesh = trimesh.creation.icosphere(2, radius=20.0)
    part = Part.from_mesh(*_soup(mesh), "ball")
    assert part.vertices.shape == mesh.vertices.shape
    assert part.faces.shape == mesh.faces.shape
    np.testing.assert_array_equal(part.vertices[part.faces], mesh.vertices[mesh.faces])
    assert part.is_closed
    # The first vertex of the file stays the first one.
    np.testing.assert_array_equal(part.faces[0], [0, 1, 2])


def test_a_clean_mesh_stays_as_it_is() -> None:
    mesh = box()
    part = Part.from_mesh(mesh.vertices, mesh.faces, "box")
    np.testing.assert_array_equal(part.vertices, mesh.vertices)
    np.testing.assert_array_equal(part.faces, mesh.faces)


@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 500.0]))
def test_vertices_apart_by_float32_rounding_are_one(seed: int, away: float) -> None:
    vertices, faces = _soup(box())
    vertices = vertices + away
    rounding = np.random.default_rng(seed).uniform(-1.0, 1.0, vertices.shape)
    vertices = (vertices + rounding * np.spacing(np.float32(away + 20))).astype(np.float32)
    part = Part.from_mesh(vertices, faces, "box")
    assert part.vertices.shape == (8, 3)
    assert part.is_closed


def test_small_details_are_not_merged() -> None:
    # A chamfer of a hundredth of a millimetre on a part of 400 mm.
    mesh = box((400.0, 0.01, 0.01))
    assert len(Part.from_mesh(mesh.vertices, mesh.faces, "wire").vertices) == 8


def test_faces_without_area_and_unused_vertices_are_dropped() -> None:
    mesh = box()
    stray = np.vstack([[[900.0, 0.0, 0.0]], mesh.vertices, [[0.0, 700.0, 0.0]]])
    middle = 0.5 * (stray[1] + stray[2])
    vertices = np.vstack([stray, middle])
    faces = np.vstack([[[1, 1, 2]], mesh.faces + 1, [[1, 2, 10]]])
    part = Part.from_mesh(vertices, faces, "box")
    np.testing.assert_array_equal(part.vertices, mesh.vertices)
    np.testing.assert_array_equal(part.faces, mesh.faces)


def test_a_closed_mesh_inside_out_is_turned_back() -> None:
    mesh = box()
    part = Part.from_mesh(mesh.vertices + 100.0, mesh.faces[:, ::-1], "box")
    centres = part.vertices[part.faces].mean(axis=1) - part.box_centre
    assert (np.einsum("ij,ij->i", part.face_normals, centres) > 0.0).all()


def test_the_winding_of_an_open_mesh_is_kept() -> None:
    mesh = box()
    open_faces = mesh.faces[:10, ::-1]
    part = Part.from_mesh(mesh.vertices, open_faces, "tray")
    assert not part.is_closed
    np.testing.assert_array_equal(part.faces, open_faces)


def test_a_cavity_keeps_its_inward_winding() -> None:
    outer, inner = box(), box((20.0, 10.0, 5.0))
    faces = np.vstack([outer.faces, inner.faces[:, ::-1] + 8])
    part = Part.from_mesh(np.vstack([outer.vertices, inner.vertices]), faces, "hollow")
    np.testing.assert_array_equal(part.faces, faces)
    assert part.is_closed


@given(st.sets(st.integers(0, 11), max_size=12), st.booleans())
def test_faces_wound_another_way_than_their_neighbours_are_reversed(reversed_: set[int], is_open: bool) -> None:
    """A closed box comes out as it was; of one without a side the fewer are reversed."""
    mesh = box()
    faces = np.array(mesh.faces)
    for face in reversed_:
        faces[face] = faces[face, ::-1]
    count = len(faces) - 2 * is_open
    part = Part.from_mesh(mesh.vertices, faces[:count], "box")
    assert part.is_closed != is_open
    wrong = len({face for face in reversed_ if face < count})
    outward = np.einsum("ij,ij->i", part.face_normals, part.vertices[part.faces].mean(1) - mesh.centroid) > 0.0
    if not is_open or 2 * wrong < count:
        assert outward.all()
    elif 2 * wrong > count:
        assert not outward.any()
    else:
        assert outward.all() or not outward.any()


def test_a_strip_without_two_sides_stays_as_it_is() -> None:
    """Moebius: the last pair of triangles meets the first one upside down."""
    count = 20
    angle = 2.0 * np.pi * np.arange(count) / count
    across = np.stack([np.cos(angle / 2) * np.cos(angle), np.cos(angle / 2) * np.sin(angle), np.sin(angle / 2)], 1)
    middle = 40.0 * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], 1)
    vertices = np.stack([middle - 8.0 * across, middle + 8.0 * across], 1).reshape(-1, 3)
    corners = [(2 * k, 2 * k + 1, *((2 * k + 2, 2 * k + 3) if k < count - 1 else (1, 0))) for k in range(count)]
    faces = np.array([face for a, b, c, d in corners for face in ((a, b, c), (c, b, d))])
    np.testing.assert_array_equal(Part.from_mesh(vertices, faces, "strip").faces, faces)


def test_no_path_is_no_part() -> None:
    with pytest.raises(InputFileError, match="None: is no path of a mesh file"):
        Part.from_file(None)  # type: ignore[arg-type]


def test_a_cavity_stays_one_where_a_face_around_it_is_reversed() -> None:
    outer, inner = box(), box((20.0, 10.0, 5.0))
    right = np.vstack([outer.faces, inner.faces[:, ::-1] + 8])
    wrong = right.copy()
    wrong[0] = wrong[0, ::-1]
    vertices = np.vstack([outer.vertices, inner.vertices])
    normals = Part.from_mesh(vertices, right, "hollow").face_normals
    np.testing.assert_allclose(Part.from_mesh(vertices, wrong, "hollow").face_normals, normals)


def _joined(*bodies: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Several meshes as one."""
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in bodies)])
    faces = [faces + start for (_, faces), start in zip(bodies, starts, strict=False)]
    return np.concatenate([vertices for vertices, _ in bodies]), np.concatenate(faces)


def _box_at(x: float, size: tuple[float, float, float], is_inverted: bool = False) -> tuple[np.ndarray, np.ndarray]:
    mesh = box(size)
    return mesh.vertices + np.array([x, 0.0, 0.0]), mesh.faces[:, ::-1] if is_inverted else np.array(mesh.faces)


BIG, SMALL, TINY = (40.0, 20.0, 10.0), (20.0, 10.0, 5.0), (8.0, 4.0, 2.0)


@pytest.mark.parametrize("is_open", [False, True])
def test_one_body_that_is_inside_out_among_several_is_turned(is_open: bool) -> None:
    vertices, faces = _joined(_box_at(0.0, BIG), _box_at(60.0, SMALL, True), _box_at(-60.0, SMALL, True))
    right = _joined(_box_at(0.0, BIG), _box_at(60.0, SMALL), _box_at(-60.0, SMALL))[1]
    if is_open:  # the last one lacks a side, and nothing says which way its normals should point
        faces, right = faces[:-2], np.concatenate([right[:-12], faces[-12:-2]])
    part = Part.from_mesh(vertices, faces, "three")
    np.testing.assert_array_equal(np.sort(part.faces, axis=1), np.sort(right, axis=1))
    np.testing.assert_allclose(part.face_normals, Part.from_mesh(vertices, right, "three").face_normals)


def test_a_hollow_body_is_turned_with_its_cavity_and_what_is_beside_it_is_not() -> None:
    right = _joined(_box_at(0.0, BIG), _box_at(0.0, SMALL, True), _box_at(60.0, BIG))
    wrong = _joined(_box_at(0.0, BIG, True), _box_at(0.0, SMALL), _box_at(60.0, BIG))
    part = Part.from_mesh(*wrong, "hollow")
    np.testing.assert_allclose(part.face_normals, Part.from_mesh(*right, "hollow").face_normals)


def test_a_body_in_the_recess_of_another_is_not_inside_it() -> None:
    """Though its box lies within the other's."""
    profile = [[8.0, 0.0], [20.0, 0.0], [20.0, 30.0], [8.0, 30.0], [8.0, 0.0]]
    tube = trimesh.creation.revolve(np.array(profile), sections=24)
    middle = np.array([0.0, 0.0, 15.0])
    vertices, faces = _box_at(0.0, (4.0, 4.0, 10.0), True)
    pair = _joined((np.array(tube.vertices), np.array(tube.faces)), (vertices + middle, faces))
    part = Part.from_mesh(*pair, "pin")
    centres = part.vertices[part.faces[-12:]].mean(axis=1) - middle
    assert (np.einsum("ij,ij->i", part.face_normals[-12:], centres) > 0.0).all()


def test_a_body_inside_a_cavity_keeps_its_winding() -> None:
    vertices, faces = _joined(_box_at(0.0, BIG), _box_at(0.0, SMALL, True), _box_at(0.0, TINY))
    np.testing.assert_array_equal(Part.from_mesh(vertices, faces, "rattle").faces, faces)


def test_second_copies_of_faces_are_dropped() -> None:
    mesh = box()
    copies = np.roll(np.concatenate([mesh.faces[:3], mesh.faces[:3]]), 1, axis=1)
    part = Part.from_mesh(mesh.vertices, np.concatenate([mesh.faces[:6], copies, mesh.faces[6:]]), "box")
    np.testing.assert_array_equal(part.faces, mesh.faces)
    assert part.is_closed
    edges = sample_edges(part)
    assert len(edges) == len(sample_edges(Part.from_mesh(mesh.vertices, mesh.faces, "box")))


def test_a_sheet_with_two_sides_keeps_both() -> None:
    mesh = box()
    front = mesh.faces[:2]
    part = Part.from_mesh(mesh.vertices, np.concatenate([front, front[:, ::-1]]), "sheet")
    assert len(part.faces) == 4


@pytest.mark.parametrize("away", [2e4, 1e6])
def test_an_origin_far_away_costs_no_detail_of_float64_numbers(away: float) -> None:
    """Slivers of a finely cut bore are far below what float32 could tell there."""
    part = Part.from_file(sample_dataset() / "models" / "obj_000001.ply")
    far = Part.from_mesh(part.vertices + away, part.faces, "far")
    np.testing.assert_array_equal(far.faces, part.faces)
    assert len(sample_edges(far)) == len(sample_edges(part))


@pytest.mark.parametrize("unit_mm", [1.0, 25.4, 1000.0])
def test_float32_numbers_far_from_the_origin(unit_mm: float) -> None:
    """Noticed in the file's unit, in which they are float32."""
    mesh = trimesh.creation.icosphere(2, radius=20.0)
    stored = ((np.array(mesh.vertices) + 3000.0) / unit_mm).astype(np.float32)
    soup = stored[mesh.faces].reshape(-1, 3)
    noisy = soup + np.random.default_rng(0).integers(-1, 2, soup.shape).astype(np.float32) * np.spacing(soup)
    vertices, _ = clean_mesh(unit_mm * noisy.astype(float), np.arange(len(soup)).reshape(-1, 3), "ball", unit_mm)
    assert len(vertices) == len(mesh.vertices)
    far = unit_mm * (stored + np.float32(1e6 / unit_mm)).astype(float)
    with pytest.raises(PartError, match=r"ball: is 40 mm large .* up to 1e\+06 mm.*: put the CAD origin near the part"):
        clean_mesh(far, mesh.faces, "ball", unit_mm)


@pytest.mark.parametrize("away", [6e3, 1e6, 1e8])
@pytest.mark.parametrize("suffix", [".stl", ".ply"])
def test_a_single_vertex_far_away_is_named(away: float, suffix: str, tmp_path: Path) -> None:
    mesh = box()
    vertices = np.array(mesh.vertices)
    vertices[3] = (away, 0.0, 5.0)
    path = tmp_path / f"spike{suffix}"
    trimesh.Trimesh(vertices, mesh.faces, process=False).export(path)
    told = re.escape(f"{path}: a vertex is [{away}, 0.0, 5.0], far from all others")
    with pytest.raises(PartError, match=told):
        Part.from_file(path)


def test_a_part_far_too_large_has_no_stray_vertex() -> None:
    with pytest.raises(PartError, match="more than 5 m"):
        Part.from_mesh(1000.0 * np.array(box().vertices), box().faces, "box")


def test_sizes_and_normals() -> None:
    mesh = box()
    part = Part.from_mesh(mesh.vertices + np.array([1.0, 2.0, 3.0]), mesh.faces, "box")
    np.testing.assert_allclose(part.box_centre, [1.0, 2.0, 3.0])
    np.testing.assert_allclose(part.box_size, [40.0, 20.0, 10.0])
    assert part.radius == pytest.approx(part.diameter / 2.0)
    np.testing.assert_allclose(np.linalg.norm(part.face_normals, axis=1), 1.0)
    np.testing.assert_allclose(part.face_normals, mesh.face_normals, atol=1e-12)


def test_a_part_cannot_be_changed() -> None:
    part = bushing()
    with pytest.raises(dataclasses.FrozenInstanceError):
        part.diameter = 1.0  # type: ignore[misc]
    for array in (part.vertices, part.faces, part.box_min, part.box_max, part.face_normals):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


def test_the_hash_of_arrays_follows_their_content() -> None:
    mesh = box()
    one, same = (Part.from_mesh(mesh.vertices, mesh.faces, name) for name in ("a", "b"))
    other = Part.from_mesh(mesh.vertices * 2.0, mesh.faces, "a")
    assert one.sha256 == same.sha256 != other.sha256
    assert len(one.sha256) == 64
    assert one.path is None


@given(st.integers(0, 2**32 - 1), st.integers(2, 60), st.sampled_from([0.0, 0.01, 1.0]))
def test_largest_distance_is_that_of_all_pairs(seed: int, count: int, thickness: float) -> None:
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(count, 3)) * [30.0, 20.0, 10.0 * thickness] + rng.normal(size=3) * 100.0
    pairs = np.linalg.norm(points[:, None] - points, axis=2)
    assert largest_distance(points) == pytest.approx(pairs.max(), rel=1e-6)


@pytest.mark.parametrize("shape", ["sphere", "bumps", "dome", "egg"])
def test_largest_distance_of_a_fine_round_body(shape: str) -> None:
    # Nearly every vertex is on the hull and many are nearly as far apart as the farthest two.
    ball = trimesh.creation.icosphere(subdivisions=5, radius=30.0)
    points = np.array(ball.vertices) + np.array([50.0, 0.0, -20.0])  # 10,242
    middle = points.mean(axis=0)
    if shape == "bumps":
        points = middle + (points - middle) * (1.0 + 0.01 * np.sin(0.3 * points).sum(axis=1, keepdims=True))
    elif shape == "dome":
        points = points[points[:, 2] >= middle[2]]
    elif shape == "egg":
        points = middle + (points - middle) * [1.0, 0.999, 0.998]
    hull = points[ConvexHull(points).vertices]
    pairs = max(float(cdist(rows, hull).max()) for rows in np.array_split(hull, 200))
    assert largest_distance(points) == pytest.approx(pairs, rel=1e-6)


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        (np.zeros((0, 3)), np.zeros((0, 3), dtype=int), "no faces"),
        (np.eye(3) * 9.0, np.zeros((0, 3), dtype=int), "no faces"),
        (np.eye(3) * 9.0, [[0, 1, 3]], "names vertex 3 of 3"),
        (np.eye(3) * 9.0, [[0, 1, -1]], "names vertex -1 of 3"),
        (np.eye(3) * 9.0, [[0, 1, 1]], "zero area"),
        ([[0, 0, 0], [9, 0, 0], [18, 0, 0]], [[0, 1, 2]], "zero area"),
        ([[0, 0, 0], [9, np.inf, 0], [18, 9, 0]], [[0, 1, 2]], "is no point"),
        (np.zeros((4, 2)), [[0, 1, 2]], "must be"),
        (np.eye(3) * 9.0, [[0, 1, 2, 2]], "must be"),
    ],
)
def test_unusable_arrays(vertices: object, faces: object, message: str) -> None:
    with pytest.raises(PartError, match=f"part 'bad': .*{message}"):
        Part.from_mesh(vertices, faces, "bad")  # type: ignore[arg-type]


def _info(diameter: float) -> PartInfo:
    return PartInfo(diameter, np.zeros(3), np.ones(3), Symmetries.none(), Path("models_info.json"))


@pytest.mark.parametrize(
    ("scale", "info_diameter", "message"),
    [
        (0.001, None, "looks like metres: scale by 1000"),
        (1000.0, None, "more than 5 m"),
        (0.001, 45.83, "the mesh looks like metres: scale by 1000"),
        (1 / 25.4, 45.83, "the mesh looks like inches: scale by 25.4"),
        (0.1, 45.83, "the mesh looks like centimetres: scale by 10"),
        (1000.0, 45.83, "the mesh looks like micrometres: scale by 0.001"),
        (1.0, 0.04583, "the latter looks like metres"),
        (1.0, 45.83 / 25.4, "the latter looks like inches"),
        (1.0, 47.0, "box.stl: .*models_info.json: these are two meshes"),
        (1.0, 44.5, "box.stl: .*models_info.json: these are two meshes"),
    ],
)
def test_a_wrong_unit_is_noticed(scale: float, info_diameter: float | None, message: str, tmp_path: Path) -> None:
    path = tmp_path / "box.stl"
    box((40.0 * scale, 20.0 * scale, 10.0 * scale)).export(path)
    info = None if info_diameter is None else _info(info_diameter)
    with pytest.raises(PartError, match=message) as caught:
        Part.from_file(path, info)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("info_diameter", [45.83, None])
def test_a_unit_that_was_given_is_doubted_first(info_diameter: float | None, tmp_path: Path) -> None:
    """The mesh is in mm: neither it nor models_info.json is to be scaled."""
    path = tmp_path / "box.stl"
    box((40.0, 20.0, 10.0)).export(path)
    info, unit = (None, "m") if info_diameter is None else (_info(info_diameter), "inch")
    with pytest.raises(PartError, match=rf"with --unit {unit} its diameter .*: leave --unit out, or check it"):
        Part.from_file(path, info, unit)


def test_models_info_has_the_last_word_on_the_diameter(tmp_path: Path) -> None:
    path = tmp_path / "box.stl"
    box().export(path)
    part = Part.from_file(path, dataclasses.replace(_info(46.0), symmetries=Symmetries(np.eye(4)[None])))
    assert part.diameter == 46.0
    assert part.symmetries


def test_the_shared_parts(shared_data: Path) -> None:
    for models in sorted(shared_data.glob("*/models")):
        for number, info in read_models_info(models / "models_info.json").items():
            path = models / f"obj_{number:06d}.ply"
            part = Part.from_file(path, info)
            raw = trimesh.load(path, process=False)
            # These meshes are clean: reading leaves them alone, so ADD over the vertices is everybody's ADD.
            np.testing.assert_array_equal(part.vertices, raw.vertices)
            assert part.is_closed
            assert part.diameter == pytest.approx(largest_distance(part.vertices), rel=1e-6)
            np.testing.assert_allclose(part.box_min, info.box_min, atol=1e-5)
            np.testing.assert_allclose(part.box_max, info.box_max, atol=1e-5)
