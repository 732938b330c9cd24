"""Directions spread evenly over a sphere: the corners of an icosahedron whose faces are divided in four, over and over.

Trimesh makes them too, but takes half a second and tens of MB to be imported, and whoever tracks a prepared part needs
nothing else of it.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

from acp_lab.geometry.arrays import FloatArray


def icosphere(subdivisions: int) -> FloatArray:
    """(10 * 4 ** subdivisions + 2, 3) unit vectors; those of fewer subdivisions come first."""
    golden = 0.5 * (1.0 + np.sqrt(5.0))
    # Corners of an icosahedron: those of three golden rectangles, in trimesh's order.
    corners = [np.roll((0.0, s, t * golden), k) for k in (2, 0, 1) for t in (1.0, -1.0) for s in (-1.0, 1.0)]
    vertices = np.array(corners) / np.hypot(1.0, golden)
    side = np.linalg.norm(vertices[:, None] - vertices, axis=2)
    near = side < 1.01 * side[side > 0.0].min()
    faces = np.array([face for face in combinations(range(12), 3) if all(near[i, k] for i, k in combinations(face, 2))])
    for _ in range(subdivisions):
        edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        ends, of_edge = np.unique(edges, axis=0, return_inverse=True)
        a, b, c = faces.T
        ab, bc, ca = len(vertices) + of_edge.reshape(-1, 3).T
        middles = vertices[ends].sum(1)
        vertices = np.concatenate([vertices, middles / np.linalg.norm(middles, axis=1, keepdims=True)])
        faces = np.concatenate([np.stack(f, 1) for f in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))])
    return vertices
