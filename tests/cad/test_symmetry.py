"""The turns after which a mesh looks the same are found, and no others."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from acp_lab.cad.edges import sample_edges
from acp_lab.cad.models_info import Symmetries
from acp_lab.cad.part import Part
from acp_lab.cad.symmetry import find_symmetries, in_words
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import so3_exp, transform
from acp_lab.preparation import prepare
from acp_lab.prepared_part import PreparedPart, PrepareOptions
from acp_lab.sample import sample_dataset
from tests.made_parts import bracket, cylinder, extruded

SHIFT = np.array([30.0, -120.0, 7.0])
AS_DRAWN = np.zeros(3)


def found(vertices: FloatArray, faces: FloatArray, rotvec: FloatArray = AS_DRAWN) -> tuple[Part, Symmetries]:
    """Of a mesh that was turned and shifted, as CAD files may have any origin and axes."""
    part = Part.from_mesh(np.asarray(vertices) @ so3_exp(rotvec).T + SHIFT, faces, "part")
    return part, find_symmetries(part, sample_edges(part))


def polygon(corners: int, radius: float = 20.0) -> FloatArray:
    """Outline (n, 2) of a prism."""
    angle = 2.0 * np.pi * np.arange(corners) / corners
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def cross() -> trimesh.Trimesh:
    """Two bars across each other."""
    bars = [trimesh.creation.box(size) for size in ((70.0, 12.0, 10.0), (12.0, 70.0, 10.0))]
    return trimesh.boolean.union(bars, engine="manifold")


SOLIDS = {
    "box": (trimesh.creation.box((80.0, 60.0, 20.0)), 3, 0),
    "square bar": (trimesh.creation.box((40.0, 40.0, 80.0)), 7, 0),
    "cube": (trimesh.creation.box((40.0, 40.0, 40.0)), 23, 0),
    "shaft": (trimesh.creation.cylinder(20.0, 60.0, sections=64), 1, 1),
    "cone": (trimesh.creation.cone(20.0, 60.0, sections=64), 0, 1),
    "cross": (cross(), 7, 0),
    "nut": (trimesh.Trimesh(*extruded(polygon(6), 14.0)), 11, 0),
}


@pytest.mark.parametrize("name", SOLIDS)
@pytest.mark.parametrize("rotvec", [AS_DRAWN, np.array([0.4, -1.1, 0.7])], ids=["as drawn", "turned"])
def test_solids_have_their_turns(name: str, rotvec: FloatArray) -> None:
    mesh, discrete, axes = SOLIDS[name]
    part, symmetries = found(mesh.vertices, mesh.faces, rotvec)
    assert (len(symmetries.discrete), len(symmetries.continuous)) == (discrete, axes)
    corners = part.vertices[ConvexHull(part.vertices).vertices]
    for turn in symmetries.discrete:
        apart = np.linalg.norm(transform(turn, corners)[:, None] - corners[None], axis=2).min(1)
        assert apart.max() < 0.002 * part.diameter or axes
    for axis, offset in symmetries.continuous:
        middle = part.vertices.mean(0) - np.array(offset)
        assert np.linalg.norm(np.cross(middle, axis)) < 1e-3 * part.diameter
        assert abs(np.array(axis) @ (so3_exp(rotvec) @ [0.0, 0.0, 1.0])) == pytest.approx(1.0, abs=1e-6)


def test_a_part_without_symmetries_has_none() -> None:
    part = bracket()
    assert not find_symmetries(part, sample_edges(part))


def test_a_small_hole_tells_a_turn_from_another() -> None:
    """A plate of 80 mm with a hole of 3 mm in one corner; with a second one across a half turn is left."""
    plate = trimesh.creation.box((80.0, 60.0, 8.0))
    holes = [trimesh.creation.cylinder(1.5, 30.0, sections=32, transform=at(side)) for side in (1.0, -1.0)]
    one = trimesh.boolean.difference([plate, holes[0]], engine="manifold")
    both = trimesh.boolean.difference([one, holes[1]], engine="manifold")
    assert not found(one.vertices, one.faces)[1]
    assert len(found(both.vertices, both.faces)[1].discrete) == 1


def cut(body: trimesh.Trimesh, holes: list[trimesh.Trimesh]) -> trimesh.Trimesh:
    return trimesh.boolean.difference([body, *holes], engine="manifold")


@pytest.mark.parametrize("holes", [19, 25, 31, 44])
def test_a_flange_has_as_many_turns_as_holes(holes: int) -> None:
    """One rad is nearly three pitches of 19 holes, four of 25 and seven of 44: yet they are not round."""
    disc = trimesh.creation.cylinder(50.0, 8.0, sections=100)
    hub = trimesh.creation.cylinder(25.0, 40.0, sections=100)
    hub.apply_translation((0.0, 0.0, 16.0))
    drills = [trimesh.creation.cylinder(1.5, 30.0, sections=24) for _ in range(holes)]
    for number, drill in enumerate(drills):
        angle = 2.0 * np.pi * number / holes
        drill.apply_translation((42.0 * np.cos(angle), 42.0 * np.sin(angle), 0.0))
    flange = cut(trimesh.boolean.union([disc, hub], engine="manifold"), drills)
    _, symmetries = found(flange.vertices, flange.faces)
    assert not symmetries.continuous
    assert len(symmetries.discrete) == holes - 1


def test_ribs_close_together_are_told_apart() -> None:
    base = trimesh.creation.box((100.0, 80.0, 5.0))
    ribs = [trimesh.creation.box((0.5, 80.0, 30.0)) for _ in range(20)]
    for number, rib in enumerate(ribs):
        rib.apply_translation((5.0 * (number - 9.5), 0.0, 15.0))
    sink = trimesh.boolean.union([base, *ribs], engine="manifold")
    assert len(found(sink.vertices, sink.faces)[1].discrete) == 1


@pytest.mark.parametrize("tilt_deg", [0.1, 0.2, 0.3])
def test_a_tube_that_is_hardly_tilted_has_one_axis(tilt_deg: float) -> None:
    tube = cut(trimesh.creation.cylinder(20.0, 60.0), [trimesh.creation.cylinder(15.0, 70.0)])
    _, symmetries = found(tube.vertices, tube.faces, np.array([np.deg2rad(tilt_deg), 0.0, 0.0]))
    assert (len(symmetries.continuous), len(symmetries.discrete)) == (1, 1)


def test_the_sides_of_a_sheet_differ_where_one_has_a_pocket() -> None:
    pocket = trimesh.creation.cylinder(3.0, 0.4, sections=32)
    pocket.apply_translation((0.0, 0.0, 0.3))
    sheet_ = cut(trimesh.creation.box((100.0, 60.0, 0.6)), [pocket])
    _, symmetries = found(sheet_.vertices, sheet_.faces)
    assert len(symmetries.discrete) == 1
    assert symmetries.discrete[0][2, 2] == pytest.approx(1.0)


def test_a_smooth_bump_is_no_symmetry() -> None:
    """Two mm high on a disc of a hundred, without a crease."""
    disc = trimesh.creation.cylinder(50.0, 10.0, sections=128)
    disc = disc.subdivide_to_size(3.0)
    away = np.hypot(disc.vertices[:, 0] - 30.0, disc.vertices[:, 1])
    raised = (
        disc.vertices + np.array([0.0, 0.0, 2.0]) * (np.exp(-(away**2) / 50.0) * (disc.vertices[:, 2] > 0.0))[:, None]
    )
    assert len(found(disc.vertices, disc.faces)[1].continuous) == 1
    assert not found(raised, disc.faces)[1]


def at(side: float) -> FloatArray:
    place = np.eye(4)
    place[:2, 3] = 30.0 * side, 20.0 * side
    return place


@settings(max_examples=15, deadline=None)
@given(corners=st.sampled_from([3, *range(5, 14)]), turn=st.floats(-3.0, 3.0))
def test_a_prism_of_any_number_of_sides(corners: int, turn: float) -> None:
    """n turns about its axis and n half turns across, but for the identity; where its sides meet at an edge."""
    vertices, faces = extruded(polygon(corners), 31.0)
    _, symmetries = found(vertices, faces, np.array([0.3, turn, 0.1]))
    assert len(symmetries.discrete) == 2 * corners - 1
    assert not symmetries.continuous


def test_in_words() -> None:
    assert in_words(Symmetries.none()) == ""
    assert in_words(find_symmetries(cylinder(), sample_edges(cylinder()))) == "any turn about (0, 0, 1) and 1 other"
    turn = np.diag([-1.0, -1.0, 1.0, 1.0])
    assert in_words(Symmetries(turn[None])) == "1 turn"
    assert in_words(Symmetries(np.array([turn, turn]))) == "2 turns"


def test_preparing_looks_for_what_nobody_told(tmp_path: Path) -> None:
    options = PrepareOptions("templates", fast=True)
    part = cylinder()
    assert not part.symmetries.told
    model = prepare(part, options, out=tmp_path)
    assert len(model.part.symmetries.continuous) == 1
    again = PreparedPart.load(tmp_path / part.name)
    assert again.part.symmetries.told
    np.testing.assert_array_equal(again.part.symmetries.transforms(), model.part.symmetries.transforms())
    told = Part.from_mesh(part.vertices, part.faces, "told", Symmetries.none())
    assert not prepare(told, options).part.symmetries


def test_what_a_data_set_says_counts() -> None:
    from acp_lab.commands.prepare import read_part

    mesh = sample_dataset() / "models" / "obj_000001.ply"
    assert read_part(mesh).symmetries.told
    assert not Part.from_file(mesh).symmetries.told
    assert Part.from_mesh(cylinder().vertices, cylinder().faces, "x", Symmetries.none()).symmetries.told
