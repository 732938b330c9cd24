"""The bodies of a mesh: which of them are closed, and which way their normals point.

A body is what hangs together by shared vertices. It is closed when every edge is run as often one way as the other,
which is to say watertight and wound consistently.
"""

from __future__ import annotations

import numpy as np

from acp_lab.geometry.arrays import BoolArray, FloatArray, IntArray


def is_closed(faces: IntArray) -> bool:
    """Whether every edge of faces (m, 3), ids of vertices, is run as often one way as the other."""
    return len(faces) > 0 and not _at_gaps(faces).any()


def wound_alike(faces: IntArray) -> IntArray:
    """Faces (m, 3), ids of vertices, after those were reversed that are wound another way than their neighbours.

    Neighbours share an edge, which no third face has. Of what hangs together by such edges the fewer are reversed;
    what has no two sides, such as a Möbius strip, stays as it is.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    start, end = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    edge = np.minimum(start, end) * (faces.max(initial=0) + 1) + np.maximum(start, end)
    order = np.argsort(edge, kind="stable")
    _, first, uses = np.unique(edge[order], return_index=True, return_counts=True)
    pair = first[uses == 2]
    one, other = order[pair], order[pair + 1]
    against = start[one] == start[other]
    if not against.any():
        return faces
    # Each face twice, as it is and reversed; what goes together is joined.
    count, one, other = len(faces), one // 3, other // 3
    ends = np.concatenate([other + count * against, other + count * ~against])
    joined = coo_array((np.ones(len(ends)), (np.concatenate([one, one + count]), ends)), shape=(2 * count, 2 * count))
    groups, group = connected_components(joined, directed=False)
    as_is, reversed_ = group[:count], group[count:]
    size = np.bincount(as_is, minlength=groups)
    more_reversed = size[as_is] < size[reversed_]
    # Of two groups of equal size one has to give way.
    more_reversed |= (size[as_is] == size[reversed_]) & (as_is > reversed_)
    return np.where(more_reversed[:, None], faces[:, ::-1], faces)


def turned_out(points: FloatArray, faces: IntArray) -> IntArray:
    """Faces (m, 3) over points (n, 3), after closed bodies that are inside out were turned, and with them all in them.

    A body inside another one stays as it is where that one does: it is a cavity, whose normals point inwards.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    start, end = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    sides = coo_array((np.ones(len(start)), (start, end)), shape=(len(points), len(points)))
    count, of_point = connected_components(sides, directed=False)
    body = of_point[faces[:, 0]]
    closed = np.bincount(body, weights=_at_gaps(faces), minlength=count) == 0.0
    a, b, c = (points[faces] - points.mean(axis=0)).transpose(1, 0, 2)
    volumes = np.bincount(body, weights=np.einsum("ij,ij->i", a, np.cross(b, c)), minlength=count)
    suspects = np.flatnonzero(closed & (volumes < 0.0))
    if len(suspects) == 0:
        return faces
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, of_point, points)
    np.maximum.at(high, of_point, points)
    turned: set[int] = set()
    for suspect in suspects.tolist():
        own = faces[body == suspect]
        around = closed & (low <= low[suspect]).all(axis=1) & (high >= high[suspect]).all(axis=1)
        within = closed & (low >= low[suspect]).all(axis=1) & (high <= high[suspect]).all(axis=1)
        around[suspect] = within[suspect] = False
        if not any(_is_inside(points, own, faces[body == other]) for other in np.flatnonzero(around)):
            turned.add(suspect)
            turned.update(k for k in np.flatnonzero(within).tolist() if _is_inside(points, faces[body == k], own))
    return np.where(np.isin(body, list(turned))[:, None], faces[:, ::-1], faces)


def _at_gaps(faces: IntArray) -> BoolArray:
    """Which faces (m, 3) have an edge that is run more often one way than the other, (m,)."""
    start, end = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    edge = np.minimum(start, end) * (faces.max(initial=0) + 1) + np.maximum(start, end)
    _, group = np.unique(edge, return_inverse=True)
    uneven = np.bincount(group, weights=np.sign(end - start)) != 0.0
    gaps: BoolArray = uneven[group].reshape(-1, 3).any(axis=1)
    return gaps


def _is_inside(points: FloatArray, inner: IntArray, outer: IntArray) -> bool:
    """Whether a body of faces (k, 3) lies in the closed body of other faces (m, 3), which it may touch.

    Seen from inside, a closed body fills the whole sphere, 4 pi; seen from outside, its sides cancel. The solid angle
    of a triangle: van Oosterom and Strackee, "The solid angle of a plane triangle", 1983.
    """
    fills = []
    for eye in points[inner[:: -(-len(inner) // 3)]].mean(axis=1):  # three, as one may lie where the two touch
        a, b, c = (points[outer] - eye).transpose(1, 0, 2)
        x, y, z = (np.linalg.norm(corner, axis=1) for corner in (a, b, c))
        ab, bc, ca = (np.einsum("ij,ij->i", one, other) for one, other in ((a, b), (b, c), (c, a)))
        angles = 2.0 * np.arctan2(np.einsum("ij,ij->i", a, np.cross(b, c)), x * y * z + ab * z + bc * x + ca * y)
        fills.append(abs(float(angles.sum())) > 2.0 * np.pi)
    return 2 * sum(fills) > len(fills)
