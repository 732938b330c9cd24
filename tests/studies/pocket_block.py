"""A block with a pocket in one face: from that side and from the opposite one its outer contour is the same."""

from __future__ import annotations

import numpy as np
import trimesh

from acp_lab.cad.part import Part
from acp_lab.geometry.arrays import FloatArray, IntArray
from tests.made_parts import box


def block_with_a_pocket() -> Part:
    """A block of 40 x 30 x 20 with a pocket in its face at +z: from +z and -z the outline is the same."""
    block = box((40.0, 30.0, 20.0))
    pocket = trimesh.creation.box((14.0, 8.0, 6.0))
    pocket.apply_translation((-9.0, 6.0, 7.0))
    # The pocket's walls, turned inside out; a frame between both rims closes the block again.
    keep = np.asarray(pocket.face_normals)[:, 2] < 0.5
    faces = np.asarray(pocket.faces)[keep][:, ::-1]
    vertices = np.concatenate([block.vertices, np.asarray(pocket.vertices)])
    top = np.asarray(block.face_normals)[:, 2] > 0.5
    frame = _frame(block.vertices, np.asarray(pocket.vertices))
    faces = np.concatenate([np.asarray(block.faces)[~top], faces + len(block.vertices), frame])
    return Part.from_mesh(vertices, faces, "pocket")


def _frame(outer: FloatArray, inner: FloatArray) -> IntArray:
    """Faces of the top between the block's rim and the pocket's."""
    order = ((-1, -1), (1, -1), (1, 1), (-1, 1))

    def corner(points: FloatArray, x: int, y: int) -> int:
        middle = 0.5 * (points.min(0) + points.max(0))
        signs = np.sign(points - middle)
        return int(np.flatnonzero((signs == [x, y, 1]).all(1))[0])

    rim = [corner(outer, x, y) for x, y in order]
    edge = [corner(inner, x, y) + len(outer) for x, y in order]
    faces = []
    for i in range(4):
        j = (i + 1) % 4
        faces += [[rim[i], rim[j], edge[j]], [rim[i], edge[j], edge[i]]]
    return np.array(faces)
