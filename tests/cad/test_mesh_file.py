"""Mesh files of every kind come in whole, or end in one line that names the file."""

from __future__ import annotations

import hashlib
import os
import struct
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from meshes import box, step_box

from acp_lab.cad.mesh_file import UNITS_MM, read_mesh_file
from acp_lab.cad.part import Part
from acp_lab.errors import AcpLabError, InputFileError, PartError


def _ascii(mesh: trimesh.Trimesh) -> dict[str, bytes]:
    return {
        "ascii.ply": trimesh.exchange.ply.export_ply(mesh, encoding="ascii"),
        "ascii.stl": trimesh.exchange.stl.export_stl_ascii(mesh).encode(),
        "ascii.obj": trimesh.exchange.obj.export_obj(mesh).encode(),
    }


def _binary(mesh: trimesh.Trimesh) -> dict[str, bytes]:
    return {
        "binary.ply": trimesh.exchange.ply.export_ply(mesh),
        "binary.stl": trimesh.exchange.stl.export_stl(mesh),
    }


FILES = {**_ascii(box()), **_binary(box())}


@pytest.mark.parametrize("name", FILES)
def test_every_kind_of_file_gives_the_same_box(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(FILES[name])
    part = Part.from_file(path)
    assert part.vertices.shape == (8, 3)
    assert part.faces.shape == (12, 3)
    assert part.is_closed
    np.testing.assert_allclose(part.box_size, [40.0, 20.0, 10.0], atol=1e-6)
    assert part.diameter == pytest.approx(np.sqrt(40.0**2 + 20.0**2 + 10.0**2), rel=1e-6)
    assert part.sha256 == hashlib.sha256(FILES[name]).hexdigest()
    assert part.name == name.split(".")[0]
    assert type(part.vertices) is np.ndarray
    assert type(part.faces) is np.ndarray
    assert part.vertices.dtype == np.float64
    assert part.faces.dtype == np.int64


@pytest.mark.parametrize("name", [name for name in FILES if not name.endswith(".obj")])
def test_a_cut_off_file_is_never_read_short(name: str, tmp_path: Path) -> None:
    whole, path = FILES[name], tmp_path / name
    # Every place near the two ends, and a sample of those between. The last three bytes of an ASCII PLY can
    # be missing without a trace (a newline, half a number), so the cut stops before them.
    cuts = {*range(0, 120), *range(120, len(whole) - 60, 37), *range(len(whole) - 60, len(whole) - 3)}
    for cut in sorted(cuts):
        path.write_bytes(whole[:cut])
        with pytest.raises(AcpLabError) as caught:
            Part.from_file(path)
        assert str(caught.value).startswith(str(path))
        assert "\n" not in str(caught.value)


def test_a_cut_off_obj_is_caught_inside_a_line(tmp_path: Path) -> None:
    path = tmp_path / "part.obj"
    path.write_text("v 0 0 0\nv 10 0 0\nv 10 10 0\nv 0 10 0\nf 1 2 3\nf 1 3")
    with pytest.raises(InputFileError, match="cut off"):
        Part.from_file(path)


@pytest.mark.parametrize(
    ("name", "content", "error", "message"),
    [
        ("empty.ply", b"", InputFileError, "the file is empty"),
        ("zeros.stl", b"\0" * 200, InputFileError, "the file is empty"),
        ("notes.txt", b"hello", InputFileError, "unknown mesh type '.txt'"),
        ("noise.ply", bytes(range(256)), InputFileError, "no PLY file"),
        ("noise.stl", bytes(range(256)), InputFileError, "no STL file"),
        ("noise.obj", b"v 1 2 x\nv 4 5 6\nf 1 2 2\n", InputFileError, "OBJ"),
        ("missing.obj", b"v 0 0 0\nv 9 0 0\nv 9 9 0\nf 1 2 7\n", InputFileError, "OBJ"),
        ("nan.obj", b"v 0 0 0\nv nan 0 0\nv 9 9 0\nf 1 2 3\n", PartError, "is no point"),
        ("lines.obj", b"v 0 0 0\nv 9 0 0\nv 9 9 0\nl 1 2 3\n", PartError, "no faces"),
        ("cloud.ply", trimesh.PointCloud(np.eye(3)).export(file_type="ply"), PartError, "no faces"),
    ],
)
def test_unusable_files_end_in_one_line(
    name: str, content: bytes, error: type[AcpLabError], message: str, tmp_path: Path
) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(error, match=message) as caught:
        Part.from_file(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_missing_files_and_folders(tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match="no such mesh file"):
        Part.from_file(tmp_path / "nothing.ply")
    (tmp_path / "folder.ply").mkdir()
    with pytest.raises(InputFileError, match="cannot be read"):
        Part.from_file(tmp_path / "folder.ply")


def test_polygons_and_several_bodies_become_one_triangle_mesh(tmp_path: Path) -> None:
    path = tmp_path / "two.obj"
    path.write_text(
        "mtllib absent.mtl\no a\nv 0 0 0\nv 10 0 0\nv 10 10 0\nv 0 10 0\nusemtl steel\nf 1 2 3 4\n"
        "o b\nv 0 0 5\nv 10 0 5\nv 10 10 5\nf 5 6 7\n"
    )
    part = Part.from_file(path)
    assert part.vertices.shape == (7, 3)
    assert part.faces.shape == (3, 3)
    assert not part.is_closed


def test_a_solid_named_facet_is_not_cut_off(tmp_path: Path) -> None:
    path = tmp_path / "named.stl"
    text = FILES["ascii.stl"].decode().split("\n", 1)[1]
    path.write_text("solid endfacet facet plate\n" + text)
    assert len(Part.from_file(path).faces) == 12


@pytest.mark.parametrize("inches", [False, True])
def test_step_comes_in_mm_whatever_its_unit(inches: bool, tmp_path: Path) -> None:
    pytest.importorskip("cascadio", reason="STEP support is an extra: pip install acp_lab[step]")
    path = tmp_path / "box.step"
    path.write_text(step_box((4.0, 2.0, 1.0), inches=inches))
    part = Part.from_file(path)
    unit = 25.4 if inches else 1.0
    np.testing.assert_allclose(part.box_min, 0.0, atol=1e-6)
    np.testing.assert_allclose(part.box_max, np.array([4.0, 2.0, 1.0]) * unit, rtol=1e-6)
    assert part.vertices.shape == (8, 3)
    assert part.is_closed


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("END-ISO-10303-21;", "END-ISO-10303-21;" + "\n" * 5000),
        ("END-ISO-10303-21;", "END-ISO-10303-21 ;"),
        ("END-ISO-10303-21;", "END-ISO-10303-21;\nSIGNATURE\n" + "A" * 5000 + "\nENDSEC;\n"),
        ("ISO-10303-21;\nHEADER", "\ufeffISO-10303-21;\nHEADER"),
    ],
    ids=["newlines", "blank", "signature", "mark"],
)
def test_whole_step_files_that_are_unusual(old: str, new: str, tmp_path: Path) -> None:
    pytest.importorskip("cascadio", reason="STEP support is an extra: pip install acp_lab[step]")
    path, text = tmp_path / "box.step", step_box((40.0, 20.0, 10.0))
    path.write_text(text.replace(old, new), encoding="utf-8")
    assert path.read_text(encoding="utf-8") != text
    np.testing.assert_allclose(Part.from_file(path).box_size, [40.0, 20.0, 10.0], rtol=1e-6)


def test_damaged_step_files_end_in_one_line(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("cascadio", reason="STEP support is an extra: pip install acp_lab[step]")
    text = step_box((40.0, 20.0, 10.0))
    for content in (text[: len(text) // 2], text[:2000] + "\nENDSEC;\nEND-ISO-10303-21;\n", "solid"):
        path = tmp_path / "box.stp"
        path.write_text(content)
        with pytest.raises(InputFileError) as caught:
            Part.from_file(path)
        assert "\n" not in str(caught.value)
    # OpenCASCADE's own remarks stay off both streams, which are as they were afterwards.
    os.write(1, b"still here")
    assert capfd.readouterr() == ("still here", "")


def test_step_without_its_extra_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "cascadio", None)
    path = tmp_path / "box.step"
    path.write_text(step_box((40.0, 20.0, 10.0)))
    with pytest.raises(PartError, match=r"pip install -e '\.\[step\]'"):
        read_mesh_file(path)


@pytest.mark.parametrize(
    "content", ["raise ImportError('libGL.so.1: cannot open shared object file')", "import no_such_module_at_all"]
)
def test_step_support_that_cannot_be_imported_says_why(
    content: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "cascadio.py").write_text(content)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "cascadio", raising=False)
    path = tmp_path / "box.step"
    path.write_text(step_box((40.0, 20.0, 10.0)))
    reason = r"\((libGL\.so\.1: cannot open|No module named 'no_such_module_at_all')"
    with pytest.raises(PartError, match=f"cascadio, which is installed but cannot be imported {reason}"):
        read_mesh_file(path)


@pytest.mark.parametrize("name", ["ascii.ply", "binary.ply", "ascii.obj", "ascii.stl"])
def test_latin_1_in_a_comment_does_no_harm(name: str, tmp_path: Path) -> None:
    word = "Größe".encode("latin-1")
    places = {".ply": (b"end_header", b"comment " + word + b"\nend_header"), ".stl": (b"solid", b"solid " + word)}
    old, new = places.get(Path(name).suffix, (b"v ", b"# " + word + b"\nv "))
    data = FILES[name].replace(old, new, 1)
    assert word in data
    path = tmp_path / name
    path.write_bytes(data)
    part = Part.from_file(path)
    np.testing.assert_array_equal(part.vertices, Part.from_file(_written(tmp_path / f"plain_{name}", name)).vertices)
    assert part.sha256 == hashlib.sha256(data).hexdigest()


def _written(path: Path, name: str) -> Path:
    path.write_bytes(FILES[name])
    return path


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (b"v 1 2", "a vertex has 2 numbers"),
        (b"v 1e308 2 3", r"a vertex is \[1e\+308, 2.0, 3.0\]"),
        (b"v 1" + b"0" * 400 + b" 2 3", r"a vertex is \[inf, 2.0, 3.0\]"),
        (b"v nan 2 3", r"a vertex is \[nan, 2.0, 3.0\]"),
        (b"v 2e9 2 3", r"a vertex is \[2000000000.0, 2.0, 3.0\]"),
        (b"v one 2 3", "damaged"),
    ],
)
@pytest.mark.filterwarnings("error")
def test_vertices_that_are_no_points(line: bytes, message: str, tmp_path: Path) -> None:
    lines = FILES["ascii.obj"].split(b"\n")
    chosen = [number for number, text in enumerate(lines) if text.startswith(b"v ")][3]
    path = tmp_path / "part.obj"
    path.write_bytes(b"\n".join([*lines[:chosen], line, *lines[chosen + 1 :]]))
    with pytest.raises(AcpLabError, match=f"part.obj: {message}"):
        Part.from_file(path)


def test_obj_vertices_may_all_lack_a_number(tmp_path: Path) -> None:
    lines = [b"v 1 2" if text.startswith(b"v ") else text for text in FILES["ascii.obj"].split(b"\n")]
    (tmp_path / "part.obj").write_bytes(b"\n".join(lines))
    with pytest.raises(InputFileError, match="2 numbers"):
        read_mesh_file(tmp_path / "part.obj")


@pytest.mark.parametrize("unit", UNITS_MM)
def test_units(unit: str, tmp_path: Path) -> None:
    path = _written(tmp_path / "part.ply", "binary.ply")
    plain, scaled = read_mesh_file(path), read_mesh_file(path, unit)
    np.testing.assert_array_equal(scaled.vertices, UNITS_MM[unit] * plain.vertices)
    assert scaled.sha256 == plain.sha256
    with pytest.raises(PartError, match="unit 'foot': choose one of mm, cm, m, inch"):
        read_mesh_file(path, "foot")
    (tmp_path / "part.step").write_bytes(b"ISO-10303-21;")
    if unit != "mm":
        with pytest.raises(PartError, match="STEP file says its unit itself"):
            read_mesh_file(tmp_path / "part.step", unit)


def test_a_mesh_of_too_many_faces_is_refused(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("acp_lab.cad.part.MOST_FACES", 11)
    with pytest.raises(PartError, match=r"part\.ply: has 12 faces, 11 is the most"):
        Part.from_file(_written(tmp_path / "part.ply", "binary.ply"))


def _channel() -> tuple[np.ndarray, list[list[int]]]:
    """A U-channel of 60 x 40 x 30 mm in polygons: two concave caps of eight corners, and eight walls."""
    profile = np.array([[0, 0], [60, 0], [60, 40], [50, 40], [50, 10], [10, 10], [10, 40], [0, 40]], dtype=float)
    vertices = np.vstack([np.column_stack([profile, np.full(8, height)]) for height in (0.0, 30.0)])
    walls = [[i, (i + 1) % 8, (i + 1) % 8 + 8, i + 8] for i in range(8)]
    return vertices, [[*range(7, -1, -1)], [*range(8, 16)], *walls]


def _obj(vertices: np.ndarray, faces: list[list[int]], corner: str = "{}") -> str:
    lines = ["v {:g} {:g} {:g}".format(*vertex) for vertex in vertices]
    return "\n".join([*lines, *("f " + " ".join(corner.format(i + 1) for i in face) for face in faces)]) + "\n"


def _ply(vertices: np.ndarray, faces: list[list[int]], kind: str = "ascii") -> bytes:
    header = f"ply\nformat {kind} 1.0\nelement vertex {len(vertices)}\nproperty float x\nproperty float y\n"
    header += f"property float z\nelement face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    if kind == "ascii":
        lines = ["{:g} {:g} {:g}".format(*vertex) for vertex in vertices]
        lines += [" ".join(map(str, [len(face), *face])) for face in faces]
        return (header + "\n".join(lines) + "\n").encode()
    rows = b"".join(struct.pack(f"<B{len(face)}i", len(face), *face) for face in faces)
    return header.encode() + vertices.astype("<f4").tobytes() + rows


@pytest.mark.parametrize("name", ["plain.obj", "normals.obj", "ascii.ply"])
def test_concave_polygons_are_filled(name: str, tmp_path: Path) -> None:
    vertices, faces = _channel()
    path = tmp_path / name
    if name.endswith(".ply"):
        path.write_bytes(_ply(vertices, faces))
    else:
        normals = "vn 0 0 1\n" if name == "normals.obj" else ""
        path.write_text(normals + _obj(vertices, faces, "{}//1" if normals else "{}"))
    part = Part.from_file(path)
    assert part.is_closed
    assert len(part.faces) == 28
    a, b, c = part.vertices[part.faces].transpose(1, 0, 2)
    areas = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    assert areas.sum() == pytest.approx(2 * (60 * 40 - 40 * 30) + 30 * (200 + 60))
    on_caps = np.abs(part.face_normals[:, 2]) > 0.5
    assert areas[on_caps].sum() == pytest.approx(2 * 1200)


def test_binary_polygons_of_one_size_are_filled(tmp_path: Path) -> None:
    vertices, faces = _channel()
    path = tmp_path / "cap.ply"
    path.write_bytes(_ply(vertices, faces[:2], "binary_little_endian"))
    mesh = read_mesh_file(path)
    a, b, c = mesh.vertices[mesh.faces].transpose(1, 0, 2)
    assert 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() == pytest.approx(2 * 1200)


def test_binary_polygons_of_several_sizes_are_refused_for_that_reason(tmp_path: Path) -> None:
    path = tmp_path / "mixed.ply"
    path.write_bytes(_ply(*_channel(), "binary_little_endian"))
    with pytest.raises(InputFileError, match=r"mixed\.ply: .*faces of several sizes\): export it again, as triangles"):
        Part.from_file(path)


@pytest.mark.parametrize("name", ["crossed.obj", "crossed.ply"])
def test_a_face_that_crosses_itself_is_refused(name: str, tmp_path: Path) -> None:
    vertices = np.array([[0, 0, 0], [40, 20, 0], [40, 0, 0], [0, 21, 0], [-5, 10, 0]], dtype=float)
    path = tmp_path / name
    text = _obj(vertices, [[0, 1, 2, 3, 4]]).encode() if name.endswith(".obj") else _ply(vertices, [[0, 1, 2, 3, 4]])
    path.write_bytes(text)
    with pytest.raises(InputFileError, match=f"{name}: a face of 5 corners crosses itself: export it as triangles"):
        Part.from_file(path)


def test_a_polygon_of_a_ply_file_may_name_no_vertex(tmp_path: Path) -> None:
    path = tmp_path / "part.ply"
    path.write_bytes(_ply(np.eye(3) * 9.0, [[0, 1, 2], [0, 1, 2, 7]]))
    with pytest.raises(AcpLabError, match=r"part\.ply: a face names vertex 7 of 3"):
        Part.from_file(path)


def _two_bodies_counted_backwards() -> str:
    text = ""
    for shift in (0.0, 60.0):
        mesh = box()
        text += "".join(f"v {x + shift:g} {y:g} {z:g}\nvt 0 0\n" for x, y, z in mesh.vertices)
        text += "".join("f " + " ".join(f"{i - 8}/{i - 8}" for i in face) + "\n" for face in mesh.faces)
    return text


def test_an_obj_may_count_its_vertices_backwards(tmp_path: Path) -> None:
    path = tmp_path / "two.obj"
    path.write_text(_two_bodies_counted_backwards())
    part = Part.from_file(path)
    assert part.vertices.shape == (16, 3)
    assert part.faces.shape == (24, 3)
    assert part.is_closed
    np.testing.assert_allclose(part.box_size, [100.0, 20.0, 10.0])


def test_an_obj_that_counts_back_too_far(tmp_path: Path) -> None:
    path = tmp_path / "part.obj"
    path.write_text("v 0 0 0\nv 9 0 0\nf -1 -2 -3\nv 9 9 0\n")
    with pytest.raises(InputFileError, match=r"part\.obj: a face names vertex -3, but 2 stand before it"):
        Part.from_file(path)


@pytest.mark.parametrize(
    ("face", "what"),
    [
        ("f 0 1 2", "vertex"),
        ("f 2 1 0", "vertex"),
        ("f 1/1/1 00/1/1 2/1/1", "vertex"),
        ("f 0/0/0 1/1/1 2/2/2", "vertex"),
        ("f -1 -0 -2", "vertex"),
        ("f 1/0/1 2/0/1 3/0/1", "texture point or normal"),
        ("f 1//1 2//1 3//0", "texture point or normal"),
    ],
)
def test_an_obj_counts_from_1(face: str, what: str, tmp_path: Path) -> None:
    path = tmp_path / "part.obj"
    rest = "v 0 0 0\nv 9 0 0\nv 9 9 0\nvt 0 0\nvt 0 0\nvt 0 0\nvn 0 0 1\nvn 0 0 1\n"
    for text in (f"{rest}f 1 2 3\n{face}\n", f"{rest}  {face} # the last", f"{face}\n{rest}"):
        path.write_text(text)
        with pytest.raises(InputFileError, match=rf"part\.obj: a face names {what} 0, but OBJ counts from 1"):
            read_mesh_file(path)


def test_an_obj_has_other_zeros_than_indices(tmp_path: Path) -> None:
    path = tmp_path / "part.obj"
    faces = "".join(f"f {a} {b} {c}\n" for a, b, c in box().faces + 10)
    vertices = "".join(f"v {x:g} {y:g} {z:g}\n" for x, y, z in box().vertices)
    path.write_text("v 0 0 0\n" * 9 + f"{vertices}vt 0 0\nvn 0 0 1\n# f 0\no f 0\ns 0\n{faces}")
    np.testing.assert_allclose(Part.from_file(path).box_size, [40.0, 20.0, 10.0])


def _stl(text: str) -> bytes:
    return FILES["ascii.stl"].replace(b"solid", text.encode(), 1)


BINARY_STL = FILES["binary.stl"]
OBJ = FILES["ascii.obj"]


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("tabs.obj", OBJ.replace(b" ", b"\t")),
        ("indented.obj", OBJ.replace(b"\n", b"\n  ")),
        ("remarks.obj", OBJ.replace(b"\n", b" # a remark\n")),
        ("marked.obj", b"\xef\xbb\xbf" + OBJ[OBJ.index(b"v ") :]),
        ("old_mac.obj", OBJ.replace(b"\n", b"\r")),
        ("folder.obj", b"# C:\\parts\\\n" + OBJ[OBJ.index(b"v ") :]),
        ("blank_line.stl", _stl("\n solid")),
        ("marked.stl", _stl("\ufeffsolid")),
        ("named_solid.stl", b"solid made by a facet tool".ljust(80) + BINARY_STL[80:]),
        ("one_more.stl", BINARY_STL + b"\n"),
        ("zeros_more.stl", BINARY_STL + bytes(100)),
    ],
)
def test_legal_files_that_are_unusual(name: str, data: bytes, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(data)
    part = Part.from_file(path)
    assert part.vertices.shape == (8, 3)
    assert part.faces.shape == (12, 3)
    assert part.is_closed


@pytest.mark.parametrize("missing", [1, 5])
def test_an_ascii_ply_with_more_than_it_promises_is_refused(missing: int, tmp_path: Path) -> None:
    path = tmp_path / "more.ply"
    path.write_bytes(FILES["ascii.ply"].replace(b"element face 12", b"element face %d" % (12 - missing)))
    promised = f"holds 20 lines, but its header promises 8 vertices and {12 - missing} faces: export it again"
    with pytest.raises(InputFileError, match=rf"more\.ply: {promised}"):
        Part.from_file(path)
    path.write_bytes(FILES["ascii.ply"] + b"\n \n")
    assert len(Part.from_file(path).faces) == 12


def test_a_binary_stl_with_more_than_it_promises_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "more.stl"
    path.write_bytes(BINARY_STL + b"\1" * 50)
    with pytest.raises(InputFileError, match=r"more\.stl: cut off or no STL file"):
        Part.from_file(path)
