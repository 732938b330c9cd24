"""Notebook 10's settings: the reader's files, or the stand-ins, and never half of both."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from acp_lab.course import own_files as module
from acp_lab.course.own_files import OwnFiles, keep_camera, own_files, part_in_mm, size_by_unit
from acp_lab.course.stand_ins import StandIns, stand_in_camera
from acp_lab.errors import InputFileError, PartError
from acp_lab.geometry.camera import Camera


@pytest.fixture
def home(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A home folder with a mesh (30 x 40 x 120, diameter 130), a video, boards and a camera."""
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("USERPROFILE", str(tmp_path))
    monkeypatch.setenv("ACP_LAB_COURSE", str(tmp_path / "course"))
    trimesh.creation.box((30.0, 40.0, 120.0)).export(tmp_path / "part.stl")
    for name in ("clip.mp4", "CAMERA.json"):
        (tmp_path / name).write_text("x")
    (tmp_path / "boards").mkdir()
    return tmp_path


def test_own_files_are_found_in_the_home_folder(home: Path) -> None:
    files = own_files("~/part.stl", "~/clip.mp4", "~/boards")
    assert (files.mesh, files.video, files.boards) == (home / "part.stl", home / "clip.mp4", home / "boards")
    assert files.are_yours
    assert files.mesh_unit_mm == 1.0
    assert files.results == home / "course" / "clip"
    assert files.results.is_dir()
    with_camera = own_files("~/part.stl", home / "clip.mp4", "~/boards", "~/CAMERA.json")
    assert with_camera.boards is None
    assert with_camera.camera == home / "CAMERA.json"
    assert "CAMERA.json" in str(with_camera)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"mesh": "~/part.stl"}, "MESH without VIDEO"),
        ({"video": "~/clip.mp4", "boards": "~/boards"}, "VIDEO, BOARDS without MESH"),
        ({"boards": "~/boards"}, "BOARDS without MESH and VIDEO"),
        ({"mesh": "~/part.stl", "video": "~/clip.mp4"}, "without BOARDS or CAMERA"),
        ({"mesh": "~/part.stl", "video": "~/clop.mp4", "boards": "~/boards"}, r"VIDEO: .*clop\.mp4 is not there"),
        ({"mesh": "~/part.stl", "video": "~/clip.mp4", "boards": "~/bards"}, r"BOARDS: .*bards is not there"),
        ({"mesh": "~/port.stl", "video": "~/clip.mp4", "camera": "~/CAMERA.json"}, r"MESH: .*port\.stl is not there"),
    ],
)
def test_half_of_them_and_wrong_paths_are_refused(home: Path, given: dict[str, str], words: str) -> None:
    with pytest.raises(InputFileError, match=words):
        own_files(**given)  # type: ignore[arg-type]
    assert not (home / "course" / "stand_ins").exists()


def test_without_any_the_stand_ins_are_taken(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = StandIns(home / "part.stl", home / "boards", home / "clip.mp4", stand_in_camera())
    monkeypatch.setattr(module, "stand_ins", lambda folder: made)
    files = own_files()
    assert (files.mesh, files.video, files.boards, files.camera) == (made.mesh, made.video, made.boards, None)
    assert not files.are_yours
    assert files.mesh_unit_mm == 1000.0
    assert own_files(mesh_unit_mm=1.0).mesh_unit_mm == 1.0


@pytest.mark.parametrize(("in_file", "unit_mm"), [(1.0, None), (1.0 / 25.4, 25.4), (0.001, 1000.0)])
def test_the_part_is_in_mm(home: Path, in_file: float, unit_mm: float | None) -> None:
    files = scaled(home, in_file, unit_mm)
    part = part_in_mm(files)
    assert part.diameter == pytest.approx(130.0, rel=1e-5)
    assert part.path == files.results / "part.ply"
    for unit, size in (("mm", 130.0), ("inches", 3302.0), ("metres", 130000.0)):
        assert f"as {unit} " in size_by_unit(files.mesh)
        told = size_by_unit(files.mesh).partition(f"as {unit} ")[2].split()[1]
        assert float(told) == pytest.approx(in_file * size, rel=0.006)


@pytest.mark.parametrize(("in_file", "unit_mm"), [(1.0, 1000.0), (0.001, None)])
def test_a_unit_that_cannot_be_is_named_with_what_the_others_give(
    home: Path, in_file: float, unit_mm: float | None
) -> None:
    files = scaled(home, in_file, unit_mm)
    with pytest.raises(PartError) as raised:
        part_in_mm(files)
    text = str(raised.value)
    assert text.startswith(f"{files.mesh}: MESH_UNIT_MM = {unit_mm or 1.0:g} makes its diameter")
    assert " 130 mm" in text


def test_a_mesh_that_is_none_is_told_by_its_own_name(home: Path) -> None:
    trimesh.PointCloud(np.eye(3)).export(home / "points.ply")
    with pytest.raises(PartError, match=r"points\.ply"):
        part_in_mm(own_files("~/points.ply", "~/clip.mp4", "~/boards"))


def scaled(home: Path, factor: float, unit_mm: float | None) -> OwnFiles:
    trimesh.creation.box((30.0 * factor, 40.0 * factor, 120.0 * factor)).export(home / "part.stl")
    return own_files("~/part.stl", "~/clip.mp4", "~/boards", mesh_unit_mm=unit_mm)


def test_the_readers_own_files_are_never_overwritten(home: Path) -> None:
    """A mesh or camera in the folder of the results, where an earlier run put its own."""
    results = home / "course" / "clip"
    results.mkdir(parents=True)
    trimesh.creation.box((0.03, 0.04, 0.12)).export(results / "part.ply")
    (results / "CAMERA.json").write_text("by hand")
    before = (results / "part.ply").read_bytes()
    in_metres = own_files(results / "part.ply", "~/clip.mp4", camera=results / "CAMERA.json", mesh_unit_mm=1000.0)
    with pytest.raises(InputFileError, match="would be overwritten"):
        part_in_mm(in_metres)
    assert (results / "part.ply").read_bytes() == before
    assert keep_camera(in_metres, stand_in_camera()) == results / "CAMERA.json"
    assert (results / "CAMERA.json").read_text() == "by hand"
    trimesh.creation.box((30.0, 40.0, 120.0)).export(results / "part.ply")
    before = (results / "part.ply").read_bytes()
    part_in_mm(own_files(results / "part.ply", "~/clip.mp4", camera="~/CAMERA.json"))
    assert (results / "part.ply").read_bytes() == before


def test_a_calibrated_camera_is_kept_with_the_results(home: Path) -> None:
    files = own_files("~/part.stl", "~/clip.mp4", "~/boards")
    assert keep_camera(files, stand_in_camera()) == files.results / "CAMERA.json"
    assert Camera.from_json(files.results / "CAMERA.json") == stand_in_camera()
