"""Turns of a part: the axes about which it may look the same, or nearly so."""

from __future__ import annotations

import numpy as np

from acp_lab.cad.part import Part
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import make_pose, so3_exp

ODD_ANGLES = (1.0, 2.236, 0.6435)
"""rad; no number of equal parts fits into all three, so what they map to itself is round."""
SAME_AXIS = 0.9994
"""Cosine of two degrees: axes that differ by less are one."""
_FACES = 4


def likely_axes(part: Part) -> tuple[FloatArray, list[FloatArray]]:
    """The middle (3,) of a part's surface, mm, and directions (3,), unit, of axes through it.

    Across its largest faces, of its moments, and the file's own.
    """
    a, b, c = part.vertices[part.faces].transpose(1, 0, 2)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2.0
    middle = (a + b + c) / 3.0
    centre = area @ middle / area.sum()
    scatter = np.zeros((3, 3))
    for points, weight in ((a, 1.0), (b, 1.0), (c, 1.0), (middle, 9.0)):  # the integral over a triangle
        apart = points - centre
        scatter += weight * (area[:, None] * apart).T @ apart
    axes = list[FloatArray]()
    for axis in (*_across_largest_faces(part, area), *np.linalg.eigh(scatter)[1].T, *np.eye(3)):
        if not any(abs(axis @ known) > SAME_AXIS for known in axes):
            axes.append(axis)
    return centre, axes


def turn_about(centre: FloatArray, axis: FloatArray, angle: float) -> FloatArray:
    """(4, 4) by an angle, rad, about an axis (3,), unit, through a centre (3,), mm."""
    rotation = so3_exp(angle * axis)
    return make_pose(rotation, centre - rotation @ centre)


def telling_steps(fold: int) -> list[int]:
    """Which of `fold` equal turns are asked to know that there are so many.

    One of them, a half, a third, a quarter, a fifth and a seventh of a round: after one turn 31 fit where 30 do, after
    a third and a half of a round 72 where 66 do.
    """
    return sorted({1, *(fold // part for part in (2, 3, 4, 5, 7))} - {0})


def _across_largest_faces(part: Part, area: FloatArray) -> FloatArray:
    """Directions (k, 3) in which the most of the surface faces, up or down."""
    normals = part.face_normals
    upwards = np.sign(normals[np.arange(len(normals)), np.abs(normals).argmax(1)])[:, None] * normals
    _, number = np.unique(np.round(upwards, 3), axis=0, return_inverse=True)
    largest = np.argsort(-np.bincount(number.ravel(), area), kind="stable")[:_FACES]
    found = np.array(
        [np.average(upwards[number.ravel() == k], axis=0, weights=area[number.ravel() == k]) for k in largest]
    )
    return np.asarray(found / np.linalg.norm(found, axis=1, keepdims=True))
