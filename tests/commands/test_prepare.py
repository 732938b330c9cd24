"""`acp-lab prepare`: what it writes, and bad meshes."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
import trimesh

from acp_lab.commands import machine
from acp_lab.commands.prepare import read_part
from acp_lab.control_points.regression import RegressionConfig
from acp_lab.errors import PreparationError
from acp_lab.generator.painted.config import AutoencoderConfig, NetworkShape
from acp_lab.generator.painted.edge_images import EdgeImageConfig
from acp_lab.preparation import prepare as prepare_part
from acp_lab.prepared_part import PreparedPart, PrepareOptions
from tests.cad.meshes import step_box
from tests.cli_runner import Outcome, assert_one_error, run
from tests.commands.conftest import edit_json
from tests.sequences.tiny_dataset import write_box, write_models


def prepare(capsys: pytest.CaptureFixture[str], out: Path, *words: str | Path) -> Outcome:
    return run(capsys, "prepare", *words, "--out", out, "--generator", "templates", "--fast")


@pytest.fixture
def mesh(tmp_path: Path) -> Path:
    write_box(tmp_path / "block.ply")
    return tmp_path / "block.ply"


def test_a_folder_named_after_the_mesh(capsys: pytest.CaptureFixture[str], tmp_path: Path, mesh: Path) -> None:
    outcome = prepare(capsys, tmp_path / "parts", mesh)
    assert outcome.status == 0, outcome
    assert outcome.err == ""
    folder = tmp_path / "parts" / "block"
    assert re.fullmatch(rf"{folder}: prepared in \d+\.\d s, diameter \d+\.\d mm\n", outcome.out)
    assert prepare(capsys, tmp_path / "parts", mesh).out.startswith(f"{folder}: was complete, diameter")
    info = json.loads((folder / "part.json").read_text())
    assert "version" in json.dumps(info)
    kinds = {path.suffix for path in folder.iterdir()}
    assert kinds == {".json", ".safetensors"}


def test_the_papers_generator(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, mesh: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tiny = AutoencoderConfig(
        images=EdgeImageConfig(size=32, views=8, held_out=2),
        shape=NetworkShape(latent=8, widths=(8, 8, 4), hidden=16),
        autoencoder_epochs=1,
        latent_epochs=1,
        fine_tune_epochs=0,
        second_epochs=1,
    )
    monkeypatch.setattr(AutoencoderConfig, "fast", lambda: tiny)
    monkeypatch.setattr(RegressionConfig, "fast", lambda: RegressionConfig(views=4, steps=2))
    words = (
        "prepare",
        mesh,
        "--out",
        tmp_path / "parts",
        "--generator",
        "autoencoder",
        "--fast",
        "--regions",
        "2",
        "5",
    )
    outcome = run(capsys, *words)
    assert (outcome.status, outcome.err) == (0, "")
    folder = tmp_path / "parts" / "block"
    assert {f"autoencoder_{region}.png" for region in (2, 5)} <= {path.name for path in folder.iterdir()}
    made = json.loads((folder / "part.json").read_text())["generators"]
    assert sorted(made) == ["autoencoder"]
    assert "'source': 'analytic'" in made["autoencoder"]["training"]
    assert run(capsys, *words, "--edges", "normals").status == 0
    made = json.loads((folder / "part.json").read_text())["generators"]
    assert "'source': 'normals'" in made["autoencoder"]["training"]
    assert "'outline_inset_mm': 0.0" in made["autoencoder"]["training"]


@pytest.mark.parametrize("resume", ["--resume", "--no-resume"])
def test_a_device_that_is_not_there_leaves_a_part_as_it_was(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, mesh: Path, monkeypatch: pytest.MonkeyPatch, resume: str
) -> None:
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    assert prepare(capsys, tmp_path / "parts", mesh).status == 0
    before = {path.name: path.read_bytes() for path in (tmp_path / "parts" / "block").iterdir()}
    mesh.with_name("open.obj").write_text("v 0 0 0\nv 30 0 0\nv 0 30 0\nv 0 0 30\nf 1 2 3\nf 1 2 4\n")
    words = ("--generator", "autoencoder", "--device", "cuda", resume)
    outcome = run(capsys, "prepare", mesh, mesh.with_name("open.obj"), "--out", tmp_path / "parts", *words)
    assert_one_error(outcome, "--device cuda: torch finds no GPU on this machine: give --device cpu, or auto")
    assert {path.name: path.read_bytes() for path in (tmp_path / "parts" / "block").iterdir()} == before
    with pytest.raises(PreparationError, match="--device cuda"):
        prepare_part(read_part(mesh), PrepareOptions("autoencoder", device="cuda"), out=tmp_path / "parts")
    assert {path.name: path.read_bytes() for path in (tmp_path / "parts" / "block").iterdir()} == before


def test_several_meshes(capsys: pytest.CaptureFixture[str], tmp_path: Path, mesh: Path) -> None:
    write_box(tmp_path / "other.ply")
    assert prepare(capsys, tmp_path / "parts", mesh, tmp_path / "other.ply").status == 0
    assert sorted(path.name for path in (tmp_path / "parts").iterdir()) == ["block", "other"]


@pytest.mark.slow
def test_two_processes_prepare_what_one_prepares(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, mesh: Path
) -> None:
    trimesh.creation.box((30.0, 60.0, 20.0)).export(tmp_path / "other.ply")
    meshes = (mesh, tmp_path / "other.ply")
    outcomes = [prepare(capsys, tmp_path / f"parts{n}", *meshes, "--jobs", n) for n in "12"]
    assert [(outcome.status, outcome.err) for outcome in outcomes] == [(0, "")] * 2
    assert all(outcomes[1].out.count(f"{name}: prepared in") == 1 for name in ("block", "other"))
    for path in sorted((tmp_path / "parts1").glob("*/*")):
        one, two = path.read_bytes(), (tmp_path / "parts2" / path.parent.name / path.name).read_bytes()
        if path.name == "part.json":
            headers = [json.loads(content) for content in (one, two)]
            for header in headers:
                # Times differ, and with them the checksum of the whole.
                assert set(header.pop("cpu_s")) == {"edges", "templates", "views"}
                header.pop("checksum")
            assert headers[0] == headers[1]
        else:
            assert one == two


@pytest.mark.slow
def test_what_a_process_cannot_prepare_is_one_line(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, mesh: Path
) -> None:
    trimesh.creation.box((30.0, 60.0, 20.0)).export(tmp_path / "other.ply")
    assert prepare(capsys, tmp_path / "parts", mesh).status == 0
    trimesh.creation.box((31.0, 41.0, 21.0)).export(mesh)
    outcome = prepare(capsys, tmp_path / "parts", mesh, tmp_path / "other.ply", "--jobs", "2")
    assert_one_error(outcome, "another mesh of the same name", "--no-resume")


def test_a_number_of_processes_that_makes_no_sense(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, mesh: Path
) -> None:
    assert_one_error(prepare(capsys, tmp_path / "parts", mesh, "--jobs", "0"), "--jobs 0: give 1 to 256")
    assert_one_error(prepare(capsys, tmp_path / "parts", mesh, "--scheduler", ""), "--scheduler '': is no address")


def test_an_edge_break_that_is_kept_is_told(capsys: pytest.CaptureFixture[str], tmp_path: Path, mesh: Path) -> None:
    assert "edge break" not in prepare(capsys, tmp_path / "parts", mesh).out
    assert "edge break" not in prepare(capsys, tmp_path / "parts", mesh, "--edge-break", "0").out
    assert prepare(capsys, tmp_path / "parts", mesh).out.endswith(" mm, edge break 0 mm as before\n")
    assert "edge break" not in prepare(capsys, tmp_path / "parts", mesh, "--no-resume").out


def test_the_time_of_preparation_is_kept(capsys: pytest.CaptureFixture[str], tmp_path: Path, mesh: Path) -> None:
    assert prepare(capsys, tmp_path / "parts", mesh).status == 0
    before = PreparedPart.load(tmp_path / "parts" / "block", mesh).cpu_s
    assert set(before) == {"edges", "templates", "views"}
    assert all(0.0 < seconds < 600.0 for seconds in before.values())
    # A second time there is nothing to do, and nothing is counted twice.
    assert prepare(capsys, tmp_path / "parts", mesh).status == 0
    assert PreparedPart.load(tmp_path / "parts" / "block", mesh).cpu_s == before


def test_same_stem_of_another_mesh_is_refused_unless_told(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, mesh: Path
) -> None:
    assert prepare(capsys, tmp_path / "parts", mesh).status == 0
    before = (tmp_path / "parts" / "block" / "part.json").read_bytes()
    mesh.write_text(mesh.read_text().replace("-20 ", "-22 "))
    told = "give another --out to keep both, --no-resume to replace it, or rename the mesh"
    assert_one_error(prepare(capsys, tmp_path / "parts", mesh), "block", told)
    assert (tmp_path / "parts" / "block" / "part.json").read_bytes() == before
    assert prepare(capsys, tmp_path / "parts", mesh, "--no-resume").status == 0
    assert (tmp_path / "parts" / "block" / "part.json").read_bytes() != before


def test_two_meshes_of_one_name(capsys: pytest.CaptureFixture[str], tmp_path: Path, mesh: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    write_box(tmp_path / "elsewhere" / "block.ply")
    outcome = prepare(capsys, tmp_path / "parts", mesh, tmp_path / "elsewhere" / "block.ply")
    assert_one_error(outcome, "block.ply", "same name")


def test_a_file_where_the_folder_should_be(capsys: pytest.CaptureFixture[str], tmp_path: Path, mesh: Path) -> None:
    (tmp_path / "parts").write_text("")
    assert_one_error(prepare(capsys, tmp_path / "parts", mesh), "parts", "folder")


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".stl", ".step"])
@pytest.mark.parametrize("content", [None, "", "nonsense", "ply\nformat ascii 1.0\n"])
def test_bad_mesh_files(capsys: pytest.CaptureFixture[str], tmp_path: Path, suffix: str, content: str | None) -> None:
    path = tmp_path / f"bad{suffix}"
    if content is not None:
        path.write_text(content)
    assert_one_error(prepare(capsys, tmp_path / "parts", path), path.name)
    assert not (tmp_path / "parts" / "bad").exists()


def test_unknown_kind_of_mesh(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    (tmp_path / "part.txt").write_text("hello")
    assert_one_error(prepare(capsys, tmp_path / "parts", tmp_path / "part.txt"), "part.txt", ".ply")


@pytest.mark.parametrize("kept", [0.3, 0.6, 0.95])
def test_cut_off_mesh(capsys: pytest.CaptureFixture[str], tmp_path: Path, mesh: Path, kept: float) -> None:
    text = mesh.read_text()
    mesh.write_text(text[: int(kept * len(text))])
    assert_one_error(prepare(capsys, tmp_path / "parts", mesh), "block.ply")


@pytest.mark.parametrize(("factor", "unit"), [(0.001, "mm"), (1000.0, "mm")])
def test_wrong_unit(capsys: pytest.CaptureFixture[str], tmp_path: Path, mesh: Path, factor: float, unit: str) -> None:
    lines = mesh.read_text().splitlines()
    start = lines.index("end_header") + 1
    for i in range(start, start + 8):
        lines[i] = " ".join(f"{factor * float(word):g}" for word in lines[i].split())
    mesh.write_text("\n".join(lines) + "\n")
    assert_one_error(prepare(capsys, tmp_path / "parts", mesh), "block.ply", unit)


def test_mesh_without_faces(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path = tmp_path / "points.obj"
    path.write_text("v 0 0 0\nv 10 0 0\nv 0 10 0\n")
    assert_one_error(prepare(capsys, tmp_path / "parts", path), "points.obj")


@pytest.mark.parametrize("jobs", ["1", "2"])
def test_a_mesh_without_edges_is_told_before_another_is_prepared(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, mesh: Path, jobs: str
) -> None:
    flat, ball = tmp_path / "flat.obj", tmp_path / "ball.ply"
    flat.write_text("v 0 0 0\nv 30 0 0\nv 0 30 0\nv 30 30 0\nf 1 2 3\nf 2 4 3\n")
    trimesh.creation.icosphere(subdivisions=3, radius=20.0).export(ball)
    for bad, told in ((flat, "all faces lie in one plane"), (ball, "a ball looks the same from all sides")):
        assert_one_error(prepare(capsys, tmp_path / "parts", mesh, bad, "--jobs", jobs), f"error: {bad}: ", told)
        assert not (tmp_path / "parts").exists()


def test_models_info_beside_the_mesh_counts(tmp_path: Path) -> None:
    turn = [[-1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]]
    write_models(tmp_path, {3: {"symmetries_discrete": turn}})
    assert read_part(tmp_path / "models" / "obj_000003.ply").symmetries
    write_box(tmp_path / "models" / "block.ply")
    assert not read_part(tmp_path / "models" / "block.ply").symmetries


def test_models_info_that_contradicts_the_mesh(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    write_models(tmp_path, {3: {}})
    edit_json(tmp_path / "models" / "models_info.json", lambda infos: infos["3"].update(diameter=0.0538))
    outcome = prepare(capsys, tmp_path / "parts", tmp_path / "models" / "obj_000003.ply")
    assert_one_error(outcome, "obj_000003.ply")


def scaled_box(path: Path, factor: float) -> Path:
    """The block of 40 x 30 x 20 mm in another unit."""
    trimesh.creation.box((40.0 * factor, 30.0 * factor, 20.0 * factor)).export(path)
    return path


@pytest.mark.parametrize(("unit", "factor"), [("mm", 1.0), ("cm", 0.1), ("m", 0.001), ("inch", 1.0 / 25.4)])
def test_a_mesh_in_any_unit_becomes_a_part_in_mm(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, unit: str, factor: float
) -> None:
    mesh = scaled_box(tmp_path / "block.stl", factor)
    assert prepare(capsys, tmp_path / "parts", mesh, "--unit", unit).status == 0
    # The file is the same, so track finds the part by it.
    part = PreparedPart.load(tmp_path / "parts" / "block", mesh).part
    assert part.box_size.tolist() == pytest.approx([40.0, 30.0, 20.0], rel=1e-5)


def test_units_that_cannot_be(capsys: pytest.CaptureFixture[str], tmp_path: Path, mesh: Path) -> None:
    assert_one_error(prepare(capsys, tmp_path / "parts", mesh, "--unit", "foot"), "foot")
    assert_one_error(prepare(capsys, tmp_path / "parts", mesh, "--unit", "m"), "block.ply", "mm")
    small = scaled_box(tmp_path / "small.stl", 0.001)
    assert_one_error(prepare(capsys, tmp_path / "parts", small), "small.stl", "looks like metres", "--unit m")
    (tmp_path / "part.step").write_text("ISO-10303-21;")
    assert_one_error(prepare(capsys, tmp_path / "parts", tmp_path / "part.step", "--unit", "inch"), "STEP", "inch")


def test_a_part_that_may_be_in_inches_is_told(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    small = scaled_box(tmp_path / "small.stl", 3.0 / 25.4)
    outcome = prepare(capsys, tmp_path / "parts", small)
    assert outcome.status == 0
    sizes = "if the file is in cm it is 64 mm, in inches 162 mm"
    assert outcome.err == f"warning: {small}: 6.4 mm large: {sizes}: --unit says it\n"
    assert "inches" not in prepare(capsys, tmp_path / "parts", small, "--unit", "inch", "--no-resume").err


def test_a_part_in_centimetres_is_told_and_a_small_step_file_is_not(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    pytest.importorskip("cascadio", reason="STEP support is an extra: pip install acp_lab[step]")
    small = scaled_box(tmp_path / "small.stl", 0.36)
    assert "19.4 mm large: if the file is in cm it is 194 mm" in prepare(capsys, tmp_path / "parts", small).err
    larger = scaled_box(tmp_path / "larger.stl", 0.38)
    assert prepare(capsys, tmp_path / "parts", larger).err == ""
    (tmp_path / "step.step").write_text(step_box((14.0, 10.0, 7.0)))
    assert prepare(capsys, tmp_path / "parts", tmp_path / "step.step").err == ""


@pytest.mark.parametrize("scale", [0.001, 1000.0])
def test_a_step_file_of_a_wrong_unit_is_to_be_exported_again(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, scale: float
) -> None:
    pytest.importorskip("cascadio", reason="STEP support is an extra: pip install acp_lab[step]")
    path = tmp_path / "part.step"
    path.write_text(step_box((60.0 * scale, 40.0 * scale, 20.0 * scale)))
    fix = "its unit is wrong in the file: export it again in mm, or as PLY or STL and give --unit\n"
    assert_one_error(prepare(capsys, tmp_path / "parts", path), f"error: {path}: its diameter would be ", fix)


def test_symmetries_are_found_and_told_who_watches(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("acp_lab.commands.prepare.watched", lambda: True)
    parts, block = tmp_path / "parts", scaled_box(tmp_path / "brick.stl", 1.0)
    assert f"{parts / 'brick'}: looks the same after 3 turns" in prepare(capsys, parts, block).err
    assert len(PreparedPart.load(parts / "brick", block).part.symmetries.discrete) == 3
    assert "looks the same" not in prepare(capsys, parts, block, "--no-symmetries").err
    assert not PreparedPart.load(parts / "brick", block).part.symmetries


def test_another_unit_does_not_go_on_with_the_part_that_is_there(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """Checksums are of the file, and that is the same."""
    mesh, parts = scaled_box(tmp_path / "block.stl", 1.0), tmp_path / "parts"
    assert prepare(capsys, parts, mesh).status == 0
    assert_one_error(prepare(capsys, parts, mesh, "--unit", "cm"), "0.1 times as large", "--no-resume")
    outcome = prepare(capsys, parts, mesh, "--unit", "cm", "--no-resume")
    assert outcome.status == 0
    assert "block: was prepared 0.1 times as large" in outcome.err, "as the command that a damaged part names does"
    assert prepare(capsys, parts, mesh, "--unit", "cm", "--no-resume").err == ""
    assert PreparedPart.load(parts / "block").part.box_size.max() == pytest.approx(400.0)
    assert prepare(capsys, parts, mesh, "--unit", "cm").status == 0


def test_threads_beyond_the_cores_are_noted_and_beyond_sense_refused(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, mesh: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(machine, "cores", lambda: 2)
    for name in machine._THREAD_VARIABLES:
        monkeypatch.setenv(name, "1")
    try:
        done = prepare(capsys, tmp_path / "parts", mesh, "--threads", "3")
        assert done.status == 0
        assert "note: --threads 3 is more than the 2 cores here" in done.err
        assert "note" not in prepare(capsys, tmp_path / "parts", mesh, "--threads", "2").err
        assert_one_error(prepare(capsys, tmp_path / "parts", mesh, "--threads", "1000000000"), "--threads 1000000000")
        assert_one_error(prepare(capsys, tmp_path / "parts", mesh, "--threads", "0"), "--threads")
    finally:
        machine.limit_threads(1)
