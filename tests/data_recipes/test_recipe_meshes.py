"""Units are told by size, and symmetries by the surface."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from acp_lab.cad.part import Part
from acp_lab.errors import PartError
from data_recipes.meshes import UNITS_MM, guess_unit, load_mesh, model_of
from data_recipes.metal.cad_parts import make_part
from data_recipes.symmetries import find_symmetry
from tests.cad.meshes import step_box


@given(st.floats(40.0, 380.0), st.sampled_from(["mm", "m"]))
def test_the_size_of_an_ordinary_part_tells_its_unit(diameter_mm: float, unit: str) -> None:
    assert guess_unit(diameter_mm / UNITS_MM[unit], "part") == unit


@given(st.floats(40.0, 380.0))
def test_a_size_that_fits_inches_fits_another_unit(diameter_mm: float) -> None:
    size = diameter_mm / UNITS_MM["inch"]
    assert size < 15.0
    with pytest.raises(PartError, match=r"(cm|m), [0-9e+.]+ mm in inch: say with --unit which it is"):
        guess_unit(size, "part.stl")


def test_a_part_in_centimetres_is_not_taken_for_one_in_inches() -> None:
    with pytest.raises(PartError) as caught:
        guess_unit(9.4, "part.stl")
    sizes = "9.4 mm in mm, 94 mm in cm, 239 mm in inch"
    assert str(caught.value) == f"part.stl: its size is 9.4, which may be {sizes}: say with --unit which it is"


@pytest.mark.parametrize("size", [1e-4, 9000.0])
def test_a_size_that_fits_no_unit_is_refused(size: float) -> None:
    with pytest.raises(PartError, match="give --unit"):
        guess_unit(size, "part.stl")


@pytest.mark.parametrize(("unit", "scale"), [("mm", 1.0), ("m", 0.001), ("inch", 1 / 25.4), ("cm", 0.1)])
@pytest.mark.parametrize("suffix", [".stl", ".ply", ".obj"])
def test_meshes_come_out_in_mm(tmp_path: Path, suffix: str, unit: str, scale: float) -> None:
    box = trimesh.creation.box((60.0, 40.0, 25.0))
    box.apply_scale(scale)
    path = tmp_path / f"box{suffix}"
    box.export(path)
    mesh = load_mesh(path, unit if unit in ("inch", "cm") else None)
    assert mesh.unit == unit
    np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), [60.0, 40.0, 25.0], rtol=1e-5)
    assert model_of(mesh).diameter == pytest.approx(np.linalg.norm([60.0, 40.0, 25.0]), rel=1e-5)


def test_a_unit_that_is_told_is_not_doubted(tmp_path: Path) -> None:
    path = tmp_path / "box.ply"
    trimesh.creation.box((60.0, 40.0, 25.0)).export(path)
    assert load_mesh(path, "cm").part.diameter == pytest.approx(10 * np.linalg.norm([60, 40, 25]), rel=1e-5)
    with pytest.raises(PartError, match="scale the mesh to mm"):
        load_mesh(path, "m")


def test_a_step_file_says_its_unit_itself(tmp_path: Path) -> None:
    pytest.importorskip("cascadio", reason="STEP support is an extra: pip install acp_lab[step]")
    path = tmp_path / "box.step"
    path.write_text(step_box((6.0, 4.0, 2.5)))
    assert load_mesh(path).part.diameter == pytest.approx(np.linalg.norm([6.0, 4.0, 2.5]), rel=1e-5)
    with pytest.raises(PartError, match="a STEP file says its unit itself: leave cm away"):
        load_mesh(path, "cm")
    path.write_text(step_box((0.06, 0.04, 0.025)))
    with pytest.raises(PartError, match=r"box\.step: .*: its unit is wrong in the file: export it again in mm"):
        load_mesh(path)


def _part(mesh: trimesh.Trimesh) -> Part:
    return Part.from_mesh(mesh.vertices, mesh.faces, "part")


@pytest.mark.parametrize(
    ("mesh", "discrete", "axes"),
    [
        (trimesh.creation.box((40, 30, 20)), 3, 0),
        (trimesh.creation.box((40, 40, 20)), 7, 0),
        (trimesh.creation.cylinder(20, 60, sections=64), 1, 1),
        (trimesh.creation.cone(20, 60, sections=64), 0, 1),
    ],
)
def test_known_symmetries_are_found(mesh: trimesh.Trimesh, discrete: int, axes: int) -> None:
    mesh.apply_translation([5.0, -7.0, 3.0])
    part = _part(mesh)
    found = find_symmetry(part)
    assert (len(found.discrete), len(found.axes)) == (discrete, axes)
    assert found
    low, high = part.box_min, part.box_max
    for turn in found.discrete:
        moved = part.vertices @ turn[:3, :3].T + turn[:3, 3]
        np.testing.assert_allclose((moved.min(0), moved.max(0)), (low, high), atol=1e-6)
    assert set(found.as_info()) <= {"symmetries_discrete", "symmetries_continuous"}


def test_a_part_without_symmetry_has_none_but_names_its_best_half_turn() -> None:
    made = make_part("slot_block")
    found = find_symmetry(Part.from_mesh(made.vertices, made.faces, "slot_block"))
    assert not found
    assert found.as_info() == {}
    assert found.best_error > 0.02
    np.testing.assert_allclose(found.best_half_turn @ found.best_half_turn, np.eye(4), atol=1e-9)
