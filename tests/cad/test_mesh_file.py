"""Mesh files of every kind come in whole, or end in one line that names the file."""

from __future__ import annotations

import hashlib
import os
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from meshes import box, step_box

from acp_lab.cad.mesh_file import read_mesh_file
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
