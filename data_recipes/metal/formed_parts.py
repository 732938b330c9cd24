"""Sixteen tracked parts that are not milled: cast, forged, bent, wound, toothed and twisted ones.

Smooth bodies whose outline is all that a picture shows, thin sheet, wire, and surfaces with many equal edges close
together. Convention and groups: as in `cad_parts`; sizes 60 to 160 mm. One of them has a symmetry about z.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from manifold3d import CrossSection, Manifold, Mesh64, OpType

from data_recipes.metal.machined_parts import turn_about_z
from data_recipes.metal.solids import block, bore, fillet_inner, prism, profile, rod, slot, toothed

Point = tuple[float, float, float]
Solid = Callable[[Point], float]
"""How far inside a body a point is, mm; negative outside. In plain floats: it is asked for hundreds of thousands."""


def connecting_rod() -> Manifold:
    """Group 4: a forged rod, all rounded, with two machined eyes of unequal size and an oil hole."""

    def inside(p: Point) -> float:
        big, small = _disc(p, (-38, 0, 0), 24, 11, 3), _disc(p, (46, 0, 0), 13, 9, 3)
        shank = _capsule(p, (-38, 0, 0), (46, 0, 0), 7.5)
        return _blend(_blend(big, shank, 9), small, 7)

    body = _cast(inside, (-66, -28, -15), (64, 28, 15), 2.2)
    body -= bore(17, (-38, 0, 0)) + bore(8, (46, 0, 0)) + block((-90, -40, 10), (-10, 40, 30))
    body += block((-46, 18, -9), (-28, 30, 2)) + rod(4, 9, (20, 0, 2), segments=32)
    return body - block((-90, -40, -30), (-10, 40, -10)) - bore(2, (46, 12, 0), "y", 14, 16)


def pump_housing() -> Manifold:
    """Group 4: a cast housing with fillets everywhere, a machined flange, a slanting spout and two feet."""

    def inside(p: Point) -> float:
        hull = _disc(p, (0, 0, 2), 30, 17, 6)
        spout = _capsule(p, (14, 20, 4), (34, 44, 12), 11)
        feet = max(_disc(p, (-30, -26, -16), 9, 5, 3), _disc(p, (26, -30, -16), 9, 5, 3))
        boss = _capsule(p, (-20, 10, 10), (-36, 22, 14), 8)
        return _blend(_blend(_blend(hull, spout, 7), boss, 6), feet, 8)

    body = _cast(inside, (-48, -44, -24), (54, 64, 30), 2.4)
    body -= block((-60, -60, 17), (14, 30, 40)) + bore(19, (0, 0, 14), "z", 20) + bore(9, (0, 0, 0))
    body -= (
        block((-60, -60, -40), (60, 60, -19)) + bore(3, (-30, -26, 0), segments=24) + bore(3, (26, -30, 0), segments=24)
    )
    return body - prism(CrossSection.circle(7, 40), 60).rotate((-64, 0, -50)).translate((10, 14, 2))


def crane_hook() -> Manifold:
    """Group 4: a forged hook, thick in its bow and thin at its tip, with a turned shank and a cross hole."""
    t = np.linspace(0, 1, 60)
    turn = np.deg2rad(90 - 250 * np.clip((t - 0.3) / 0.7, 0, 1))
    bow = np.stack([26 * np.cos(turn), 26 * np.sin(turn) - 20, 0 * t], axis=1)
    straight = np.stack([0 * t, 52 - 46 * t / 0.3, 0 * t], axis=1)
    path = np.where(t[:, None] < 0.3, straight, bow)
    radius = np.interp(t, (0, 0.3, 0.6, 0.95, 1), (9, 10, 15, 6, 4))
    body = _swept(path, radius, 28, flatten=0.75)
    return body + rod(12, 10, (0, 44, 0), "y", 1.5) - bore(3, (0, 49, 0), "x", 60, 24)


def bent_pipe() -> Manifold:
    """Group 4: a pipe, bent in two planes, with a hexagon at one end and a flange with two holes at the other."""
    corners = np.array([[-52.0, -20, 0], [-10, -20, 0], [22, 22, 0], [22, 34, 44]])
    pipe = _swept(_rounded(corners, 16), 6.5, 28)
    ear = profile([(-22, -9), (22, -9), (22, 9), (-22, 9)], 8)
    flange = prism(ear, 6) - bore(3, (15, 0, 0), segments=24) - bore(3, (-15, 0, 0), segments=24)
    tip = corners[3] - corners[2]
    tilt = np.rad2deg(np.arctan2(np.hypot(tip[0], tip[1]), tip[2]))
    flange = flange.rotate((0, tilt, np.rad2deg(np.arctan2(tip[1], tip[0])))).translate(tuple(corners[3] - 0.05 * tip))
    return pipe + flange + rod(11, 12, (-52, -20, 0), "x", segments=6) - bore(4.5, (-52, -20, 0), "x", 40, 32)


def turbine_blade() -> Manifold:
    """Group 4: a twisted, tapered blade on a platform with a notched root."""
    s = np.linspace(0, 1, 28)
    camber, half = 7 * np.sin(np.pi * s), 3.4 * np.sqrt(s + 0.01) * (1 - s) * 2.2 + 0.5
    above, below = np.stack([46 * s - 20, camber + half], 1), np.stack([46 * s - 20, camber - half], 1)
    blade = CrossSection([np.vstack([below, above[::-1]])]).extrude(84, 28, 34, (0.62, 0.62))
    root = [(-16, 0), (-16, -5), (-10, -8), (-13, -12), (-8, -16), (-9, -20), (9, -20), (8, -16), (13, -12), (10, -8)]
    foot = prism(profile([*root, (16, -5), (16, 0)]), 50, (0, 0, -24), "z").rotate((90, 0, 90)).translate((2, 3, -4))
    return blade + block((-26, -14, -5), (30, 22, 1)) + foot - block((24, -30, -40), (40, 40, -14))


def spanner() -> Manifold:
    """Group 4: an open-ended spanner with a ring at its other end, drop-forged: thin, round and nearly flat."""
    outline = CrossSection.circle(17, 64).translate((-58, 0)) + CrossSection.circle(14, 64).translate((60, 0))
    outline = fillet_inner(outline + profile([(-58, -7), (60, -6), (60, 6), (-58, 7)]), 14)
    jaw = profile([(-40, -7.5), (1, -7.5), (7, 0), (1, 7.5), (-40, 7.5)]).rotate(15).translate((-58, 0))
    body = prism(outline - jaw - CrossSection.circle(8.5, 12).translate((60, 0)), 8, (0, 0, -4))
    body -= slot(56, 6, (2, 0, 4), "x", "z", 3.6) + slot(56, 6, (2, 0, -4), "x", "z", 3.6)
    return body - block((44, -30, 1), (90, 30, 9))


def spur_gear() -> Manifold:
    """Group 3: a gear of 30 teeth with a hub, a keyway, a lightening hole larger than the other two and a recess."""
    body = prism(toothed(30, 37, 31.5), 14, (0, 0, -7)) + rod(15, 14, (0, 0, 6))
    body -= bore(8, (0, 0, 0)) + block((-2.5, 0, -40), (2.5, 11, 40)) + (rod(28, 4, (0, 0, 4)) - rod(16, 9, (0, 0, 3)))
    for angle, radius in ((90, 4.5), (210, 3.2), (330, 3.2)):
        at = np.deg2rad(angle + 25)
        body -= bore(radius, (22 * np.cos(at), 22 * np.sin(at), 0), segments=32)
    return body


def helical_pinion() -> Manifold:
    """Group 3: a shaft with slanting teeth cut on it, a flat, a shoulder and a threaded end."""
    teeth = toothed(16, 20, 15.5).extrude(34, 24, 50).translate((0, 0, -10))
    body = teeth + rod(10, 100, (0, 0, -50), segments=48) + rod(14, 7, (0, 0, 26), "z", 1)
    body += _threaded(7.5, 22, 3, (0, 0, 46))
    return body - block((5.5, -20, -60), (30, 20, -28)) - bore(2, (0, 0, 40), "x", 60, 20)


def hexagon_bolt() -> Manifold:
    """Group 3: a bolt with a coarse thread, a washer face, a hole across its tip and a corner cut off its head."""
    body = (
        rod(20, 14, (0, 0, 44), segments=6)
        - block((10, -30, 40), (30, 30, 70))
        + rod(21, 3, (0, 0, 42))
        + rod(11.5, 42, (0, 0, 2), segments=48)
    )
    body += _threaded(11.5, 52, 5, (0, 0, -50))
    return body - bore(2.5, (0, 0, -40), "x", 60, 24)


def torsion_spring() -> Manifold:
    """Group 3: a wound spring with one leg along its last turn and one along its axis."""
    turn = np.linspace(0, 2 * np.pi * 6.3, 260)
    coil = np.stack([19 * np.cos(turn), 19 * np.sin(turn), 6.2 * turn / (2 * np.pi) - 19.5], axis=1)
    ahead = coil[0] - np.array([0.0, 1.0, 0.0]) * np.array([[40.0], [27.0], [14.0]])
    along = np.array([-np.sin(turn[-1]), np.cos(turn[-1]), 0.0])
    bend = np.deg2rad(np.arange(15, 91, 15))[:, None]
    bent = coil[-1] + 7 * (np.sin(bend) * along + (1 - np.cos(bend)) * np.array([0.0, 0.0, 1.0]))
    path = np.vstack([ahead, coil, bent, bent[-1] + [[0.0, 0.0, 9.0], [0.0, 0.0, 18.0]]])
    return _swept(path, 2.2, 20)


def knurled_knob() -> Manifold:
    """Group 3: a knob with a straight knurl of 48 ribs, a collar with a pointer, and a set screw's hole."""
    body = prism(toothed(48, 27, 25.4), 24, (0, 0, -4)) + rod(33, 6, (0, 0, -10)) + rod(14, 22, (0, 0, -28))
    body += prism(profile([(28, -6), (44, 0), (28, 6)]), 6, (0, 0, -10))
    return body - rod(20, 6, (0, 0, 16)) - bore(3, (0, 0, -30), "z", 40, 40) - bore(2.5, (0, 10, -21), "y", 20, 24)


def impeller() -> Manifold:
    """Group 4: nine curved vanes on a disc, which looks the same every 40 degrees about z."""
    t = np.linspace(0, 1, 16)
    angle, reach = 1.1 * t**1.3, 11 + 37 * t
    middle = np.stack([reach * np.cos(angle), reach * np.sin(angle)], 1)
    side = np.gradient(middle, axis=0) @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    side *= 1.5 / np.linalg.norm(side, axis=1, keepdims=True)
    vane = prism(profile(np.vstack([middle + side, (middle - side)[::-1]])), 24)
    cone = rod(14, 26, (0, 0, 0), radius_end=8, segments=90)
    body = rod(49, 4, (0, 0, -4), segments=90) + cone - bore(4.5, (0, 0, 0), segments=90)
    shroud = Manifold.revolve(CrossSection([np.array([[0, 0], [50, 0], [50, 9], [18, 24], [0, 24]], float)]), 90)
    for k in range(9):
        body += (vane ^ shroud).rotate((0, 0, 40.0 * k)) - bore(4.5, (0, 0, 0), segments=90)
    return body


def bent_bracket() -> Manifold:
    """Group 2: sheet of 2 mm, bent twice with round bends, with holes, a slot and a cut corner."""
    path = _rounded(np.array([[-46.0, 30, 0], [-46, 0, 0], [24, 0, 0], [46, 40, 0]]), 5)[:, :2]
    step = np.gradient(path, axis=0)
    side = step @ np.array([[0.0, 1.0], [-1.0, 0.0]]) / np.linalg.norm(step, axis=1, keepdims=True)
    body = prism(profile(np.vstack([path + side, (path - side)[::-1]])), 56)
    body -= (
        bore(4, (-46, 18, 38), "x", 20) + bore(3, (-46, 20, 14), "x", 20, 32) + slot(18, 7, (-20, 0, 28), "z", "y", 20)
    )
    body -= bore(9, (8, 0, 26), "y", 20) + block((28, -10, -5), (60, 60, 8)) + bore(3.5, (36, 22, 32), "x", 30, 32)
    return body - prism(profile([(-50, 42), (-30, 60), (-70, 60)]), 30, (0, 20, 0))


def sieve_plate() -> Manifold:
    """Group 2: a plate of 3 mm with a field of 63 equal holes, a bent edge, a cut corner and an ear."""
    outline = profile([(-50, -36), (50, -36), (50, 20), (36, 34), (-50, 34)], 4)
    body = prism(outline, 3) + block((-46, -36, 0), (46, -33, 14)) + block((50, -20, 0), (60, -4, 3))
    holes = [bore(3, (-40 + 10 * k, -22 + 7.5 * n, 0), segments=20) for n in range(7) for k in range(9)]
    return body - Manifold.batch_boolean(holes, OpType.Add) - bore(3, (55, -12, 0), segments=24)


def forged_lever() -> Manifold:
    """Group 4: a forging as it comes from the die: a bent lever between two bosses, with no sharp edge anywhere."""

    def inside(p: Point) -> float:
        arm = _blend(_capsule(p, (-48, -10, 0), (4, 8, 0), 8), _capsule(p, (4, 8, 0), (44, -16, 10), 7), 6)
        big, small = _disc(p, (-48, -10, 0), 18, 10, 6), _disc(p, (44, -16, 10), 12, 8, 6)
        return _blend(_blend(_blend(arm, big, 7), small, 6), _capsule(p, (4, 8, 0), (10, 34, -4), 6), 7)

    return _cast(inside, (-70, -34, -18), (62, 46, 24), 2.4)


def door_handle() -> Manifold:
    """Group 4: a cast handle with hardly a sharp edge: a curved, tapering grip on a neck and a rose with a lug."""

    def inside(p: Point) -> float:
        rose = _blend(_disc(p, (-42, 0, -28), 21, 6, 6), _disc(p, (-42, 20, -28), 9, 6, 6), 5)
        neck = _capsule(p, (-42, 0, -24), (-42, 0, 4), 8)
        grip = _blend(_capsule(p, (-42, 0, 4), (10, -8, 10), 9), _capsule(p, (10, -8, 10), (62, 8, 4), 6.5), 5)
        return _blend(_blend(rose, neck, 6), grip, 5)

    return _cast(inside, (-74, -30, -36), (76, 40, 26), 2.4)


FORMED: dict[str, tuple[int, Callable[[], Manifold]]] = {
    "connecting_rod": (4, connecting_rod),
    "spur_gear": (3, spur_gear),
    "bent_pipe": (4, bent_pipe),
    "bent_bracket": (2, bent_bracket),
    "hexagon_bolt": (3, hexagon_bolt),
    "turbine_blade": (4, turbine_blade),
    "sieve_plate": (2, sieve_plate),
    "torsion_spring": (3, torsion_spring),
    "forged_lever": (4, forged_lever),
    "pump_housing": (4, pump_housing),
    "helical_pinion": (3, helical_pinion),
    "crane_hook": (4, crane_hook),
    "knurled_knob": (3, knurled_knob),
    "spanner": (4, spanner),
    "impeller": (4, impeller),
    "door_handle": (4, door_handle),
}
"""Group and builder by name."""

FORMED_SYMMETRIES: dict[str, dict[str, object]] = {
    "impeller": {"symmetries_discrete": [turn_about_z(40 * k) for k in range(1, 9)]},
}
"""Entries of models_info.json, object frame, mm, for the parts that have any."""


def _cast(inside: Solid, low: Point, high: Point, edge: float) -> Manifold:
    """The surface of what lies inside, within a box, in triangles of about `edge` mm."""
    return Manifold.level_set(lambda x, y, z: inside((x, y, z)), [*low, *high], edge).simplify(0.01)


def _blend(a: float, b: float, fillet: float) -> float:
    """Two bodies as one, with a fillet of about `fillet` mm where they meet (a polynomial smooth maximum)."""
    share = max(fillet - abs(a - b), 0.0) / fillet
    return max(a, b) + share * share * fillet / 4


def _disc(p: Point, centre: Point, radius: float, half: float, rounding: float) -> float:
    """Inside a disc about z, `half` mm to both sides of its centre, with rounded rims."""
    side = math.hypot(p[0] - centre[0], p[1] - centre[1]) - radius + rounding
    up = abs(p[2] - centre[2]) - half + rounding
    return rounding - math.hypot(max(side, 0.0), max(up, 0.0)) - min(max(side, up), 0.0)


def _capsule(p: Point, start: Point, end: Point, radius: float) -> float:
    """Inside a round bar with round ends."""
    along = [b - a for a, b in zip(start, end, strict=True)]
    share = sum((x - a) * v for x, a, v in zip(p, start, along, strict=True)) / sum(v * v for v in along)
    share = min(max(share, 0.0), 1.0)
    return radius - math.dist(p, [a + share * v for a, v in zip(start, along, strict=True)])


def _rounded(corners: np.ndarray, radius: float) -> np.ndarray:
    """A polyline (n, 3) with its inner corners rounded, closely where it turns: (70, 3) points."""
    parts = [corners[:1]]
    for before, corner, after in zip(corners, corners[1:], corners[2:], strict=False):
        to_before, to_after = (v / np.linalg.norm(v) for v in (before - corner, after - corner))
        half = np.arccos(np.clip(to_before @ to_after, -1, 1)) / 2
        cut, middle = radius / np.tan(half), to_before + to_after
        centre = corner + middle / np.linalg.norm(middle) * radius / np.sin(half)
        first, last = corner + cut * to_before - centre, corner + cut * to_after - centre
        sweep = np.pi - 2 * half
        share = np.linspace(0, 1, 12)[:, None]
        arc = (np.sin((1 - share) * sweep) * first + np.sin(share * sweep) * last) / np.sin(sweep)
        parts.append(centre + arc)
    path = np.vstack([*parts, corners[-1:]])
    at = np.linspace(0, len(path) - 1, 70)
    return np.stack([np.interp(at, np.arange(len(path)), path[:, k]) for k in range(3)], axis=1)


def _swept(path: np.ndarray, radius: np.ndarray | float, segments: int, flatten: float = 1.0) -> Manifold:
    """A round bar along a path (n, 3), mm, with a radius everywhere or (n,) at each point.

    flatten: scale along the normal, which turns about the path no more than it must.
    """
    radius = np.broadcast_to(radius, len(path))
    tangent = np.gradient(path, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    normal = np.empty_like(path)
    normal[0] = np.cross(tangent[0], np.eye(3)[np.abs(tangent[0]).argmin()])
    for k in range(1, len(path)):  # carried along without turning about the path
        normal[k] = normal[k - 1] - (normal[k - 1] @ tangent[k]) * tangent[k]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    binormal = np.cross(tangent, normal)
    angle = 2 * np.pi * np.arange(segments) / segments
    rings = path[:, None] + radius[:, None, None] * (
        np.cos(angle)[:, None] * normal[:, None] * flatten + np.sin(angle)[:, None] * binormal[:, None]
    )
    ring, step = np.arange(segments), (np.arange(segments) + 1) % segments
    quads = np.concatenate(
        [
            np.stack(
                [k * segments + ring, k * segments + step, (k + 1) * segments + step, (k + 1) * segments + ring], 1
            )
            for k in range(len(path) - 1)
        ]
    )
    sides = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    first, last = len(path) * segments, len(path) * segments + 1
    end = (len(path) - 1) * segments
    caps = [np.stack([0 * ring + first, step, ring], 1), np.stack([0 * ring + last, end + ring, end + step], 1)]
    vertices = np.vstack([rings.reshape(-1, 3), path[:1], path[-1:]])
    return Manifold(Mesh64(vertices, np.vstack([sides, *caps]).astype(np.uint64)))


def _threaded(radius: float, length: float, pitch: float, base: tuple[float, ...]) -> Manifold:
    """A bar with a round thread of one start, from `base` along z: an eccentric circle, twisted."""
    depth = 0.3 * pitch
    outline = CrossSection.circle(radius - depth, 24).translate((depth, 0))
    return outline.extrude(length, round(24 * length / pitch), 360 * length / pitch).translate(base)
