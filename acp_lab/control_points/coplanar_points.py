"""The 3D control points W: four coplanar points of the part, one quadruple per view region (paper IV-C).

Four coplanar points are the fewest that a homography needs, and a plane that faces the camera keeps
their quad in the image wide open. So a region that looks along axis k takes the middle section of the
bounding box perpendicular to k.
"""

from __future__ import annotations

import numpy as np

# A plate's middle section may be a sliver, whose quad says nothing about two of the six degrees of freedom.
# Deviation from the paper, which takes the box as it is.
MIN_SIDE_RATIO = 0.25


def mid_section_points(box_min: np.ndarray, box_max: np.ndarray, axis: int) -> np.ndarray:
    """The four vertices of the bounding box's middle section perpendicular to `axis` (paper IV-C).

    Args:
        box_min: (3,) mm, object frame.
        box_max: (3,) mm, object frame.
        axis: 0, 1 or 2.

    Returns:
        (4, 3) mm, object frame, in order around the rectangle.

    Example:
        >>> mid_section_points(np.array([0.0, 0.0, 0.0]), np.array([40.0, 20.0, 10.0]), axis=2)[:, 2]
        array([5., 5., 5., 5.])
    """
    centre = 0.5 * (np.asarray(box_min) + np.asarray(box_max))
    half = 0.5 * (np.asarray(box_max) - np.asarray(box_min))
    first, second = (axis + 1) % 3, (axis + 2) % 3
    longest = max(half[first], half[second])
    points = np.tile(centre, (4, 1))
    points[:, first] += np.array([-1.0, 1.0, 1.0, -1.0]) * max(half[first], MIN_SIDE_RATIO * longest)
    points[:, second] += np.array([-1.0, -1.0, 1.0, 1.0]) * max(half[second], MIN_SIDE_RATIO * longest)
    return points
