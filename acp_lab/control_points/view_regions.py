"""The six view regions: which face of the bounding box the camera looks at (paper IV-C).

Lines from the box's centre through its eight vertices divide the directions of view into six
pyramids, one per face. Regions are numbered 0..5 = +x, -x, +y, -y, +z, -z (of the object frame).
Each has its own control points W and its own up-vector, another box axis, so that the canonical
frame is nowhere undefined.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from acp_lab.control_points.coplanar_points import MIN_SIDE_RATIO

REGION_COUNT = 6
REGION_NAMES = ("+x", "-x", "+y", "-y", "+z", "-z")
HYSTERESIS = 1.15


@dataclass(frozen=True)
class ViewRegion:
    """One of the six pyramids of view directions.

    Attributes:
        index: 0..5 = +x, -x, +y, -y, +z, -z.
    """

    index: int

    @property
    def axis(self) -> int:
        """Box axis that the region looks along: 0, 1 or 2."""
        return self.index // 2

    @property
    def sign(self) -> float:
        """+1 or -1: the side of the box that is seen."""
        return 1.0 if self.index % 2 == 0 else -1.0

    @property
    def up_obj(self) -> np.ndarray:
        """(3,) unit up-vector in the object frame, never parallel to a direction of the region."""
        up = np.zeros(3)
        up[(self.axis + 1) % 3] = 1.0
        return up

    @property
    def name(self) -> str:
        """Face of the box, such as '+z'."""
        return REGION_NAMES[self.index]


ALL_REGIONS = tuple(ViewRegion(index) for index in range(REGION_COUNT))


def region_scores(direction_obj: np.ndarray, half_size: np.ndarray) -> np.ndarray:
    """How far a direction leans into each region.

    Args:
        direction_obj: (..., 3) from the box centre to the eye, any length.
        half_size: (3,) half the box's sides, mm.

    Returns:
        (..., 6); the largest names the region, equal ones lie on a border.
    """
    # A plate's rim regions would reach down to where its broad sides are seen edge-on; W is widened likewise.
    # Deviation from the paper, which takes the box as it is.
    half_size = np.maximum(half_size, MIN_SIDE_RATIO * np.max(half_size))
    leaning = np.asarray(direction_obj) / half_size
    return np.stack([leaning, -leaning], -1).reshape(*leaning.shape[:-1], REGION_COUNT)


def choose_region(
    direction_obj: np.ndarray,
    half_size: np.ndarray,
    current: int | None = None,
    hysteresis: float = HYSTERESIS,
    among: Sequence[int] = range(REGION_COUNT),
) -> int:
    """The view region of a direction (3,); the current one is kept until another leads by `hysteresis`.

    Without hysteresis a part that hovers at a border would swap its control points in every frame. (Deviation from the
    paper, which has none.)
    `among`: the regions to choose from, one or more.
    """
    # As `region_scores`, number by number: this is asked for several times in every frame.
    sizes = np.asarray(half_size).tolist()
    least = MIN_SIDE_RATIO * max(sizes)
    leaning = [way / max(size, least) for way, size in zip(np.asarray(direction_obj).tolist(), sizes, strict=True)]
    scores = {region: -leaning[region // 2] if region % 2 else leaning[region // 2] for region in sorted(among)}
    best = max(scores, key=lambda region: scores[region])
    if current in scores and scores[best] < hysteresis * scores[current]:
        return current
    return best


def sample_directions(
    region: ViewRegion, half_size: np.ndarray, count: int, overlap: float = 0.0, seed: int = 0
) -> np.ndarray:
    """`count` directions of view that cover a region evenly.

    Latitude and longitude steps as in paper IV-C crowd at the poles; latitudes are therefore taken at
    equal steps of height, which makes equal areas, with longitudes by the golden angle.

    Args:
        overlap: widen the region by this share into its neighbours.

    Returns:
        (count, 3) unit directions from the box centre to the eye, object frame.
    """
    rng = np.random.default_rng([seed, region.index])
    found: list[np.ndarray] = []
    total = 0
    while total < count:
        directions = sphere_directions(6 * count, rng.uniform(0.0, 2.0 * np.pi))
        scores = region_scores(directions, half_size)
        inside = scores[:, region.index] * (1.0 + overlap) >= scores.max(1)
        found.append(directions[inside])
        total += int(inside.sum())
    pool = np.concatenate(found)
    return pool[rng.permutation(len(pool))[:count]]


def sphere_directions(count: int, turn_rad: float = 0.0) -> np.ndarray:
    """(count, 3) unit vectors spread evenly over the sphere (a Fibonacci lattice)."""
    index = np.arange(count)
    height = 1.0 - 2.0 * (index + 0.5) / count
    longitude = turn_rad + index * np.pi * (3.0 - np.sqrt(5.0))
    radius = np.sqrt(1.0 - height**2)
    return np.stack([radius * np.cos(longitude), radius * np.sin(longitude), height], 1)
