"""The points that can be at the rim of a picture: no others are ever farthest in any direction."""

from __future__ import annotations

import numpy as np

from acp_lab.geometry.hull import hull_corners


def test_the_hull_is_as_wide_as_the_points_in_every_direction() -> None:
    rng = np.random.default_rng(0)
    points, directions = rng.normal(size=(500, 3)), rng.normal(size=(200, 3))
    corners = hull_corners(points)
    assert 3 < len(corners) < 200
    assert {tuple(corner) for corner in corners} <= {tuple(point) for point in points}
    np.testing.assert_array_equal((corners @ directions.T).max(0), (points @ directions.T).max(0))


def test_points_without_a_hull_are_all_kept() -> None:
    flat = np.random.default_rng(1).normal(size=(50, 3)) * (1.0, 1.0, 0.0)
    for points in (flat, flat[:2], flat[:0]):
        np.testing.assert_array_equal(hull_corners(points), points)
