"""The tracked parts: CAD models made in code, in four groups of rising complexity.

Group 1 prismatic, 2 bracket with holes and ribs, 3 turned and milled with bosses and chamfers, 4 ribs and
curved surfaces. Convention: mm, origin at the centre of the bounding box, sharp edges (the rendered twin
with broken edges is made in `edge_break`), vertices rounded to float32 because that is what the PLY holds.
The parts of this module have no symmetry, so that a pose is unique; more parts are in `machined_parts`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from manifold3d import CrossSection, Manifold
from scipy.spatial import ConvexHull
from scipy.spatial.distance import pdist

from data_recipes.metal.formed_parts import FORMED, FORMED_SYMMETRIES
from data_recipes.metal.machined_parts import MACHINED, SYMMETRIES
from data_recipes.metal.solids import (
    block,
    bore,
    countersink,
    fillet_inner,
    gusset,
    mesh_arrays,
    prism,
    profile,
    rod,
    slot,
)
from data_recipes.metal.toothed_parts import TOOTHED


@dataclass(frozen=True)
class CadPart:
    """A part as the tracker gets it: vertices (n, 3) float64 mm, faces (m, 3) int64, watertight, sharp.

    symmetries: entries of models_info.json, empty for a part without any.
    """

    name: str
    group: int
    vertices: np.ndarray
    faces: np.ndarray
    symmetries: Mapping[str, object] = field(default_factory=dict)

    @property
    def diameter(self) -> float:
        """Largest distance between two vertices, mm (BOP's definition)."""
        corners = self.vertices[ConvexHull(self.vertices).vertices]
        return float(pdist(corners).max())

    @property
    def radius(self) -> float:
        """Radius of the sphere about the origin that holds the part, mm."""
        return float(np.linalg.norm(self.vertices, axis=1).max())


def slot_block() -> Manifold:
    """Group 1: a fixture block with a T-slot, a step, a tilted corner and two different holes."""
    body = block((-38, -27, -14), (38, 27, 14))
    body -= block((-50, -6, 2), (50, 6, 20)) + block((-50, -11, -3), (50, 11, 2.5))
    body -= block((20, 11, 4), (50, 40, 20))
    corner = profile([(-38, -27), (-20, -27), (-38, -13)])
    body -= prism(corner, 60, (0, 0, -30))
    body -= bore(3.5, (-26, 19, 0)) + bore(5, (29, 19, 0), length=60)
    body -= bore(4, (28, -19, 0), "y", 30).translate((0, 0, -8))
    return body - block((-45, -40, 8), (-26, -11, 20))


def v_block() -> Manifold:
    """Group 1: a V-block: a V with a relief slot on top, a small one below, unequal clamping grooves, a step."""
    body = block((-38, -25, -20), (38, 25, 20))
    body -= prism(profile([(-20.5, 20.5), (-2, 2), (16.5, 20.5)]), 90, (-45, 0, 0), "x")
    body -= prism(profile([(-3.5, -20.5), (6, -11), (15.5, -20.5)]), 90, (-45, 0, 0), "x")
    body -= block((-45, -3.5, -4), (45, -0.5, 4))
    body -= block((-45, 20, -10), (45, 30, -3)) + block((-45, -30, 1), (12, -21.5, 7))
    body -= block((24, -30, 10), (45, 30, 30))
    return body - bore(3, (-30, 20.5, 0)) - bore(4, (31, -15, 0))


def l_bracket() -> Manifold:
    """Group 2: an L-bracket: rounded base with two holes and a slot, wall with a bore, two unequal ribs."""
    base = prism(profile([(-36, -24), (34, -24), (34, 24), (-36, 24)], 7), 9, (0, 0, -22))
    wall_outline = profile([(-24, -22), (24, -22), (24, 24), (13, 30), (-17, 30), (-24, 20)])
    wall = prism(wall_outline, 10, (-36, 0, 0), "x")
    body = base + block((-36, -24, -22), (-20, 24, -13)) + wall
    body += gusset((-26.5, -19, -13.5), (30, 38), 7, "y") + gusset((-26.5, 19.5, -13.5), (20, 24), 7, "y")
    body -= bore(5.5, (22, -12, 0)) + countersink(8.5, 8.5, (22, -12, -13))
    body -= bore(3.6, (25, 14, 0)) + slot(15, 7, (4, 2, -18), "x", "z", 30)
    body -= bore(9.5, (-30, 1, 11), "x", 60) + bore(2.6, (-30, 16, 21), "x", 60)
    body -= bore(2.6, (-30, -15, 23), "x", 60)
    return body


def u_clevis() -> Manifold:
    """Group 2: a clevis: two unequal cheeks with a cross bore on a ribbed foot with four fixing holes."""
    foot = prism(profile([(-33, -22), (33, -22), (33, 22), (-33, 22)], 5), 8, (0, 0, -25))
    left = prism(profile([(-17, -19), (17, -19), (11, 20), (-11, 20)], 6), 9, (-21, 0, 0), "x")
    right = prism(profile([(-17, -19), (17, -19), (15, 10), (8, 14), (-12, 14)], 4), 11, (11, 0, 0), "x")
    body = foot + left + right + block((-21, -17, -25), (-12, 17, -16)) + block((11, -17, -25), (22, 17, -16))
    body += gusset((21.5, 0, -17.5), (20, 10), 6, "y")
    body += gusset((-20.5, 0, -17.5), (24, -10), 6, "y")
    body -= bore(6.5, (-16, 1, 8), "x", 22) + bore(5, (16, 1, 2), "x", 40)
    for x, y, r in ((-27, -15, 2.8), (27, -15, 2.8), (-27, 15, 3.6), (27, 15, 2.8)):
        body -= bore(r, (x, y, 0))
    body -= slot(12, 8, (0, 3, -20), "y", "z", 40) + block((-9, -30, -19), (8, -14, -10))
    return body.scale((1.18, 1.18, 1.18))


def flange_hub() -> Manifold:
    """Group 3: a turned hub: stepped flange with a flat, chamfered boss with a cross hole, keyway, five holes."""
    outline = CrossSection(
        [
            np.array(
                [
                    (0, -21), (36, -21), (38.5, -18.5), (38.5, -10), (37, -8.5), (25, -8.5), (24, -7.5), (24, 0),
                    (21, 3), (17, 3), (17, 19), (15, 21), (0, 21),
                ],
                float,
            )
        ]
    )  # fmt: skip
    body = outline.revolve(64)
    body -= block((-60, 31, -40), (60, 60, 40))
    body -= bore(9, (0, 0, 0)) + block((-2.5, 0, -30), (2.5, 12, 30)) + countersink(11.5, 11.5, (0, 0, 21))
    for k in range(5):
        angle = np.deg2rad(20 + 55 * k - 90)
        body -= bore(3.2 if k else 4.4, (31 * np.cos(angle), 31 * np.sin(angle), 0), segments=32)
    body -= bore(3, (30, 0, 12), "x", 60) + block((12, -20, 8), (40, 20, 16.5)).translate((3.2, 0, 0))
    body -= block((-60, -12, -26), (-30, 10, -15))
    return body.scale((1.15, 1.15, 1.15))


def valve_body() -> Manifold:
    """Group 3: a milled valve body with three unequal chamfered ports, a mounting ear and a hex head."""
    body = block((-22, -19, -18), (22, 19, 18))
    edge = profile([(0, 0), (6, 0), (0, 6)])
    body -= prism(edge, 80, (-22, -19, -40)) + prism(edge.mirror((1.0, 0.0)), 80, (22, -19, -40))
    body += rod(15, 25, (20, 0, 0), "x", 2) + rod(11, 17, (0, 0, 17), "z", 1.5) + rod(8, 15, (-6, 17, -4), "y", 1)
    body += rod(13, 10, (-30, 0, 0), "x", 0) + rod(14, 12, (-40, 0, 0), "x", 0, segments=6)
    ear = profile([(-22, -19), (4, -19), (0, -34), (-18, -34)], 4)
    body += prism(ear, 8, (0, 0, -18))
    body -= bore(9.5, (30, 0, 0), "x", 50) + bore(6.5, (0, 0, 30), "z", 40) + bore(4.5, (-6, 30, -4), "y", 40)
    body -= bore(3.4, (-9, -27, 0)) + countersink(11.5, 11.5, (45, 0, 0), "x") + bore(4, (-40, 0, 0), "x", 16)
    return body - block((8, 12, 10), (40, 40, 40))


def finned_cover() -> Manifold:
    """Group 4: an arched cover with cooling ribs that follow the curve, a boss, and three fixing ears."""
    t = np.linspace(-1.0, 1.0, 30)
    outer = np.stack([31 * t, 17 * np.sqrt(1.0 - 0.92 * t**2) - 6], 1)
    section = profile([(-31.0, -13.0), (31.0, -13.0), *outer[::-1]])
    inner = section.offset(-4.0).translate((0.0, -3.0))
    body = prism(section, 68, (-34, 0, 0), "x") - prism(inner, 56, (-30, 0, 0), "x")
    body -= block((-30, -26, -40), (26, 26, -8))
    rib = section.offset(3.6)
    for x, thickness in ((-24, 4), (-13, 4), (-2, 4), (21, 5)):
        body += prism(rib, thickness, (x, 0, 0), "x") ^ block((-60, -40, -9), (60, 40, 40))
    body += rod(10, 21, (10, 4, 0), "z", 1.2)
    for x, y in ((-27, -36), (27, -36), (4, 36)):
        tab = prism(profile([(x - 8, -8), (x + 8, -8), (x + 6, 10), (x - 6, 10)], 5), 6).mirror((0.0, 1.0, 0.0))
        tab = tab if y < 0 else tab.mirror((0.0, 1.0, 0.0))
        body += tab.translate((0.0, float(y) + (2 if y < 0 else -2), -13.0))
        body -= bore(3.2, (x, y - (1 if y < 0 else -1) * 1.0, -10), "z", 16, 32)
    body -= bore(5.5, (10, 4, 10), "z", 60) + bore(4, (34, -6, 0), "x", 14, 32)
    return body


def lever_arm() -> Manifold:
    """Group 4: a cast lever: two hubs of unequal height, waisted curved arm with a spine rib and side ribs."""
    s = np.linspace(0, 1, 25)
    upper = np.stack([-30 + 62 * s, 11 - 7.5 * np.sin(np.pi * s) + 2 * (1 - s)], 1)
    lower = np.stack([-30 + 62 * s, -11 + 4.0 * np.sin(np.pi * s) - 2 * (1 - s)], 1)
    arm = fillet_inner(CrossSection([np.vstack([lower, upper[::-1]])]), 2)
    body = arm.extrude(9).translate((0, 0, -10))
    bow = np.stack([-28 + 58 * s, 3 + 9 * np.sin(np.pi * s) ** 2], 1)
    spine = CrossSection([np.vstack([[(-28, -6), (30, -6)], bow[::-1]])])
    body += spine.extrude(6).transform(np.array([[1, 0, 0, 0], [0, 0, 1, -4.5], [0, 1, 0, 0]], float))
    body += rod(17, 30, (-30, 0, -14), "z", 1.5) + rod(12, 20, (34, 0, -12), "z", 1.2)
    body += rod(5.5, 14, (2, 1, -10), "z", 0.8) + rod(6, 12, (-30, -24, 4), "y")
    body -= bore(10, (-30, 0, 0)) + bore(6, (34, 0, 0)) + bore(2.6, (2, 1, 0), "z", 60, 32)
    body -= block((-32.5, 0, -40), (-27.5, 12.5, 40)) + bore(3, (-30, -25, 4), "y", 30, 32)
    return body - block((36, -2, -40), (70, 1.5, 40))


PARTS: dict[str, tuple[int, Callable[[], Manifold]]] = {
    "slot_block": (1, slot_block),
    "l_bracket": (2, l_bracket),
    "u_clevis": (2, u_clevis),
    "flange_hub": (3, flange_hub),
    "valve_body": (3, valve_body),
    "finned_cover": (4, finned_cover),
    "lever_arm": (4, lever_arm),
    "v_block": (1, v_block),
    **MACHINED,
    **FORMED,
    **TOOTHED,
}
"""Group and builder by name, in the order of `plan.PART_NAMES`."""


def make_part(name: str) -> CadPart:
    """Build one part by name, centred on its bounding box. Raises KeyError for an unknown name."""
    group, build = PARTS[name]
    vertices, faces = mesh_arrays(build())
    vertices -= (vertices.min(0) + vertices.max(0)) / 2
    symmetries = {**SYMMETRIES, **FORMED_SYMMETRIES}.get(name, {})
    return CadPart(name, group, vertices.astype(np.float32).astype(np.float64), faces, symmetries)
