"""What stands still in a replay: meshes thinned for display, CAD edges, the box and its view regions."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from acp_lab.cad.part import Part
from acp_lab.control_points.view_regions import ALL_REGIONS
from acp_lab.display.replay.parts import box_lines, cad_edges, control_points_of, mesh_of, region_lines, thinned
from tests.display.made_run import box


def test_a_box_has_twelve_edges() -> None:
    edges = cad_edges(box())
    assert len(edges) == 12
    lengths = np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1)
    assert sorted(lengths) == pytest.approx([20.0] * 4 + [30.0] * 4 + [40.0] * 4)


def test_the_lines_of_the_box_are_its_edges() -> None:
    def as_set(lines: list[np.ndarray]) -> set[frozenset[tuple[float, ...]]]:
        return {frozenset(tuple(end) for end in np.round(line, 6)) for line in lines}

    assert as_set(box_lines(box())) == as_set(list(cad_edges(box())))


@pytest.mark.parametrize("region", range(6))
def test_the_active_region_is_a_side_of_the_box(region: int) -> None:
    part, view = box(), ALL_REGIONS[region]
    face, *rays = region_lines(part, region)
    side = part.box_max if view.sign > 0 else part.box_min
    np.testing.assert_allclose(face[:, view.axis], side[view.axis])
    np.testing.assert_allclose(face[0], face[-1])
    assert len(np.unique(face, axis=0)) == 4
    for ray in rays:  # outwards
        assert np.linalg.norm(ray[1] - part.box_centre) > np.linalg.norm(ray[0] - part.box_centre)


def test_the_methods_own_control_points_are_shown() -> None:
    own = tuple(np.full((4, 3), float(region)) for region in range(6))
    np.testing.assert_array_equal(control_points_of(box(), own, 4), own[4])
    middle = control_points_of(box(), (), 4)
    np.testing.assert_allclose(middle[:, 2], 0.0)


def test_large_meshes_are_thinned_and_keep_their_shape() -> None:
    sphere = trimesh.creation.icosphere(subdivisions=6, radius=50.0)
    vertices, faces = thinned(np.asarray(sphere.vertices), np.asarray(sphere.faces), 5000)
    assert len(faces) <= 5000
    distance = np.linalg.norm(vertices[faces].mean(1), axis=1)
    assert distance.min() > 46.0
    assert distance.max() < 51.0


def test_small_meshes_are_left_alone() -> None:
    part = box()
    vertices, faces = thinned(part.vertices, part.faces, 100)
    assert vertices is part.vertices
    assert faces is part.faces


def test_meshes_are_flat_shaded_up_to_a_size() -> None:
    small = mesh_of(box(), np.array([10, 20, 30], np.uint8), 0.5)
    assert len(small.vertex_positions.as_arrow_array()) == 36
    sphere = trimesh.creation.icosphere(subdivisions=5, radius=50.0)
    large = Part.from_mesh(np.asarray(sphere.vertices), np.asarray(sphere.faces), "sphere")
    smooth = mesh_of(large, np.array([10, 20, 30], np.uint8))
    assert len(smooth.vertex_positions.as_arrow_array()) == len(sphere.vertices)
    normals = np.array(smooth.vertex_normals.as_arrow_array().to_pylist())
    outward = np.asarray(large.vertices) / 50.0
    assert ((normals * outward).sum(1) > 0.99).all()
