"""Whether a part's creases lie on each other after it was turned."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from acp_lab.cad.edges import EdgeSamples
from acp_lab.geometry.arrays import BoolArray, FloatArray
from acp_lab.geometry.pose import transform

_NEIGHBOURS = 16
_ALONG, _FACING = 0.9, 0.5
"""Cosine between directions, and between the sums of the face normals, of edges that look alike."""
_BESIDE = 0.02
"""Of the diameter: no sample further away is asked."""


class Creases:
    """The sharp edges of a part, of a diameter in mm; there may be none.

    Attributes:
        points_obj: (n, 3) mm, in an order of which every prefix covers the part evenly.
    """

    def __init__(self, edges: EdgeSamples, diameter: float) -> None:
        kept = edges.crease
        self.points_obj: FloatArray = edges.points_obj[kept]
        self._tangents, self._off, self._convex = edges.tangents_obj[kept], edges.off_obj[kept], edges.convex[kept]
        self._diameter = diameter
        self._tree = cKDTree(self.points_obj) if kept.any() else None

    def __len__(self) -> int:
        return len(self.points_obj)

    def covered(self, turn: FloatArray, tolerance: float, rows: np.ndarray | slice = slice(None)) -> BoolArray:
        """Which of the samples `rows` lie on a crease that looks as they do after a turn (4, 4), see `aside`.

        tolerance: across the crease, as a share of the diameter.
        """
        aside, found = self.aside(turn, rows)
        return np.asarray(found & (np.linalg.norm(aside, axis=1) < tolerance * self._diameter))

    def aside(self, turn: FloatArray, rows: np.ndarray | slice = slice(None)) -> tuple[FloatArray, BoolArray]:
        """How far the samples `rows` lie beside the nearest crease that looks as they do after a turn (4, 4).

        (n, 3) mm, across that crease, and (n,) whether there is one near: of their direction, facing as they do, an
        edge outwards or inwards as they are.
        """
        points = self.points_obj[rows]
        if self._tree is None or not len(points):
            return np.zeros((len(points), 3)), np.ones(len(points), bool)
        there, along = transform(turn, points), self._tangents[rows] @ turn[:3, :3].T
        off = self._off[rows] @ turn[:3, :3].T
        _, nearest = self._tree.query(there, k=min(_NEIGHBOURS, len(self)))
        nearest = nearest.reshape(len(there), -1)
        way, direction = there[:, None] - self.points_obj[nearest], self._tangents[nearest]
        aside = way - np.einsum("nkj,nkj->nk", way, direction)[..., None] * direction
        alike = np.abs(np.einsum("nj,nkj->nk", along, direction)) > _ALONG
        alike &= np.einsum("nj,nkj->nk", off, self._off[nearest]) > _FACING
        alike &= self._convex[rows][:, None] == self._convex[nearest]
        alike &= np.linalg.norm(way, axis=2) < _BESIDE * self._diameter
        best = np.where(alike, np.linalg.norm(aside, axis=2), np.inf).argmin(1)
        each = np.arange(len(there))
        return aside[each, best], alike[each, best]
