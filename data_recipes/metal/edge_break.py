"""The rendered twin of a part: the same body with its convex creases broken by a bevel.

Real parts are deburred: a sharp edge of the drawing is a bevel of 0.2-0.4 mm on the bench, so a silhouette
lies a little inside the CAD's. Along every convex crease we subtract a thin wedge whose cut meets both faces
at the same distance from the edge: `break_mm` for a square edge, break_mm·tan(turn/2) for an edge whose
normals turn by another angle (what a tool of constant size leaves). Where two creases follow each other
(a hole's rim in 64 pieces) the convex hull of the two wedge ends closes the gap between them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from manifold3d import Manifold, Mesh64, OpType

from data_recipes.metal.solids import mesh_arrays

CREASE_DEG = 25.0
_MITRE_DEG = 40.0  # creases that turn by less than this at a vertex belong to one rim
_MAX_LEG = 1.5  # very acute edges: never cut further than this times break_mm


@dataclass(frozen=True)
class Creases:
    """Crease edges: vertex pair (n, 2), the two outward face normals (n, 3) each, convex (n,) bool, turn (n,) rad."""

    edges: np.ndarray
    normal_a: np.ndarray
    normal_b: np.ndarray
    inward_a: np.ndarray  # (n, 3) unit, in face a, at right angles to the edge, away from it
    inward_b: np.ndarray
    convex: np.ndarray
    turn: np.ndarray


def face_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Unit outward normals (m, 3)."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    unit: np.ndarray = normal / np.maximum(length, 1e-300)
    return unit


def find_creases(vertices: np.ndarray, faces: np.ndarray, crease_deg: float = CREASE_DEG) -> Creases:
    """All edges of a watertight mesh, of some length, whose two faces' normals differ by more than `crease_deg`."""
    half = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    owner = np.tile(np.arange(len(faces)), 3)
    forward = half[:, 0] < half[:, 1]
    key = np.sort(half, axis=1) @ np.array([len(vertices), 1])
    first, second = np.flatnonzero(forward), np.flatnonzero(~forward)
    first, second = first[np.argsort(key[first], kind="stable")], second[np.argsort(key[second], kind="stable")]
    edges, face_a, face_b = half[first], owner[first], owner[second]
    normals = face_normals(vertices, faces)
    normal_a, normal_b = normals[face_a], normals[face_b]
    turn = np.arccos(np.clip(np.einsum("ij,ij->i", normal_a, normal_b), -1, 1))
    along = vertices[edges[:, 1]] - vertices[edges[:, 0]]
    length = np.linalg.norm(along, axis=1)
    keep = (turn > np.deg2rad(crease_deg)) & (length > 0.0)  # slivers of a random cut may have ends in one place
    edges, normal_a, normal_b, turn = edges[keep], normal_a[keep], normal_b[keep], turn[keep]
    along = along[keep] / length[keep, None]
    # Face a holds the edge in its own counter-clockwise order, so its inside lies to the left: n x e.
    inward_a, inward_b = np.cross(normal_a, along), -np.cross(normal_b, along)
    convex = np.einsum("ij,ij->i", inward_a, normal_b) < 0
    return Creases(edges, normal_a, normal_b, inward_a, inward_b, convex, turn)


def break_edges(vertices: np.ndarray, faces: np.ndarray, break_mm: float) -> tuple[np.ndarray, np.ndarray]:
    """Mesh with every convex crease bevelled; the input itself when `break_mm` is 0.

    Raises ValueError when the mesh is not a solid or when the cut leaves none.
    """
    if break_mm <= 0:
        return vertices, faces
    body = Manifold(Mesh64(np.ascontiguousarray(vertices), np.ascontiguousarray(faces, dtype=np.uint64)))
    if body.is_empty():
        raise ValueError(f"mesh is no solid ({body.status()}); give a watertight mesh")
    creases = find_creases(vertices, faces)
    wedges = _wedges(vertices, creases, break_mm)
    cut = body - Manifold.batch_boolean(wedges, OpType.Add)
    if cut.is_empty():
        raise ValueError(f"edge break of {break_mm} mm leaves nothing of the part; give a smaller one")
    return mesh_arrays(cut.simplify(0.002))


def _wedges(vertices: np.ndarray, creases: Creases, break_mm: float) -> list[Manifold]:
    """One wedge per convex crease and one joint per vertex where two of them follow each other."""
    chosen = np.flatnonzero(creases.convex)
    leg = break_mm * np.minimum(np.tan(creases.turn[chosen] / 2), _MAX_LEG)
    t_a, t_b = creases.inward_a[chosen], creases.inward_b[chosen]
    # The cut runs through edge + leg·t on both faces; its ends are pushed out of the body along the cut itself.
    out = creases.normal_a[chosen] + creases.normal_b[chosen]
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    across = t_a - t_b
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    spare = 0.6 * leg[:, None]
    section = np.stack(
        [leg[:, None] * t_a + spare * across, leg[:, None] * t_b - spare * across, spare * 1.5 * out], axis=1
    )  # (n, 3 corners, 3)
    start = vertices[creases.edges[chosen, 0]][:, None] + section
    end = vertices[creases.edges[chosen, 1]][:, None] + section
    wedges = [Manifold.hull_points(np.vstack([a, b])) for a, b in zip(start, end, strict=True)]

    by_vertex: dict[int, list[tuple[int, int]]] = {}
    for row, (i, j) in enumerate(creases.edges[chosen]):
        by_vertex.setdefault(int(i), []).append((row, 0))
        by_vertex.setdefault(int(j), []).append((row, 1))
    for at in by_vertex.values():
        if len(at) != 2:
            continue
        (row_a, end_a), (row_b, end_b) = at
        a, b = creases.edges[chosen[row_a]], creases.edges[chosen[row_b]]
        into = vertices[a[end_a]] - vertices[a[1 - end_a]]
        away = vertices[b[1 - end_b]] - vertices[b[end_b]]
        cosine = into @ away / (np.linalg.norm(into) * np.linalg.norm(away))
        if cosine > np.cos(np.deg2rad(_MITRE_DEG)):
            corners = np.vstack([(start, end)[end_a][row_a], (start, end)[end_b][row_b]])
            wedges.append(Manifold.hull_points(corners))
    return [w for w in wedges if not w.is_empty()]
