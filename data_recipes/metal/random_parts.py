"""Parts that nobody drew: blocks, plates, hubs and angles with random cuts and bosses, each from its seed.

For training what must hold for any machined part, not for those of one list, and for tracking what nobody could tune
anything on. Their groups mean nothing, and they may have symmetries: `asymmetric_parts` are those without.
Convention: as in `cad_parts`; 70 to 125 mm across the corners of the bounding box.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import count

import numpy as np
from manifold3d import Manifold

from acp_lab.cad.part import Part
from data_recipes.metal.cad_parts import CadPart, make_part
from data_recipes.metal.solids import block, bore, mesh_arrays, prism, profile, rod, slot
from data_recipes.symmetries import find_symmetry

_LEAST_VOLUME = 4000.0
_PREFIX = "random "
_LEAST_UNLIKE = 0.03
"""Of the diameter, by which the half turn that comes nearest to a symmetry misses: else a pose is hardly unique."""
_SLOTS = (("x", "z"), ("y", "z"), ("x", "y"), ("z", "x"))


def random_part(seed: int) -> CadPart:
    """The part of a seed, 0 or more."""
    rng = np.random.default_rng([seed, 77])
    half = np.array([rng.uniform(20, 46), rng.uniform(16, 36), rng.uniform(5, 28)])
    body = _BODIES[rng.integers(4)](rng, half)
    for _ in range(rng.integers(2, 6)):
        change = _CHANGES[rng.integers(7)]
        place = np.array([rng.uniform(-side, side) for side in half])
        changed = change(rng, body, half, place)
        is_part = not changed.is_empty() and changed.volume() >= _LEAST_VOLUME and len(changed.decompose()) == 1
        body = changed if is_part else body
    vertices, faces = mesh_arrays(body)
    vertices = vertices - (vertices.min(0) + vertices.max(0)) / 2
    size = rng.uniform(70, 125) / float(np.linalg.norm(np.ptp(vertices, axis=0)))
    vertices = (vertices * size).astype(np.float32).astype(np.float64)
    return CadPart(f"{_PREFIX}{seed}", int(rng.integers(1, 5)), vertices, faces)


def asymmetric_parts(first_seed: int) -> Iterator[CadPart]:
    """The parts from a seed on that have no symmetry and nearly none."""
    for seed in count(first_seed):
        part = random_part(seed)
        symmetry = find_symmetry(Part.from_mesh(part.vertices, part.faces, part.name))
        if not symmetry and symmetry.best_error >= _LEAST_UNLIKE:
            yield part


def part_named(name: str) -> CadPart:
    """One of `cad_parts`, or a random one by the name that it has."""
    return random_part(int(name.removeprefix(_PREFIX))) if name.startswith(_PREFIX) else make_part(name)


def _block(rng: np.random.Generator, half: np.ndarray) -> Manifold:
    return block(list(-half), list(half))


def _plate(rng: np.random.Generator, half: np.ndarray) -> Manifold:
    count = rng.integers(5, 8)
    angles, radii = np.sort(rng.uniform(0, 2 * np.pi, count)), rng.uniform(0.65, 1.0, count)
    corners = np.stack([half[0] * radii * np.cos(angles), 1.2 * half[1] * radii * np.sin(angles)], 1)
    rounding = rng.uniform(0, 6) if rng.random() < 0.5 else 0.0
    plate = prism(profile(corners, rounding), 2 * half[2], (0, 0, -half[2]))
    return plate if plate.volume() >= 2000.0 else block(list(-half), list(half))  # angles may lie all on one side


def _hub(rng: np.random.Generator, half: np.ndarray) -> Manifold:
    radius = rng.uniform(16, 32)
    chamfer = rng.uniform(0, 3) if rng.random() < 0.5 else 0.0
    foot = rod(radius, 2 * half[2], (0, 0, -half[2]), "z", chamfer)
    return foot + rod(rng.uniform(8, 15), rng.uniform(10, 40), (0, 0, half[2] - 0.5), "z", rng.uniform(0, 2))


def _angle(rng: np.random.Generator, half: np.ndarray) -> Manifold:
    a, b, c = half
    foot = block((-a, -b, -c), (a, b, -c + rng.uniform(5, 10)))
    return foot + block((-a, -b, -c), (-a + rng.uniform(5, 12), b, rng.uniform(5, 30)))


def _with_hole(rng: np.random.Generator, body: Manifold, half: np.ndarray, place: np.ndarray) -> Manifold:
    radius = rng.uniform(2, 9)
    return body - bore(radius, list(place), "xyz"[rng.integers(3)])


def _without_corner(rng: np.random.Generator, body: Manifold, half: np.ndarray, place: np.ndarray) -> Manifold:
    low, high = _box(body)
    sides = np.where(rng.random(3) < 0.5, -1, 1)
    corner = np.where(sides < 0, low, high)
    depth = rng.uniform(0.2, 0.55, 3) * (high - low)
    one, other = corner - sides * depth, corner + 60 * sides
    return body - block(list(np.minimum(one, other)), list(np.maximum(one, other)))


def _with_slot(rng: np.random.Generator, body: Manifold, half: np.ndarray, place: np.ndarray) -> Manifold:
    length, width = rng.uniform(8, 25), rng.uniform(4, 10)
    return body - slot(length, width, list(place), *_SLOTS[rng.integers(4)])


def _with_boss(rng: np.random.Generator, body: Manifold, half: np.ndarray, place: np.ndarray) -> Manifold:
    base = (0.6 * place[0], 0.6 * place[1], _box(body)[1][2] - 1)
    radius, height = rng.uniform(5, 14), rng.uniform(8, 25)
    return body + rod(radius, height, base, "z", rng.uniform(0.5, 2) if rng.random() < 0.5 else 0.0)


def _with_groove(rng: np.random.Generator, body: Manifold, half: np.ndarray, place: np.ndarray) -> Manifold:
    width, y = rng.uniform(3, 8), rng.uniform(-0.7 * half[1], 0.7 * half[1])
    return body - block((-90, y - width, rng.uniform(-0.3 * half[2], 0.6 * half[2])), (90, y + width, 90))


def _with_block(rng: np.random.Generator, body: Manifold, half: np.ndarray, place: np.ndarray) -> Manifold:
    low = [place[0] - rng.uniform(4, 12), place[1] - rng.uniform(4, 12), 0.0]
    high = [place[0] + rng.uniform(4, 12), place[1] + rng.uniform(4, 12), _box(body)[1][2] + rng.uniform(4, 18)]
    return body + block(low, high)


def _with_facet(rng: np.random.Generator, body: Manifold, half: np.ndarray, place: np.ndarray) -> Manifold:
    low, high = _box(body)
    size, side = rng.uniform(5, 18), rng.choice([-1, 1])
    x, y = (high if side > 0 else low)[0], high[1]
    corner = profile([(x, y), (x - side * size, y), (x, y - size * rng.uniform(0.5, 1.5))])
    return body - prism(corner, 200, (0, 0, -100))


def _box(body: Manifold) -> tuple[np.ndarray, np.ndarray]:
    box = np.array(body.bounding_box())
    return box[:3], box[3:]


_BODIES: tuple[Callable[[np.random.Generator, np.ndarray], Manifold], ...] = (_block, _plate, _hub, _angle)
_CHANGES: tuple[Callable[[np.random.Generator, Manifold, np.ndarray, np.ndarray], Manifold], ...] = (
    _with_hole, _without_corner, _with_slot, _with_boss, _with_groove, _with_block, _with_facet,
)  # fmt: skip
