"""The outermost of many points: those that can be at the rim of a picture of them."""

from __future__ import annotations

from scipy.spatial import ConvexHull, QhullError

from acp_lab.geometry.arrays import FloatArray


def hull_corners(points: FloatArray) -> FloatArray:
    """(k, 3) those of points (n, 3) that are corners of their convex hull; all of them where they are in one plane.

    Example:
        >>> import numpy as np
        >>> corners = np.array([[0.0, 0, 0], [9, 0, 0], [0, 9, 0], [0, 0, 9]])
        >>> len(hull_corners(np.vstack([corners, [[1.0, 1, 1]]])))
        4
    """
    try:
        found: FloatArray = points[ConvexHull(points).vertices]
    except (QhullError, ValueError):  # a hull without inside, or too few points
        return points
    return found
