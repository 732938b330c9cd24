"""The turns after which most of a part looks the same, but not all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from acp_lab.cad.creases import Creases
from acp_lab.cad.edges import sample_edges
from acp_lab.cad.models_info import Symmetries
from acp_lab.cad.near_turns import near_turns
from acp_lab.cad.part import Part
from acp_lab.cad.symmetry import find_symmetries
from acp_lab.cad.turning import telling_steps, turn_about
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import rotation_angle_deg, so3_exp, transform
from tests.made_parts import bracket, cylinder, open_box, wheel


def turns_of(part: Part) -> FloatArray:
    edges = sample_edges(part)
    return near_turns(replace(part, symmetries=find_symmetries(part, edges)), edges)


def angles_deg(turns: FloatArray) -> FloatArray:
    return np.array([rotation_angle_deg(np.eye(3), turn[:3, :3]) for turn in turns])


def placed(part: Part, rotvec: tuple[float, float, float], shift: tuple[float, float, float]) -> Part:
    return Part.from_mesh(part.vertices @ so3_exp(np.array(rotvec)).T + shift, part.faces, part.name)


@pytest.mark.parametrize("teeth", [5, 12, 31, 66, 90])
def test_a_keyed_wheel_has_a_turn_for_each_tooth(teeth: int) -> None:
    turns = turns_of(placed(wheel(teeth), (0.4, -1.1, 0.7), (30.0, -120.0, 7.0)))
    to_each_side = np.arange(1, teeth // 2 + 1).repeat(2)[: teeth - 1]
    np.testing.assert_allclose(angles_deg(turns), 360.0 / teeth * to_each_side, atol=1e-3)


def test_they_are_about_the_axis_of_the_teeth() -> None:
    at = np.array([5.0, -40.0, 3.0])
    for turn in turns_of(wheel(24, shift=(5.0, -40.0, 3.0))):
        np.testing.assert_allclose(transform(turn, at), at, atol=0.12)
        np.testing.assert_allclose(turn[:3, 2], [0.0, 0.0, 1.0], atol=1e-6)


def test_a_wheel_with_an_arm_still_has_them() -> None:
    """It moves the middle of the surface, and of what is outermost, off the axis."""
    arm = trimesh.creation.box((14.0, 8.0, 4.0))
    arm.apply_translation((34.0, 3.0, 0.0))
    part = wheel(40)
    whole = trimesh.boolean.union([trimesh.Trimesh(part.vertices, part.faces), arm], engine="manifold")
    assert len(turns_of(Part.from_mesh(whole.vertices, whole.faces, "wheel"))) == 39


def test_symmetries_are_none() -> None:
    part = wheel(20, keyed=False)
    assert len(find_symmetries(part, sample_edges(part)).discrete) == 39  # turned over, too
    assert len(turns_of(part)) == 0


def test_turns_about_a_line_that_is_told_to_be_a_symmetry_are_none() -> None:
    part = wheel(24)
    told = replace(part, symmetries=Symmetries(np.zeros((0, 4, 4)), (((0.0, 0.0, 1.0), (0.0, 0.0, 0.0)),)))
    assert len(near_turns(told, sample_edges(part))) == 0


def test_more_teeth_than_are_asked_for_are_none_at_all() -> None:
    """Three of 150 fit as well, but they are no smallest turn."""
    assert len(turns_of(wheel(150))) == 0


@pytest.mark.parametrize("part", [bracket(), cylinder(), open_box()], ids=["bracket", "cylinder", "open box"])
def test_most_parts_have_none(part: Part) -> None:
    assert turns_of(part).shape == (0, 4, 4)


@pytest.mark.parametrize(("fold", "other"), [(31, 30), (72, 66), (54, 48), (20, 10), (9, 3)])
def test_the_steps_that_are_asked_tell_numbers_of_teeth_apart(fold: int, other: int) -> None:
    """Some step of `fold` turns lies between two of `other`."""
    off = [abs(step * other / fold - round(step * other / fold)) for step in telling_steps(fold)]
    assert max(off) > 0.2


def test_an_edge_inwards_covers_none_outwards() -> None:
    """Half a tooth on, the corners of the gaps lie where those of the teeth were, facing the same way."""
    part = wheel(24, keyed=False)
    creases = Creases(sample_edges(part), part.diameter)
    half, whole = (turn_about(np.zeros(3), np.array([0.0, 0.0, 1.0]), np.pi * n / 24) for n in (1, 2))
    assert creases.covered(whole, 0.006).mean() > 0.95
    assert creases.covered(half, 0.03).mean() < 0.6


def test_how_far_beside_an_edge_a_sample_lies() -> None:
    part = bracket()
    creases = Creases(sample_edges(part), part.diameter)
    shift = np.eye(4)
    shift[:3, 3] = 0.0, 0.4, 0.0
    aside, found = creases.aside(shift)
    moved = found & (np.abs(aside[:, 1]) > 1e-9)  # not along their edge
    assert found.mean() > 0.9
    np.testing.assert_allclose(aside[moved] - [0.0, 0.4, 0.0], 0.0, atol=1e-9)
