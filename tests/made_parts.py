"""Small parts made in code, in mm, for the tests of edges, generators and tracking."""

from __future__ import annotations

import numpy as np
import trimesh

from acp_lab.cad.part import Part
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import make_pose

# The inner corner comes first: from it every other corner of the L is seen, so a fan of triangles fills it.
L_PROFILE = ((12.0, 10.0), (12.0, 40.0), (0.0, 40.0), (0.0, 0.0), (60.0, 0.0), (60.0, 10.0))


def box(size: tuple[float, float, float] = (40.0, 30.0, 20.0), shift: tuple[float, float, float] = (0, 0, 0)) -> Part:
    """A box about `shift`."""
    mesh = trimesh.creation.box(size)
    return Part.from_mesh(np.asarray(mesh.vertices) + shift, np.asarray(mesh.faces), "box")


def bracket(shift: tuple[float, float, float] = (0, 0, 0), inset_mm: float = 0.0) -> Part:
    """An L of 60 x 40 x 30: eighteen creases, one of them concave; from many sides its arms hide each other.

    With every face `inset_mm` further in, as the outlines of a part with broken edges look.
    """
    profile = np.array(L_PROFILE)
    vertices, faces = extruded(np.where(profile == 0.0, inset_mm, profile - inset_mm), 30.0 - 2.0 * inset_mm)
    return Part.from_mesh(vertices + np.array([0.0, 0.0, inset_mm]) + shift, faces, "bracket")


def cylinder(radius: float = 15.0, height: float = 40.0, sections: int = 96) -> Part:
    """A cylinder about the origin, its axis along z."""
    mesh = trimesh.creation.cylinder(radius, height, sections=sections)
    return Part.from_mesh(np.asarray(mesh.vertices), np.asarray(mesh.faces), "cylinder")


def open_box() -> Part:
    """A box of 40 x 30 x 20 without its lid at +z: four rim edges, eight creases."""
    mesh = trimesh.creation.box((40.0, 30.0, 20.0))
    keep = np.asarray(mesh.face_normals)[:, 2] < 0.5
    return Part.from_mesh(np.asarray(mesh.vertices), np.asarray(mesh.faces)[keep], "open_box")


def sheet() -> Part:
    """One flat square of two triangles."""
    corners = [[0, 0, 0], [30, 0, 0], [30, 30, 0], [0, 30, 0]]
    return Part.from_mesh(corners, [[0, 1, 2], [0, 2, 3]], "sheet")


def extruded(profile: FloatArray, height: float) -> tuple[FloatArray, np.ndarray]:
    """A closed mesh of a counter-clockwise profile (n, 2) that its first corner sees whole."""
    n = len(profile)
    low = np.column_stack([profile, np.zeros(n)])
    vertices = np.concatenate([low, low + np.array([0.0, 0.0, height])])
    fan = np.array([[0, i, i + 1] for i in range(1, n - 1)])
    ring = [(i, (i + 1) % n) for i in range(n)]
    walls = [face for i, j in ring for face in ((i, j, j + n), (i, j + n, i + n))]
    return vertices, np.concatenate([fan[:, ::-1], fan + n, np.array(walls)])


def looking_at(part: Part, direction_obj: FloatArray, distance: float, roll_rad: float = 0.0) -> FloatArray:
    """cam_T_obj (4, 4) of a camera at `distance` mm from the box centre along a direction (3,), looking at it."""
    z = -np.asarray(direction_obj, dtype=np.float64)
    z = z / np.linalg.norm(z)
    x = np.cross(z, np.eye(3)[np.abs(z).argmin()])
    x /= np.linalg.norm(x)
    y = np.cross(z, x)
    c, s = np.cos(roll_rad), np.sin(roll_rad)
    turn = np.stack([c * x + s * y, c * y - s * x, z])
    return make_pose(turn, turn @ -(part.box_centre - z * distance))


def wheel(teeth: int = 20, keyed: bool = True, shift: tuple[float, float, float] = (0, 0, 0)) -> Part:
    """A wheel of so many square teeth about z, with a bore; keyed: and a slot beside it, which one turn alone has."""
    radius = 30.0
    body = trimesh.creation.cylinder(radius, 12.0, sections=4 * teeth)
    cuts = [trimesh.creation.cylinder(8.0, 40.0, sections=64)]
    for k in range(teeth):
        gap = trimesh.creation.box((0.2 * radius, np.pi * radius / teeth, 40.0))
        gap.apply_translation((radius, 0.0, 0.0))
        gap.apply_transform(trimesh.transformations.rotation_matrix(2.0 * np.pi * (k + 0.5) / teeth, (0, 0, 1)))
        cuts.append(gap)
    if keyed:
        slot = trimesh.creation.box((14.0, 7.0, 40.0))
        slot.apply_translation((13.0, 0.0, 0.0))
        cuts.append(slot)
    mesh = trimesh.boolean.difference([body, *cuts], engine="manifold")
    return Part.from_mesh(np.asarray(mesh.vertices) + shift, np.asarray(mesh.faces), "wheel")
