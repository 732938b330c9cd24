"""The wrong meshes that a tracker is told, and the pose that explains an image with one of another size."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

pytest.importorskip("manifold3d", reason='the extra "recipes" is not installed')

from acp_lab.cad.part import Part
from acp_lab.errors import PartError
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import transform
from benchmarks.told_wrong import ToldRun
from benchmarks.told_wrong import row_of as _row
from benchmarks.wrong_mesh import MESHES, explained, solid
from tests.made_parts import bracket, looking_at

CAMERA = Camera(640, 512, 700.0, 700.0, 319.5, 255.5)


def volume(part: Part) -> float:
    """mm^3."""
    return float(solid(part).volume())


def test_what_is_there_too_much_and_too_little() -> None:
    part = bracket()
    volumes = {name: volume(wrong(part)) / volume(part) for name, wrong in MESHES.items()}
    bolt = np.pi * 0.06**2 * 0.05 * part.diameter**3 / volume(part)  # half of it is in the part
    assert volumes["a bolt too many"] == pytest.approx(1.0 + bolt, rel=0.01)
    assert volumes["a hole too many"] < 0.999
    assert volumes["convex hull"] > 1.1
    assert volumes["1% coarse"] == pytest.approx(1.0, abs=0.05)
    assert volumes["1% longer"] == pytest.approx(1.01)
    assert volumes["3% longer"] == pytest.approx(1.03)
    assert volumes["a tenth torn"] == pytest.approx(1.0)  # and closed, or it would have none
    assert len(MESHES["a tenth torn"](part).faces) > 1.1 * len(part.faces)


@pytest.mark.parametrize("name", MESHES)
def test_a_wrong_mesh_is_where_the_part_is(name: str) -> None:
    part = bracket()
    wrong = MESHES[name](part)
    assert wrong.name == part.name
    np.testing.assert_allclose(wrong.box_centre, part.box_centre, atol=0.1 * part.diameter)


def test_what_is_coarse_has_few_faces_and_keeps_its_size() -> None:
    rod = trimesh.creation.cylinder(radius=20.0, height=50.0, sections=128)
    part = Part.from_mesh(rod.vertices, rod.faces, "rod")
    fine, coarse = MESHES["0.2% coarse"](part), MESHES["1% coarse"](part)
    assert len(coarse.faces) < len(fine.faces) < 0.8 * len(part.faces)
    assert fine.diameter == pytest.approx(part.diameter, rel=0.004)
    assert coarse.diameter == pytest.approx(part.diameter, rel=0.02)


def test_a_longer_part_is_explained_farther_away() -> None:
    part = bracket()
    truth = looking_at(part, np.array([0.8, 0.6, 1.0]), 330.0, 0.3)
    depths = []
    for name in ("as it is", "1% longer", "3% longer"):
        found = explained(part, truth, CAMERA, MESHES[name](part))
        depths.append(transform(found, part.box_centre)[2])
    assert depths[0] == pytest.approx(transform(truth, part.box_centre)[2])
    assert depths[0] * 1.001 < depths[1] < depths[2] < depths[0] * 1.03


def test_a_part_with_other_faces_is_explained_where_it_is() -> None:
    part = bracket()
    truth = looking_at(part, np.array([0.8, 0.6, 1.0]), 330.0, 0.3)
    np.testing.assert_array_equal(explained(part, truth, CAMERA, MESHES["convex hull"](part)), truth)


def test_a_mesh_that_is_not_closed_is_named() -> None:
    part = bracket()
    with pytest.raises(PartError, match=f"{part.name}: its mesh is not closed"):
        solid(Part.from_mesh(part.vertices, part.faces[1:], part.name))


def test_a_row_counts_frames_and_lost_runs() -> None:
    errors = np.array([0.01, 0.03, 0.2, 0.01])
    runs = [ToldRun("as it is", "5", some, np.full(4, 0.25)) for some in (errors, errors * 2.0)]
    assert _row(runs) == pytest.approx({"@2": 0.25, "@5": 0.625, "lost": 1, "runs": 2, "moved": 0.25})
