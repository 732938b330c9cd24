"""Turns after which most of a part looks the same, but not all: by a tooth of a gear, a spline, a bolt hole.

At a pose that is off by such a turn nearly every edge is found, and a wheel that turns by more than half a tooth from
one frame to the next seems to turn the other way. Turns by equal shares of a round are tried about the axes of
`turning.likely_axes`; edges that are round about an axis, which any turn lays onto themselves, do not count there.
"""

from __future__ import annotations

import cv2
import numpy as np

from acp_lab.cad.creases import Creases
from acp_lab.cad.edges import EdgeSamples
from acp_lab.cad.part import Part
from acp_lab.cad.turning import ODD_ANGLES, SAME_AXIS, likely_axes, telling_steps, turn_about
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import rotation_angle_deg

_LEAST_FOLD, _MOST_FOLD = 3, 120
_TOLERANCE = 0.006
"""Of the diameter: what tells such turns apart also moves the middle of the surface off the axis."""
_ALIKE = 0.6
"""Share of the edges that are not round which lie on edges after a turn; half-way clearly fewer do."""
_CLEARLY_LESS = 0.7
_LEAST_SHARE = 0.15
"""Of all edges that are not round about an axis; with fewer nothing could be said."""
_SAMPLES, _FEW = 400, 60
_SAME_DEG = 1.0
"""Turns that differ by less are one."""


def near_turns(part: Part, edges: EdgeSamples) -> FloatArray:
    """(k, 4, 4) by rising angle; none for most parts, nor any of the part's symmetries."""
    creases = Creases(edges, part.diameter)
    rows = np.arange(min(len(creases), _SAMPLES))
    if not len(rows):
        return np.zeros((0, 4, 4))
    middle, axes = likely_axes(part)
    turns = list[FloatArray]()
    for axis in axes:
        if any(abs(axis @ np.array(line)) > SAME_AXIS for line, _ in part.symmetries.continuous):
            continue  # any turn about it is a symmetry
        # What tells the turns apart moves the middle of the surface off the axis, but seldom what is outermost.
        for centre in (middle, _middle_of_rim(part, axis, middle)):
            equal = _equal_turns(creases, centre, axis, rows)
            if equal:
                turns += equal
                break
    exact = part.symmetries.transforms()
    other = [turn for turn in turns if all(_angle_deg(same, turn) > _SAME_DEG for same in exact)]
    return np.array(sorted(other, key=lambda turn: round(_angle_deg(np.eye(4), turn), 6))).reshape(-1, 4, 4)


def _equal_turns(creases: Creases, centre: FloatArray, axis: FloatArray, rows: np.ndarray) -> list[FloatArray]:
    """Turns (4, 4) by equal shares of a round, about an axis (3,), that lay most of the samples `rows` onto edges.

    All but the whole round; none where there are no such.
    """

    def covered(angle: float, of: np.ndarray) -> float:
        return float(creases.covered(turn_about(centre, axis, angle), _TOLERANCE, of).mean())

    odd = [creases.covered(turn_about(centre, axis, angle), _TOLERANCE, rows) for angle in ODD_ANGLES]
    told = rows[~np.all(odd, axis=0)]
    if len(told) < _LEAST_SHARE * len(rows):
        return []
    for fold in range(_MOST_FOLD, _LEAST_FOLD - 1, -1):
        step = 2.0 * np.pi / fold
        if covered(step, told[:_FEW]) < _CLEARLY_LESS * _ALIKE:
            continue
        alike = covered(step, told)
        # With more teeth than are asked for, two or three of them may pass for one.
        if alike < _ALIKE or any(covered(step / parts, told) > _CLEARLY_LESS * alike for parts in (2, 3, 5)):
            continue
        middle = _centred(creases, centre, axis, fold, told)
        turns = [turn_about(middle, axis, step * k) for k in range(1, fold)]
        if all(creases.covered(turns[k - 1], _TOLERANCE, told).mean() >= _ALIKE for k in telling_steps(fold)):
            return turns
    return []


def _centred(creases: Creases, centre: FloatArray, axis: FloatArray, fold: int, rows: np.ndarray) -> FloatArray:
    """A centre (3,) of equal turns, moved to where more and more of them lay the samples `rows` onto edges."""
    steps = 1
    while steps <= fold // 2:
        turn = turn_about(centre, axis, 2.0 * np.pi * steps / fold)
        aside, found = creases.aside(turn, rows)
        # Another centre moves what is turned by (I - R) times the difference.
        off_mm = np.linalg.norm(aside[found], axis=1)
        across = aside[found] / np.maximum(off_mm, 1e-9)[:, None]
        moves, *_ = np.linalg.lstsq(across @ (np.eye(3) - turn[:3, :3]), -off_mm, rcond=1e-3)
        centre = centre + moves
        steps *= 2
    return centre


def _middle_of_rim(part: Part, axis: FloatArray, middle: FloatArray) -> FloatArray:
    """The middle (3,) of the smallest circle across an axis (3,) that holds the part, as high as another point (3,)."""
    first = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    plane = np.stack([first, np.cross(axis, first)]) / np.linalg.norm(first)
    flat = ((part.vertices - middle) @ plane.T).astype(np.float32)
    (x, y), _ = cv2.minEnclosingCircle(flat)
    return np.asarray(middle + np.array([x, y]) @ plane)


def _angle_deg(one: FloatArray, other: FloatArray) -> float:
    return rotation_angle_deg(one[:3, :3], other[:3, :3])
