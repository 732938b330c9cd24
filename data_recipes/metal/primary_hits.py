"""What each pixel sees first: the table, or a face of one of the bodies.

Convention: world frame, mm; rays have any length, distances count it. Bodies are numbered as in `Moment.bodies`: 0 is
the tracked part, the last one the bench.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import inverse, transform
from data_recipes.metal.bodies import Placed
from data_recipes.metal.scene import Moment

_NEAR_MM = 10.0  # bodies that come nearer to the camera may be seen anywhere

BodyHits = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Pixels (m,) that were asked about a body, with the distance (m,) and face (m,) of what they hit."""


@dataclass(frozen=True, eq=False)
class Hits:
    """Per pixel (n,): distance (inf for none), owner (-1 for the table or nothing), face (-1), and whether the part
    would be hit if it were alone. bench: the bench's own hits, to be used again where camera and bench stand still."""

    distance: np.ndarray
    owner: np.ndarray
    face: np.ndarray
    alone: np.ndarray
    bench: BodyHits


def nearest_hits(moment: Moment, rays: np.ndarray, camera: Camera, bench: BodyHits | None = None) -> Hits:
    """First hits of rays (n, 3) from the camera, one per pixel, row by row."""
    n = len(rays)
    eye = moment.world_T_cam[:3, 3]
    falling = rays[:, 2] < -1e-6
    distance = np.full(n, np.inf)
    distance[falling] = -eye[2] / rays[falling, 2]
    face, owner = np.full(n, -1), np.full(n, -1)
    alone = np.zeros(n, bool)
    for k, placed in enumerate(moment.bodies):
        if placed is moment.bench:
            bench = bench if bench is not None else _body_hits(moment, placed, rays, camera)
            ask, reach, at = bench
        else:
            ask, reach, at = _body_hits(moment, placed, rays, camera)
        if k == 0:
            alone[ask] = at >= 0
        front = reach < distance[ask]
        distance[ask[front]], face[ask[front]], owner[ask[front]] = reach[front], at[front], k
    assert bench is not None
    return Hits(distance, owner, face, alone, bench)


def _body_hits(moment: Moment, placed: Placed, rays: np.ndarray, camera: Camera) -> BodyHits:
    ask = _pixels_near(moment, placed, camera)
    eye = np.broadcast_to(moment.world_T_cam[:3, 3], (len(ask), 3))
    return (ask, *placed.first_hit(eye, rays[ask]))


def _pixels_near(moment: Moment, placed: Placed, camera: Camera) -> np.ndarray:
    """Indices of the pixels in the rectangle round what is seen of a body."""
    points = transform(inverse(moment.world_T_cam) @ placed.world_T_body, placed.body.vertices)
    if points[:, 2].min() < _NEAR_MM:
        return np.arange(camera.width * camera.height)
    pixels = camera.project(points)
    # A pixel more on each side: rays may lie off their pixel's centre.
    low = np.clip(np.floor(pixels.min(0)) - 1, 0, [camera.width, camera.height]).astype(int)
    high = np.clip(np.ceil(pixels.max(0)) + 2, 0, [camera.width, camera.height]).astype(int)
    rows = np.arange(low[1], high[1])[:, None] * camera.width
    return np.asarray((rows + np.arange(low[0], high[0])).ravel())
