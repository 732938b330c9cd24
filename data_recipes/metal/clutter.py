"""Clutter on the bench: nuts, bolts, washers, plates, offcuts, cables, and other CAD parts."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from manifold3d import Manifold
from scipy.interpolate import CubicSpline

from data_recipes.metal.cad_parts import make_part
from data_recipes.metal.plan import FIRST_PARTS
from data_recipes.metal.solids import block, bore, mesh_arrays, prism, profile, rod, slot, tube

Rng = np.random.Generator


def nut(rng: Rng) -> Manifold:
    """Hexagon nut with a bore."""
    r = rng.uniform(8, 21)
    body = rod(r, rng.uniform(0.6, 0.9) * r, segments=6)
    return body - bore(r * rng.uniform(0.5, 0.62), (0, 0, 0), segments=40)


def bolt(rng: Rng) -> Manifold:
    """Hexagon bolt with a plain shank."""
    r, length = rng.uniform(3, 7), rng.uniform(22, 55)
    return rod(1.75 * r, 1.25 * r, segments=6) + rod(r, length, (0, 0, r), chamfer=0.2 * r, segments=40)


def washer(rng: Rng) -> Manifold:
    """Flat ring."""
    r = rng.uniform(9, 18)
    return rod(r, rng.uniform(1.5, 3)) - bore(r * 0.52, (0, 0, 0))


def plate(rng: Rng) -> Manifold:
    """Flat bar with a few holes."""
    a, b, t = rng.uniform(22, 48), rng.uniform(13, 24), rng.uniform(4, 9)
    body = prism(profile([(-a, -b), (a, -b), (a, b), (-a, b)], rng.uniform(2, 6)), t)
    for x in np.linspace(-0.7, 0.7, int(rng.integers(2, 4))) * a:
        body -= bore(rng.uniform(2.5, 5), (x, rng.uniform(-0.3, 0.3) * b, 0), segments=32)
    return body


def offcut(rng: Rng) -> Manifold:
    """Block with a step and a slot."""
    a, b, c = rng.uniform(12, 30), rng.uniform(12, 24), rng.uniform(8, 18)
    body = block((-a, -b, 0), (a, b, 2 * c))
    body -= block((rng.uniform(-0.2, 0.5) * a, -60, c * rng.uniform(0.7, 1.4)), (60, 60, 80))
    return body - slot(a, 0.4 * b, (-0.2 * a, 0, 0), "x", "z")


def pin(rng: Rng) -> Manifold:
    """Dowel pin or shaft with a shoulder, lying down."""
    r, length = rng.uniform(4, 11), rng.uniform(25, 70)
    return rod(r, length, (-length / 2, 0, r), "x", chamfer=0.15 * r) + rod(
        0.7 * r, 0.4 * length, (-0.85 * length, 0, r), "x"
    )


SMALL: tuple[Callable[[Rng], Manifold], ...] = (nut, bolt, washer, plate, offcut, pin, plate, nut)


def small_thing(rng: Rng) -> tuple[np.ndarray, np.ndarray]:
    """A random small thing: vertices (n, 3) about its box centre and faces (m, 3)."""
    body = SMALL[int(rng.integers(len(SMALL)))](rng)
    vertices, faces = mesh_arrays(body)
    return vertices - (vertices.min(0) + vertices.max(0)) / 2, faces


def other_part(rng: Rng, scale: float, avoid: str = "") -> tuple[np.ndarray, np.ndarray]:
    """One of the CAD parts at another scale, never the one called `avoid`: vertices and faces."""
    names = [n for n in FIRST_PARTS if n != avoid]
    part = make_part(names[int(rng.integers(len(names)))])
    return part.vertices * scale, part.faces


def cable(rng: Rng, half_mm: float) -> tuple[np.ndarray, np.ndarray]:
    """A cable that winds across the table, in world coordinates: vertices and faces."""
    radius = rng.uniform(1.8, 3.4)
    turn = rng.uniform(0, np.pi)
    along = np.linspace(-1.3 * half_mm, 1.3 * half_mm, 26)
    bend = np.cumsum(np.cumsum(rng.standard_normal(26)))
    bend = (bend - np.linspace(bend[0], bend[-1], 26)) * 4 + rng.uniform(0.45, 1.0) * half_mm * rng.choice([-1, 1])
    knots = np.stack([along * np.cos(turn) - bend * np.sin(turn), along * np.sin(turn) + bend * np.cos(turn)], 1)
    xy = CubicSpline(np.arange(26), knots)(np.linspace(0, 25, 90))
    return mesh_arrays(tube(np.column_stack([xy, np.full(90, radius)]), radius))
