"""Eight tracked parts that look nearly the same after a small turn about z: by a tooth, a spline, a hole, a notch.

Each has something that tells the turns apart: a keyway, a flat, one hole that is other than the rest. Convention and
groups: as in `cad_parts`; sizes 60 to 160 mm; none has a symmetry.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from manifold3d import CrossSection, Manifold

from data_recipes.metal.solids import block, bore, prism, rod, slot, toothed


def chain_sprocket() -> Manifold:
    """Group 3: a wheel of 22 round gaps for a chain, a hub on one side, a keyway, a bolt circle of four."""
    pitch = np.arange(22) * 2 * np.pi / 22
    outline = CrossSection.circle(44, 132)
    for angle in pitch:
        outline -= CrossSection.circle(4.2, 20).translate((43.5 * np.cos(angle), 43.5 * np.sin(angle)))
    body = prism(outline, 7, (0, 0, -3.5)) + rod(19, 16, (0, 0, 3), chamfer=1)
    body -= bore(9, (0, 0, 0)) + block((-2.5, 0, -40), (2.5, 12, 40)) + bore(2.5, (0, 0, 12), "x", 60, 24)
    for angle in (20, 110, 200, 290):
        body -= bore(3.4, _on_circle(29, angle), segments=32)
    return body


def splined_shaft() -> Manifold:
    """Group 3: a shaft with twelve splines, a collar with a flat, a journal with a cross hole and a groove."""
    outline = toothed(12, 15, 12, (-0.3, -0.27, 0.27, 0.3))
    body = prism(outline, 46, (0, 0, -8)) + rod(22, 8, (0, 0, -15)) + rod(13, 40, (0, 0, -54))
    body -= block((-40, 17, -20), (40, 40, -6)) + bore(3, (0, 0, -44), "x", 60, 24)
    return body - (rod(16, 3, (0, 0, -26)) - rod(11, 3, (0, 0, -26))) + rod(8, 14, (0, 0, 37), chamfer=1.5)


def ratchet_wheel() -> Manifold:
    """Group 3: a wheel of eighteen saw teeth with a square hole, a curved slot, a boss with a pin hole beside it."""
    outline = toothed(18, 40, 34.5, (-0.5, 0.42, 0.5), (0, 1, 0))
    body = prism(outline, 12, (0, 0, -6)) + rod(17, 7, (0, 0, 5.5)) - block((-8, -8, -30), (8, 8, 30))
    slotted = [bore(3.2, _on_circle(25, angle), segments=24) for angle in range(60, 125, 6)]
    return body - sum(slotted[1:], slotted[0]) - bore(3.2, _on_circle(25, 260), segments=24)


def bolted_flange() -> Manifold:
    """Group 2: a pipe flange with twelve bolt holes, a raised face, a notch in its rim and a port beside its bore."""
    body = rod(55, 12, (0, 0, -6), chamfer=1.5) + rod(33, 8, (0, 0, 5)) - bore(22, (0, 0, 0))
    for k in range(12):
        body -= bore(4.2, _on_circle(44, 30 * k + 15), segments=32)
    body -= prism(CrossSection.circle(5, 32), 40, (57, 0, -20)) + bore(2.5, (0, 27.5, 0), segments=24)
    return body + block((-7, -42, -18), (7, -24, -5))


def timing_pulley() -> Manifold:
    """Group 3: a pulley for a toothed belt of 24 gaps between two flanges, a hub with a set screw, a D bore."""
    body = prism(toothed(24, 30, 27, (-0.3, -0.22, 0.22, 0.3)), 18, (0, 0, -9))
    body += rod(33, 2, (0, 0, -11)) + rod(33, 2, (0, 0, 9)) + rod(16, 14, (0, 0, 10), chamfer=1)
    shaft = CrossSection.circle(7, 48) - CrossSection.square((20, 20)).translate((5, -10))
    body -= prism(shaft, 90, (0, 0, -45)) + bore(2.2, (12, 0, 18), "x", 16, 24)
    return body - bore(3, (0, -22, 0), segments=24) - rod(24, 3, (0, 0, -11.5))


def slotted_nut() -> Manifold:
    """Group 3: a large hexagon nut with a crown of six slots, a collar, and a pin hole through one of its sides."""
    body = rod(36, 24, (0, 0, -12), segments=6) + rod(28, 12, (0, 0, 11)) + rod(38, 4, (0, 0, -15))
    for k in range(3):
        body -= block((-4, -60, 14), (4, 60, 40)).rotate((0, 0, 60 * k))
    return body - bore(17, (0, 0, 0)) - bore(3.5, (0, 30, 0), "y", 40, 24) - block((26, -9, -40), (50, 9, -10))


def brake_disc() -> Manifold:
    """Group 3: a disc with twenty slanting slots, a hat with five bolt holes and one hole for a pin."""
    body = rod(60, 8, (0, 0, -4)) + rod(32, 18, (0, 0, 3), chamfer=2) - rod(27, 20, (0, 0, -6)) - bore(15, (0, 0, 0))
    for k in range(20):
        cut = slot(16, 3.6, (47, 0, 0), "x", "z", 40).rotate((0, 0, 25)).translate((0, -18, 0))
        body -= cut.rotate((0, 0, 18 * k))
    for k in range(5):
        body -= bore(3.4, _on_circle(22.5, 72 * k), segments=32)
    return body - bore(2.2, _on_circle(22.5, 36), segments=24) - block((-70, -4, -1), (-55, 4, 10))


def milling_cutter() -> Manifold:
    """Group 4: a shell cutter with ten twisted gashes, a drive slot on top, a keyway and a wear mark in one tooth."""
    body = toothed(10, 38, 31, (-0.45, 0.05, 0.45), (0.2, 1, 0)).extrude(26, 12, 22).translate((0, 0, -13))
    body += rod(24, 10, (0, 0, 12), chamfer=1) - bore(11, (0, 0, 0))
    body -= bore(11, (0, 0, 0)) + block((-30, -5, 17), (30, 5, 30)) + block((-3, 0, -40), (3, 14, 40))
    return body - rod(20, 5, (0, 0, -14)) - block((-45, -6, 4), (-30, 6, 20))


TOOTHED: dict[str, tuple[int, Callable[[], Manifold]]] = {
    "chain_sprocket": (3, chain_sprocket),
    "splined_shaft": (3, splined_shaft),
    "ratchet_wheel": (3, ratchet_wheel),
    "bolted_flange": (2, bolted_flange),
    "timing_pulley": (3, timing_pulley),
    "slotted_nut": (3, slotted_nut),
    "brake_disc": (3, brake_disc),
    "milling_cutter": (4, milling_cutter),
}
"""Group and builder by name."""


def _on_circle(radius: float, angle_deg: float) -> tuple[float, float, float]:
    """A place on a circle about z."""
    angle = np.deg2rad(angle_deg)
    return float(radius * np.cos(angle)), float(radius * np.sin(angle)), 0.0
