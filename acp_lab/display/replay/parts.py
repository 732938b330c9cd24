"""What stands still in the part's own frame: its mesh, its CAD edges, its box with the view regions, its W.

Convention: everything is in the object frame, mm, and hangs below an entity that carries cam_T_obj. Large meshes
are thinned out for display; nothing is computed from them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from acp_lab.cad.edges import CREASE_ANGLE_DEG
from acp_lab.cad.part import Part, box_corners
from acp_lab.control_points.coplanar_points import mid_section_points
from acp_lab.control_points.view_regions import ALL_REGIONS
from acp_lab.geometry.arrays import FloatArray, IntArray

MOST_FLAT_FACES = 15_000
"""Flat shading needs three vertices of its own per face; above this, smooth normals do."""
MOST_FACES = 40_000
MOST_CAD_EDGES = 8_000
RAY_LENGTH = 0.35
"""Of the rays that open the active view region, in half diagonals of the box."""


def mesh_of(part: Part, colour: NDArray[np.uint8], opacity: float = 1.0) -> Any:
    """The part as a rerun Mesh3D of one colour, (3,) RGB."""
    import rerun as rr

    vertices, faces = thinned(part.vertices, part.faces, MOST_FACES)
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    if len(faces) <= MOST_FLAT_FACES:
        vertices, faces = corners.reshape(-1, 3), np.arange(3 * len(faces)).reshape(-1, 3)
        summed = np.repeat(normals, 3, axis=0)
    else:
        summed = np.zeros_like(vertices)
        for corner in range(3):
            np.add.at(summed, faces[:, corner], normals)
    summed /= np.maximum(np.linalg.norm(summed, axis=1, keepdims=True), 1e-12)
    return rr.Mesh3D(
        vertex_positions=vertices.astype(np.float32),
        triangle_indices=faces.astype(np.uint32),
        vertex_normals=summed.astype(np.float32),
        albedo_factor=[*colour.tolist(), round(255 * opacity)],
    )


def thinned(vertices: FloatArray, faces: IntArray, most_faces: int) -> tuple[FloatArray, IntArray]:
    """A mesh of at most `most_faces` faces that looks alike: vertices are merged in ever larger cells of space."""
    cells = 400
    while len(faces) > most_faces and cells > 8:
        size = np.ptp(vertices, axis=0).max() / cells
        keys, owner = np.unique(np.round(vertices / size).astype(np.int64), axis=0, return_inverse=True)
        owner = owner.ravel()
        count = np.bincount(owner, minlength=len(keys))[:, None]
        merged = np.zeros((len(keys), 3))
        np.add.at(merged, owner, vertices)
        moved = owner[faces]
        whole = (moved[:, 0] != moved[:, 1]) & (moved[:, 1] != moved[:, 2]) & (moved[:, 2] != moved[:, 0])
        vertices, faces = merged / count, moved[whole]
        cells = cells * 3 // 4
    return vertices, faces


def cad_edges(part: Part) -> FloatArray:
    """(n, 2, 3) mm: the mesh edges that are creases, the longest ones where there are very many."""
    mesh = trimesh.Trimesh(part.vertices, part.faces, process=False)
    crease = np.degrees(np.asarray(mesh.face_adjacency_angles)) > CREASE_ANGLE_DEG
    ends = part.vertices[np.asarray(mesh.face_adjacency_edges)[crease]].reshape(-1, 2, 3)
    longest = np.argsort(-np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1), kind="stable")
    return ends[np.sort(longest[:MOST_CAD_EDGES])]


def box_lines(part: Part) -> list[FloatArray]:
    """The twelve edges of the box, each (2, 3) mm: the borders of the six view regions."""
    corners = box_corners(part)
    return [corners[[i, i | bit]] for i in range(8) for bit in (1, 2, 4) if not i & bit]


def region_lines(part: Part, region: int) -> list[FloatArray]:
    """The view region 0..5 as its face of the box (5, 3), closed, and four rays (2, 3) that it opens along; mm."""
    corners, active = box_corners(part), ALL_REGIONS[region]
    first, second = 1 << (active.axis + 1) % 3, 1 << (active.axis + 2) % 3
    side = (1 << active.axis) if active.sign > 0 else 0
    face = corners[[side, side | first, side | first | second, side | second]]
    rays = [np.stack([corner, corner + RAY_LENGTH * (corner - part.box_centre)]) for corner in face]
    return [np.vstack([face, face[:1]]), *rays]


def control_points_of(part: Part, control_points_obj: tuple[FloatArray, ...], region: int) -> FloatArray:
    """(4, 3) mm: the method's W of a view region, the paper's middle section where it tells none."""
    if region < len(control_points_obj):
        return np.asarray(control_points_obj[region])
    return mid_section_points(part.box_min, part.box_max, ALL_REGIONS[region].axis)
