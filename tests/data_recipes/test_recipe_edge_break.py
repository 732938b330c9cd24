"""The bevels take away what they should, where they should, and leave a solid."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from acp_lab.cad.raycast import EmbreeCaster
from data_recipes.metal.cad_parts import make_part
from data_recipes.metal.edge_break import break_edges, find_creases
from data_recipes.metal.solids import block, bore, mesh_arrays


def test_cube_loses_a_bevel_of_the_right_size() -> None:
    vertices, faces = mesh_arrays(block((-10, -10, -10), (10, 10, 10)))
    broken, broken_faces = break_edges(vertices, faces, 0.4)
    mesh = trimesh.Trimesh(broken, broken_faces, process=False)
    assert mesh.is_volume
    np.testing.assert_allclose(mesh.extents, 20.0, atol=1e-6)
    # 12 edges lose a triangle of legs 0.4; at the 8 corners three of them overlap.
    assert 8000 - mesh.volume == pytest.approx(12 * 20 * 0.08, rel=0.03)
    # Along the diagonal the outline moves inward by leg/sqrt(2).
    corner = np.abs(broken[:, :2]).sum(1).max()
    assert 20 - corner == pytest.approx(0.4, abs=1e-6)


def test_concave_edges_stay_and_rims_are_cut() -> None:
    body = block((-10, -10, -10), (10, 10, 10)) - bore(4, (0, 0, 0))
    vertices, faces = mesh_arrays(body)
    broken, broken_faces = break_edges(vertices, faces, 0.3)
    assert trimesh.Trimesh(broken, broken_faces, process=False).is_volume
    # The rim of the hole on the top face is now a cone from radius 4.3 to 4 at a depth of 0.3.
    caster = EmbreeCaster(broken, broken_faces)
    for radius, height in ((4.15, 9.85), (4.5, 10.0)):
        distance, _ = caster.first_hit([[radius, 0.01, 50.0]], [[0.0, 0.0, -1.0]])
        assert 50.0 - distance[0] == pytest.approx(height, abs=0.02)


@pytest.mark.parametrize("name", ["l_bracket", "valve_body"])
def test_removed_volume_matches_the_creases(name: str) -> None:
    part = make_part(name)
    creases = find_creases(part.vertices, part.faces)
    ends = part.vertices[creases.edges[creases.convex]]
    turn = creases.turn[creases.convex]
    leg = 0.3 * np.minimum(np.tan(turn / 2), 1.5)
    expected = float((np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) * leg**2 / 2 * np.sin(turn)).sum())
    broken, faces = break_edges(part.vertices, part.faces, 0.3)
    mesh = trimesh.Trimesh(broken, faces, process=False)
    assert mesh.is_volume
    volume = trimesh.Trimesh(part.vertices, part.faces, process=False).volume
    assert volume - mesh.volume == pytest.approx(expected, rel=0.05)


def test_nothing_to_do_and_nothing_to_work_on() -> None:
    vertices, faces = mesh_arrays(block((-1, -1, -1), (1, 1, 1)))
    assert break_edges(vertices, faces, 0.0)[0] is vertices
    with pytest.raises(ValueError, match="watertight"):
        break_edges(vertices, faces[:-1], 0.1)
