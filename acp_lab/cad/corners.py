"""The corners of a part: mesh vertices at which creases end or change direction, for people to point at."""

from __future__ import annotations

import numpy as np
import trimesh

from acp_lab.cad.edges import CREASE_ANGLE_DEG
from acp_lab.cad.part import Part
from acp_lab.cad.raycast import RayCaster
from acp_lab.geometry.arrays import BoolArray, FloatArray

LEAST_BEND_DEG = 30.0
"""Along the rim of a hole, creases bend from one facet to the next by less."""


def corner_points(part: Part, crease_angle_deg: float = CREASE_ANGLE_DEG) -> FloatArray:
    """(n, 3) mm, object frame; none for a part without creases, such as a ball.

    Three creases at least meet in a corner, or two that bend by more than 30 degrees.
    """
    mesh = trimesh.Trimesh(part.vertices, part.faces, process=False)
    crease = np.degrees(np.asarray(mesh.face_adjacency_angles)) > crease_angle_deg
    pairs = np.asarray(mesh.face_adjacency_edges, np.int64).reshape(-1, 2)[crease]
    # Each crease as seen from both its ends.
    start, end = np.concatenate([pairs, pairs[:, ::-1]]).T
    away = part.vertices[end] - part.vertices[start]
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    count = np.bincount(start, minlength=len(part.vertices))
    total = np.stack([np.bincount(start, away[:, k], len(part.vertices)) for k in range(3)], 1)
    # Two unit vectors that go straight on add up to nothing: |a + b| = 2 sin(bend / 2).
    bends = np.linalg.norm(total, axis=1) > 2.0 * np.sin(0.5 * np.radians(LEAST_BEND_DEG))
    return part.vertices[(count > 2) | ((count == 2) & bends)]


def visible_points(caster: RayCaster, points_obj: FloatArray, eye_obj: FloatArray, slack_mm: float) -> BoolArray:
    """(n,) bool: nothing hides the points (n, 3) on the part's surface from an eye (3,), all in mm.

    slack_mm: how near to the point a hit still counts as the point itself (0.005 of the diameter serves).
    """
    directions = points_obj - eye_obj
    distance = np.linalg.norm(directions, axis=1)
    directions = directions / np.maximum(distance, 1e-9)[:, None]
    origins = np.broadcast_to(eye_obj, points_obj.shape)
    return ~caster.occluded(origins, directions, distance - slack_mm)
