"""The search for opposite poses with one contour: a part made to have one, and symmetries that are none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from acp_lab.cad.edges import sample_edges
from acp_lab.cad.models_info import Symmetries
from acp_lab.cad.part import Part
from acp_lab.cad.raycast import make_caster
from acp_lab.geometry.pose import make_pose, rotation_angle_deg, so3_exp
from acp_lab.studies.ambiguity import Ambiguities, AmbiguityConfig, find_ambiguities
from acp_lab.studies.silhouettes import contour_distance, outer_contour
from tests.made_parts import box, bracket
from tests.studies.pocket_block import block_with_a_pocket

CONFIG = AmbiguityConfig(subdivisions=1, pairs=3, refine_steps=20)


@pytest.fixture(scope="module")
def found() -> tuple[Part, Ambiguities]:
    part = block_with_a_pocket()
    return part, find_ambiguities(part, sample_edges(part), make_caster(part), CONFIG)


def test_the_pocket_is_closed() -> None:
    assert block_with_a_pocket().is_closed


def test_opposite_poses_of_one_contour_are_found(found: tuple[Part, Ambiguities]) -> None:
    ambiguities = found[1]
    assert len(ambiguities.pairs) == 3
    best = ambiguities.pairs[0]
    assert best.turn_deg > 90.0
    assert best.outline_share < 0.01
    assert [p.outline_share for p in ambiguities.pairs] == sorted(p.outline_share for p in ambiguities.pairs)
    for pair in ambiguities.pairs:
        turned = rotation_angle_deg(pair.first_T_obj[:3, :3], pair.second_T_obj[:3, :3])
        assert pair.turn_deg == pytest.approx(turned)


def test_the_shares_are_those_of_the_poses(found: tuple[Part, Ambiguities]) -> None:
    part, ambiguities = found
    pair, camera = ambiguities.pairs[0], ambiguities.camera
    caster = make_caster(part)
    contours = [outer_contour(part, caster, camera, pose, 1024) for pose in (pair.first_T_obj, pair.second_T_obj)]
    diameter_px = camera.fx * part.diameter / pair.first_T_obj[2, 3]
    assert pair.outline_share == pytest.approx(contour_distance(*contours) / diameter_px, rel=0.05)


def test_inner_edges_tell_some_of_the_pairs_apart(found: tuple[Part, Ambiguities]) -> None:
    assert max(pair.edges_share - pair.outline_share for pair in found[1].pairs) > 0.01


def test_poses_that_a_symmetry_makes_equal_are_no_ambiguity() -> None:
    half_turns = np.stack([make_pose(so3_exp(np.pi * axis), np.zeros(3)) for axis in np.eye(3)])
    plain = box((40.0, 30.0, 20.0))
    symmetric = replace(plain, symmetries=Symmetries(half_turns))
    edges, caster = sample_edges(plain), make_caster(plain)
    config = replace(CONFIG, pairs=1, refine_steps=1)
    assert find_ambiguities(plain, edges, caster, config).pairs[0].outline_share < 0.005
    others = find_ambiguities(symmetric, edges, caster, config).pairs
    assert all(pair.outline_share > 0.005 for pair in others)


def test_refining_brings_the_contours_closer() -> None:
    straight = bracket()
    # Skewed, so that no two views agree exactly.
    skewed = straight.vertices @ np.array([[1.0, 0.1, 0.0], [0.0, 1.0, 0.2], [0.4, 0.1, 1.0]])
    part = Part.from_mesh(skewed, straight.faces, "skewed")
    edges, caster = sample_edges(part), make_caster(part)
    rough, fine = (
        find_ambiguities(part, edges, caster, replace(CONFIG, pairs=2, refine_steps=steps)) for steps in (1, 60)
    )
    assert sum(p.outline_share for p in fine.pairs) < sum(p.outline_share for p in rough.pairs)


def test_it_prints_as_a_table(found: tuple[Part, Ambiguities]) -> None:
    lines = str(found[1]).splitlines()
    assert len(lines) == 4
    assert lines[0].startswith("pair  turn deg")
