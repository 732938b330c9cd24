"""The Chamfer distance between two sets of points, in both directions.

Convention: points are rows, (n, 2) px or (n, 3) mm; both sets in one frame. The directions differ in meaning:
generated edges that lie far from true ones were invented, true edges that lie far from generated ones were
missed, and a mean alone hides which.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acp_lab.errors import GeometryError
from acp_lab.geometry.arrays import FloatArray


@dataclass(frozen=True)
class Chamfer:
    """Mean distance to the nearest point of the other set, in the unit of the points."""

    a_to_b: float
    b_to_a: float

    @property
    def symmetric(self) -> float:
        """The mean of both directions: zero only when the sets cover each other."""
        return 0.5 * (self.a_to_b + self.b_to_a)

    def __str__(self) -> str:
        return f"{self.symmetric:.3g} (there {self.a_to_b:.3g}, back {self.b_to_a:.3g})"


def nearest_distances(points_a: FloatArray, points_b: FloatArray) -> FloatArray:
    """For each of points_a (n, d), the distance (n,) to the nearest of points_b (m, d).

    Raises GeometryError when a set is empty or holds numbers that are not finite, or when dimensions differ.
    """
    a, b = _points(points_a, "first"), _points(points_b, "second")
    if a.shape[1] != b.shape[1]:
        raise GeometryError(f"Chamfer between {a.shape[1]}-d and {b.shape[1]}-d points: give both in one frame")
    # Here and not above: SciPy's import would slow down every start of whoever needs Canny alone.
    from scipy.spatial import cKDTree

    distances, _ = cKDTree(b).query(a)
    return np.asarray(distances, dtype=np.float64)


def chamfer(points_a: FloatArray, points_b: FloatArray) -> Chamfer:
    """Mean nearest distances of points_a (n, d) and points_b (m, d); raises as `nearest_distances`.

    Example:
        >>> few, many = np.array([[0.0, 0.0]]), np.array([[0.0, 0.0], [4.0, 0.0]])
        >>> print(chamfer(few, many))  # the few lie on the many, not the other way round
        1 (there 0, back 2)
    """
    return Chamfer(
        a_to_b=float(nearest_distances(points_a, points_b).mean()),
        b_to_a=float(nearest_distances(points_b, points_a).mean()),
    )


def _points(points: FloatArray, name: str) -> FloatArray:
    array = np.asarray(points, dtype=np.float64)
    if array.ndim != 2 or len(array) == 0:
        raise GeometryError(f"Chamfer: the {name} set has shape {array.shape}: give one or more rows of points")
    if not np.isfinite(array).all():
        raise GeometryError(f"Chamfer: the {name} set holds numbers that are not finite: leave those points out")
    return array
