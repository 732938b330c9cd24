"""The CAD parts are what the recipe promises: solid, centred, of the right size, in all groups, with known symmetry."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from acp_lab.cad.edges import sample_edges
from acp_lab.cad.models_info import read_models_info
from acp_lab.cad.near_turns import near_turns
from acp_lab.cad.part import Part
from acp_lab.cad.raycast import EmbreeCaster
from acp_lab.cad.symmetry import find_symmetries
from acp_lab.geometry.pose import check_rotation
from data_recipes.bop_writer import write_models
from data_recipes.metal.arrange import stable_poses
from data_recipes.metal.cad_parts import PARTS, CadPart, make_part
from data_recipes.metal.clutter import other_part
from data_recipes.metal.dataset import bop_model
from data_recipes.metal.formed_parts import FORMED, FORMED_SYMMETRIES
from data_recipes.metal.machined_parts import MACHINED, SYMMETRIES
from data_recipes.metal.plan import FIRST_PARTS, PART_NAMES
from data_recipes.metal.toothed_parts import TOOTHED
from data_recipes.metal_sequences import build_parser

FIRST_SEVEN = ["slot_block", "l_bracket", "u_clevis", "flange_hub", "valve_body", "finned_cover", "lever_arm"]


@pytest.fixture(scope="module", params=list(PARTS))
def part(request: pytest.FixtureRequest) -> CadPart:
    return make_part(request.param)


def test_is_one_watertight_solid(part: CadPart) -> None:
    mesh = trimesh.Trimesh(part.vertices, part.faces, process=False)
    assert mesh.is_volume
    assert mesh.body_count == 1
    assert len(part.faces) < (14_000 if part.name in FORMED else 6000)
    # A face without height, as u_clevis has one, is dropped by the reader and leaves the mesh open.
    assert Part.from_mesh(part.vertices, part.faces, part.name).is_closed or part.name == "u_clevis"


def test_size_and_place(part: CadPart) -> None:
    low, high = (60.0, 160.0) if part.name in {**MACHINED, **FORMED, **TOOTHED} else (80.0, 110.0)
    assert low <= part.diameter <= high
    np.testing.assert_allclose(part.vertices.min(0), -part.vertices.max(0), atol=1e-5)
    np.testing.assert_array_equal(part.vertices, part.vertices.astype(np.float32))


def test_rests_in_poses_that_readers_accept(part: CadPart) -> None:
    for pose in stable_poses(part.vertices, part.faces):
        check_rotation(pose, part.name)


def depth_maps(caster: EmbreeCaster, turn: np.ndarray) -> np.ndarray:
    """Depths (3, 49, 49) of the part, turned by a rotation (3, 3), seen along x, y and z; 200 where rays miss."""
    grid = np.stack(np.meshgrid(np.linspace(-80, 80, 49), np.linspace(-80, 80, 49)), -1).reshape(-1, 2)
    maps = []
    for axis in range(3):
        origins = np.insert(grid, axis, 100.0, axis=1)
        directions = np.tile(-np.eye(3)[axis], (len(grid), 1))
        distance, _ = caster.first_hit(origins @ turn, directions @ turn)
        maps.append(np.minimum(distance, 200.0).reshape(49, 49))
    return np.stack(maps)


def test_no_undeclared_half_or_quarter_turn_looks_the_same(part: CadPart, tmp_path: Path) -> None:
    if part.name in TOOTHED:
        pytest.skip("what tells is too small for these few rays: it is looked for in the next test")
    caster = EmbreeCaster(part.vertices, part.faces)
    upright = depth_maps(caster, np.eye(3))
    declared = declared_turns(part, tmp_path)
    for turn in Rotation.create_group("O").as_matrix():
        if not any(np.allclose(turn, known, atol=1e-6) for known in declared):
            assert (np.abs(depth_maps(caster, turn) - upright) > 1.0).sum() > 10


@pytest.mark.parametrize(
    ("name", "count"),
    [
        ("chain_sprocket", 22), ("splined_shaft", 12), ("ratchet_wheel", 18), ("bolted_flange", 12),
        ("timing_pulley", 24), ("slotted_nut", 6), ("brake_disc", 20), ("milling_cutter", 10),
    ],
)  # fmt: skip
def test_toothed_parts_look_nearly_the_same_after_a_tooth_but_have_no_symmetry(name: str, count: int) -> None:
    made = make_part(name)
    part = Part.from_mesh(made.vertices, made.faces, name)
    edges = sample_edges(part)
    assert not find_symmetries(part, edges)
    assert len(near_turns(part, edges)) == count - 1


@pytest.mark.parametrize("name", [*SYMMETRIES, *FORMED_SYMMETRIES])
def test_every_declared_turn_looks_the_same(name: str, tmp_path: Path) -> None:
    part = make_part(name)
    caster = EmbreeCaster(part.vertices, part.faces)
    upright = depth_maps(caster, np.eye(3))
    turns = declared_turns(part, tmp_path)
    assert len(turns) >= 6
    for turn in turns:
        # Facets of what is round, and rays that just miss an edge, may differ.
        assert (np.abs(depth_maps(caster, turn) - upright) > 1.0).mean() < 0.01


def declared_turns(part: CadPart, folder: Path) -> np.ndarray:
    """Rotations (k, 3, 3), the identity first, as a reader of the data set gets them."""
    write_models(folder, {1: bop_model(part)})
    symmetries = read_models_info(folder / "models" / "models_info.json")[1].symmetries
    return symmetries.transforms()[:, :3, :3]


def test_each_group_has_two_parts_or_more() -> None:
    groups = [group for group, _ in PARTS.values()]
    assert len(PARTS) >= 20
    assert all(groups.count(group) >= 2 for group in (1, 2, 3, 4))


def test_a_new_part_changes_nothing_that_a_seed_showed_before() -> None:
    assert build_parser().get_default("parts") == list(FIRST_PARTS)
    assert list(FIRST_PARTS) == FIRST_SEVEN
    assert set(FIRST_PARTS) < set(PARTS)
    assert tuple(PARTS) == PART_NAMES
    # Things that lie about: drawn from those seven, in their order.
    drawn = other_part(np.random.default_rng(3), 1.0)[1]
    names = [name for name in FIRST_PARTS if len(make_part(name).faces) == len(drawn)]
    assert names == [FIRST_PARTS[int(np.random.default_rng(3).integers(7))]]
