"""Faces that meet without sharing an edge, put together again.

Where one face has a single long side and its neighbours have two short ones, the three share no edge: a T-junction.
To whoever looks for edges the mesh is torn there, maybe in the middle of a flat face. Programs that cut bodies out of
each other leave such places; others close them with a triangle that has no height, which goes when a mesh is cleaned.
Here the long side gets the vertex that lies on it, and its face is cut in two there.
"""

from __future__ import annotations

import numpy as np

from acp_lab.geometry.arrays import BoolArray, FloatArray, IntArray

MOST_PAIRS = 100_000_000
"""Of open sides and vertices that may lie on them."""
MOST_ON_SIDES = 3
"""Vertices on open sides, in open sides. Heaps of loose triangles have more of both, and nothing to be put together;
they are left as they are, for the time that it would take."""
_SIDES, _CHUNK = 1_000, 1_000_000
"""Sides whose pairs are counted, and pairs that are looked at, at a time."""


def stitched(points: FloatArray, faces: IntArray, tolerance: float) -> IntArray:
    """Faces (m, 3) over points (n, 3), cut where a vertex of an open side lies on another open side.

    A side is open when no other face has it. A vertex lies on it when it is nearer to it than `tolerance`, mm, and
    farther from its ends. A face stays whole where a piece of it would be turned over, or no higher than `tolerance`.
    Faces that are not cut keep their order and stand first; without any cut the same array comes back.
    """
    start, end = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    key = np.minimum(start, end) * len(points) + np.maximum(start, end)
    _, side, count = np.unique(key, return_inverse=True, return_counts=True)
    is_open = np.flatnonzero(count[side] == 1)
    opposite = np.roll(faces, -2, axis=1).reshape(-1)
    found = _on_sides(points, start[is_open], end[is_open], opposite[is_open], tolerance)
    cuts = {int(is_open[row]): vertices for row, vertices in found.items()}
    cut_faces, pieces = list[int](), list[list[int]]()
    for face in sorted({side // 3 for side in cuts}):
        parts = _cut(faces[face].tolist(), [cuts.get(3 * face + corner, []) for corner in range(3)])
        if not is_flat(points[parts], tolerance).any() and not _is_turned(points[parts], points[faces[face]]).any():
            cut_faces.append(face)
            pieces += parts
    if not pieces:
        return faces
    return np.concatenate([np.delete(faces, cut_faces, axis=0), np.array(pieces, dtype=faces.dtype)])


def is_flat(triangles: FloatArray, tolerance: float) -> BoolArray:
    """Which triangles (k, 3, 3) are no higher above their longest side than `tolerance`, (k,): they have no normal."""
    a, b, c = triangles.transpose(1, 0, 2)
    longest = np.linalg.norm([b - a, c - b, a - c], axis=2).max(axis=0)
    flat: BoolArray = np.linalg.norm(np.cross(b - a, c - a), axis=1) <= tolerance * longest
    return flat


def _on_sides(
    points: FloatArray, start: IntArray, end: IntArray, opposite: IntArray, tolerance: float
) -> dict[int, list[int]]:
    """Which vertices at the ends of sides, from `start` to `end` (k,), lie on which side, in their order along it.

    opposite: (k,) the third corner of each side's face, which may be a thin one.
    """
    from scipy.spatial import cKDTree

    found: dict[int, list[int]] = {}
    if len(start) == 0:
        return found
    vertices = np.unique(np.concatenate([start, end]))
    tree = cKDTree(points[vertices])
    middle, along = 0.5 * (points[start] + points[end]), points[end] - points[start]
    length = np.linalg.norm(along, axis=1)
    pairs = np.zeros(len(start), np.int64)
    so_far = 0
    for first in range(0, len(start), _SIDES):
        some = slice(first, first + _SIDES)
        pairs[some] = so_far + np.cumsum(tree.query_ball_point(middle[some], 0.5 * length[some], return_length=True))
        so_far = int(pairs[some][-1])
        if so_far > MOST_PAIRS:
            return found
    hits = 0
    for rows in np.split(np.arange(len(start)), np.flatnonzero(np.diff(pairs // _CHUNK)) + 1):
        near = tree.query_ball_point(middle[rows], 0.5 * length[rows])
        row = np.repeat(rows, [len(one) for one in near])
        vertex = vertices[np.concatenate([np.asarray(one, np.int64) for one in near])]
        side = along[row] / length[row, None]
        offset = points[vertex] - points[start[row]]
        place = np.einsum("ij,ij->i", offset, side)
        aside = np.linalg.norm(offset - place[:, None] * side, axis=1)
        lies = (aside < tolerance) & (place > tolerance) & (place < length[row] - tolerance) & (vertex != opposite[row])
        row, vertex, place = row[lies], vertex[lies], place[lies]
        hits += len(row)
        if hits > MOST_ON_SIDES * len(start):
            return {}
        for k in np.lexsort((place, row)).tolist():
            found.setdefault(int(row[k]), []).append(int(vertex[k]))
    return found


def _cut(corners: list[int], on_sides: list[list[int]]) -> list[list[int]]:
    """A face of three corners, in triangles that share all vertices on its sides: those from each corner to the next.

    Each cut goes from a corner to the middle one of the vertices opposite it.
    """
    busiest = max(range(3), key=lambda side: len(on_sides[side]))
    before, opposite, after = (on_sides[(busiest + k) % 3] for k in range(3))
    if not before:
        return [corners]
    a, b, c = (corners[(busiest + k) % 3] for k in range(3))
    half = len(before) // 2
    middle = before[half]
    return _cut([a, middle, c], [before[:half], [], after]) + _cut([middle, b, c], [before[half + 1 :], opposite, []])


def _is_turned(pieces: FloatArray, face: FloatArray) -> BoolArray:
    """Which pieces (k, 3, 3) face another way than the face (3, 3) that they were cut from, (k,)."""
    a, b, c = pieces.transpose(1, 0, 2)
    turned: BoolArray = np.cross(b - a, c - a) @ np.cross(face[1] - face[0], face[2] - face[0]) <= 0.0
    return turned
