"""Finding the turns after which a part looks the same.

A data set in the BOP layout says which they are; a CAD file alone does not. Every symmetry leaves the middle of the
surface where it is, and its axis is a principal axis of the surface, or lies across one. So turns by all angles, and by
2 to `MOST_FOLD` equal ones, are tried about those axes, about the file's own, for cubes and the like about those across
the largest faces, and half turns about axes across. A turn counts when the surface lies on itself after it, asked by
rays at points all over it, and every edge on an edge, a small hole's too: what a camera can tell apart is no symmetry.
"""

from __future__ import annotations

import numpy as np

from acp_lab.cad.creases import Creases
from acp_lab.cad.edges import EdgeSamples
from acp_lab.cad.models_info import Symmetries
from acp_lab.cad.part import Part
from acp_lab.cad.raycast import RayCaster, make_caster
from acp_lab.cad.turning import ODD_ANGLES, likely_axes, telling_steps, turn_about
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import transform

MOST_FOLD = 72
MOST_TURNS = 2 * MOST_FOLD
"""Of a group: no solid but a ball has more than a prism of `MOST_FOLD` sides."""
_SURFACE_TOLERANCE, _SURFACE_OFF = 0.002, 0.005
"""Of the diameter; share of the surface that may lie on none."""
_EDGE_TOLERANCE, _EDGES_OFF = 0.003, 0.004
"""The same for edges: a hole of a fiftieth of the diameter is more."""
_SAMPLES, _FEW = 4000, 250
_FACING = 0.85
"""Cosine between normals that look the same way: facets of what is round differ."""
_PHASE_STEP_DEG = 1.0


def in_words(symmetries: Symmetries) -> str:
    """Such as "any turn about (0, 0, 1) and 1 other"; empty for none."""
    lines = [
        f"any turn about ({', '.join(f'{round(v, 3) + 0.0:g}' for v in axis)})" for axis, _ in symmetries.continuous
    ]
    count = len(symmetries.discrete)
    if count:
        lines.append(f"{count} other{'s'[: count != 1]}" if lines else f"{count} turn{'s'[: count != 1]}")
    return " and ".join(lines)


def find_symmetries(part: Part, edges: EdgeSamples) -> Symmetries:
    """The turns after which a part looks the same, none for most; edges: of this part, all that can be seen.

    The same part gives the same answer. Reference for what is sought: BOP's `models_info.json`.
    """
    search = _Search(part, edges, make_caster(part))
    lines = [axis for axis in search.axes if all(search.matches(axis, angle) for angle in ODD_ANGLES)]
    turns: list[FloatArray] = []
    if lines:  # what is about such a line is no news, and any half turn across it is as good as another
        turns = search.half_turns_across(lines[0], 1) if len(lines) == 1 else []
    else:
        folds = [(search.fold(axis), axis) for axis in search.axes]
        many = [(fold, axis) for fold, axis in folds if fold > 2]
        for fold, axis in many:
            turns += [search.turn(axis, 2.0 * np.pi / fold), *search.half_turns_across(axis, fold)]
        # Half turns across one of those are known by now, and more exactly.
        across = [axis for fold, axis in folds if fold == 2 and all(abs(axis @ main) > 0.05 for _, main in many)]
        turns += [search.turn(axis, np.pi) for axis in across]
    lines = [axis * np.sign(axis[np.abs(axis).argmax()]) for axis in lines]
    offset = (float(search.centre[0]), float(search.centre[1]), float(search.centre[2]))
    continuous = tuple(((float(a[0]), float(a[1]), float(a[2])), offset) for a in lines)
    return Symmetries(np.array(_closed(turns)).reshape(-1, 4, 4), continuous)


class _Search:
    """What is tried on one part."""

    def __init__(self, part: Part, edges: EdgeSamples, caster: RayCaster) -> None:
        self._part, self._caster, self._diameter = part, caster, part.diameter
        self._creases = Creases(edges, part.diameter)
        self._sampled, self._normals = surface_samples(part, _SAMPLES)
        self.centre, self.axes = likely_axes(part)

    def turn(self, axis: FloatArray, angle: float) -> FloatArray:
        """By an angle, rad, about an axis (3,) through the centre: (4, 4)."""
        return turn_about(self.centre, axis, angle)

    def matches(self, axis: FloatArray, angle: float) -> bool:
        """Whether the part looks the same after a turn."""
        turn, within = self.turn(axis, angle), _SURFACE_TOLERANCE * self._diameter
        if (self._distances(turn, within, _FEW) >= within).mean() > 8.0 * _SURFACE_OFF:
            return False
        is_off = self._distances(turn, within, _SAMPLES) >= within
        if is_off.mean() > _SURFACE_OFF:
            return False
        edges_off = ~self._creases.covered(turn, _EDGE_TOLERANCE)
        return bool(np.count_nonzero(edges_off) <= _EDGES_OFF * len(edges_off))

    def fold(self, axis: FloatArray) -> int:
        """How many times the part looks the same in a whole turn about an axis (3,), at most `MOST_FOLD`."""
        for fold in range(MOST_FOLD, 1, -1):
            if all(self.matches(axis, 2.0 * np.pi * steps / fold) for steps in telling_steps(fold)):
                return fold
        return 1

    def half_turns_across(self, axis: FloatArray, fold: int) -> list[FloatArray]:
        """One half turn about an axis across another, about which the part looks the same `fold` times; or none."""
        first = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
        first /= np.linalg.norm(first)
        second = np.cross(axis, first)
        step = np.deg2rad(_PHASE_STEP_DEG)

        def across(phase: float) -> FloatArray:
            return np.cos(phase) * first + np.sin(phase) * second

        def error(phase: float) -> float:
            return float(self._distances(self.turn(across(phase), np.pi), 0.03 * self._diameter, 4 * _FEW).mean())

        phases = np.arange(0.0, np.pi / fold + step, step) if fold > 1 else np.zeros(1)
        errors = [error(phase) for phase in phases]
        best = float(phases[int(np.argmin(errors))])
        while fold > 1 and step > 1e-4:
            best = min((best - step, best, best + step), key=error)
            step /= 2.0
        return [self.turn(across(best), np.pi)] if self.matches(across(best), np.pi) else []

    def _distances(self, turn: FloatArray, reach: float, count: int) -> FloatArray:
        """How far `count` points of the turned surface are from the surface, mm, at most `reach`.

        Along their normals, to what faces the same way.
        """
        there, facing = transform(turn, self._sampled[:count]), self._normals[:count] @ turn[:3, :3].T
        distance, face = self._caster.first_hit(there + reach * facing, -facing)
        hit = face >= 0
        away = np.full(len(there), reach)
        alike = np.einsum("ij,ij->i", facing[hit], self._part.face_normals[face[hit]]) > _FACING
        away[hit] = np.where(alike, np.minimum(np.abs(distance[hit] - reach), reach), reach)
        return away


def surface_samples(part: Part, count: int) -> tuple[FloatArray, FloatArray]:
    """Points (n, 3), mm, all over the surface, of each face in proportion to its area, and its normals (n, 3) there.

    The same part gives the same points.
    """
    rng = np.random.default_rng(0)
    a, b, c = part.vertices[part.faces].transpose(1, 0, 2)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    face = rng.choice(len(area), count, p=area / area.sum())
    u, v = rng.random((2, count, 1))
    fold = u + v > 1.0
    u, v = np.where(fold, 1.0 - u, u), np.where(fold, 1.0 - v, v)
    return a[face] + u * (b - a)[face] + v * (c - a)[face], part.face_normals[face]


def _closed(turns: list[FloatArray]) -> list[FloatArray]:
    """All that turns (4, 4) make of each other, without the identity."""
    known = [np.eye(4)]
    new = known
    while new and len(known) < MOST_TURNS:
        found = list[FloatArray]()
        for one in new:
            for turn in turns:
                made = turn @ one
                if not any(np.allclose(made[:3, :3], other[:3, :3], atol=0.02) for other in (*known, *found)):
                    found.append(made)
        known, new = known + found, found
    return known[1:MOST_TURNS]
