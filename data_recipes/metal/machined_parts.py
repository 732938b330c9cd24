"""Twelve more tracked parts, of the same four groups as those of `cad_parts`; two of them have a symmetry about z.

Convention: as in `cad_parts`. Sizes 60 to 160 mm, so that small and large parts are among them. Round things of the
symmetric parts are cut into 72 segments: a number that six divides, so that the mesh has the symmetry exactly.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from manifold3d import CrossSection, Manifold
from scipy.spatial.transform import Rotation

from data_recipes.metal.solids import block, bore, countersink, gusset, prism, profile, rod, slot

_ROUND = 72


def keyed_shaft() -> Manifold:
    """Group 3: a stepped shaft with a keyway, a milled flat, a groove, a collar and a cross hole."""
    body = rod(13, 40, (-70, 0, 0), "x") + rod(17, 38, (-30, 0, 0), "x") + rod(24, 8, (8, 0, 0), "x")
    body += rod(14, 34, (16, 0, 0), "x") + rod(10, 22, (50, 0, 0), "x", 1.5)
    body -= slot(20, 7, (-50, 0, 13), "x", "z", 10) + block((22, -20, 9.5), (42, 20, 30))
    body -= bore(2.6, (60, 0, 0), "y", 60, 32) + (rod(20, 4, (-34, 0, 0), "x") - rod(11, 4, (-34, 0, 0), "x"))
    return body - block((7, -30, -30), (17, -19, 30))


def t_slot_plate() -> Manifold:
    """Group 1: a clamping plate with two parallel T slots of unequal width, a step, facets and fixing holes."""
    body = block((-56, -36, -12), (56, 36, 12))
    for y, neck, foot in ((-16, 5, 9.5), (13, 4, 7)):
        body -= block((-70, y - neck, 0), (70, y + neck, 20)) + block((-70, y - foot, -6), (70, y + foot, 0.5))
    body -= block((34, -50, 5), (70, -26, 20)) + prism(profile([(57, 37), (35, 37), (57, 19)]), 60, (0, 0, -30))
    body -= prism(profile([(-37, 5), (-37, 13), (-28, 13)]), 140, (-70, 0, 0), "x")
    for x in (-46, -22):
        body -= bore(3.2, (x, 29, 0)) + countersink(6, 6, (x, 29, 12))
    return body - bore(4.5, (46, -31, 0))


def cover_plate() -> Manifold:
    """Group 2: a plate of 4 mm with a window, a slot, a notch, a cut corner and holes of three sizes."""
    outline = profile([(-62, -40), (62, -40), (62, 18), (40, 40), (-62, 40)], 5)
    body = prism(outline, 4)
    body -= prism(profile([(-44, -24), (-6, -24), (-6, 12), (-30, 22), (-44, 22)], 4), 20, (0, 0, -5))
    body -= slot(24, 9, (28, -22, 0), "x", "z") + bore(13, (26, 12, 0)) + block((-20, 32, -5), (2, 50, 20))
    for x, y, r in ((-54, -32, 3), (54, -32, 3), (-54, 32, 3), (34, 32, 3), (53, 6, 4.5), (4, -33, 2.5)):
        body -= bore(r, (x, y, 0), segments=32)
    return body


def flange_nut() -> Manifold:
    """Group 3: a hexagon nut on a wide flange with six holes; it looks the same every 60 degrees about z."""
    body = rod(34, 8, (0, 0, -16), "z", 2, segments=_ROUND) + rod(25, 30, (0, 0, -8), segments=6)
    body -= bore(14, (0, 0, 0), segments=_ROUND)
    body -= rod(14, 3, (0, 0, 19.5), radius_end=17, segments=_ROUND)
    for angle in np.deg2rad(30 + 60 * np.arange(6)):
        body -= bore(2.6, (28 * np.cos(angle), 28 * np.sin(angle), 0), segments=24)
    return body


def bearing_ring() -> Manifold:
    """Group 3: a turned ring with a shoulder, a groove and a chamfer; it looks the same after any turn about z."""
    section = [
        (30, -14), (52, -14), (54, -12), (54, -2), (47, -2), (47, 3), (44.5, 3), (44.5, 6), (47, 6), (47, 12),
        (45, 14), (36, 14), (36, -6), (30, -6),
    ]  # fmt: skip
    return CrossSection([np.array(section, float)]).revolve(_ROUND)


def pillow_block() -> Manifold:
    """Group 4: a bearing housing: arched body with a stepped bore on a slotted foot, an oil boss and two ribs."""
    body = prism(profile([(-62, -19), (62, -19), (62, 19), (-62, 19)], 8), 11, (0, 0, -30))
    body += Manifold.batch_hull([rod(31, 34, (0, -17, 4), "y"), block((-34, -17, -20), (34, 17, -18))])
    body += rod(8, 14, (9, -3, 30), "z", 1.5) + rod(22, 5, (0, 16, 4), "y")
    body += gusset((28, 0, -19.5), (26, 25), 7, "y")
    body += gusset((-28, -6, -19.5), (17, -24), 7, "y")
    body -= bore(16, (0, 0, 4), "y", 80) + rod(21, 10, (0, -20, 4), "y") + bore(3, (9, -3, 40), "z", 40, 32)
    return body - slot(9, 8, (-51, 0, -25), "x", "z", 30) - bore(4.5, (51, 4, -25), "z", 30)


def corner_bracket() -> Manifold:
    """Group 2: three walls that meet at right angles, each with other holes, stiffened by two ribs."""
    body = block((-40, -32, -26), (40, 32, -18)) + block((-40, -32, -26), (-33, 32, 36))
    body += block((-40, 25, -26), (16, 32, 18)) + gusset((-33.5, -24, -18.5), (34, 40), 6, "y")
    body -= prism(profile([(41, -33), (41, -8), (18, -33)]), 30, (0, 0, -40))
    body -= prism(profile([(-33, 37), (-33, 14), (-8, 37)]), 30, (-50, 0, 0), "x")
    body -= bore(9, (-37, 8, 8), "x", 30) + bore(3, (-37, 22, 24), "x", 30, 32)
    body -= slot(22, 7, (6, 2, -22), "x", "z", 30) + bore(5, (30, 18, -22), "z", 30) + bore(3, (28, -8, -22), "z", 30)
    return body - bore(4, (-4, 28, 4), "y", 30) - bore(4, (8, 28, 4), "y", 30)


def port_block() -> Manifold:
    """Group 1: a hydraulic block with faceted edges and bores of several sizes on all sides, some stepped."""
    body = block((-30, -24, -22), (30, 24, 22))
    body -= prism(profile([(-31, -25), (-18, -25), (-31, -15)]), 80, (0, 0, -40))
    body -= prism(profile([(25, 23), (25, 12), (14, 23)]), 80, (-40, 0, 0), "x")
    body -= prism(profile([(-23, 31), (-12, 31), (-23, 22)]), 80, (0, -40, 0), "y")
    body -= rod(9, 20, (-14, 2, 8)) + rod(6, 20, (12, -8, 2)) + countersink(10, 10, (12, -8, 22))
    body -= rod(7, 40, (18, 4, -2), "x") + rod(10, 20, (25, 4, -2), "x") + bore(3, (20, 15, 0), "z", 80, 32)
    body -= bore(5.5, (-8, 0, -12), "y", 80) + rod(8.5, 20, (-8, 18, -12), "y") + rod(4, 20, (-40, -5, 4), "x")
    return body - block((8, -40, -30), (40, -17, -13))


def cam_disc() -> Manifold:
    """Group 4: a disc cam with a raised hub, a keyway, a curved track and a lightening hole."""
    t = np.linspace(0.0, 2.0 * np.pi, 96, endpoint=False)
    r = 36 + 12 * np.exp(-((np.mod(t - 0.6 + np.pi, 2 * np.pi) - np.pi) ** 2) / 0.35)
    body = prism(CrossSection([np.stack([r * np.cos(t), r * np.sin(t)], 1)]), 11, (0, 0, -12))
    body += rod(17, 26, (0, 0, -12), "z", 1.5)
    body -= bore(9, (0, 0, 0)) + block((-2.5, 0, -30), (2.5, 12, 30)) + bore(6, (-24, 6, 0))
    track = CrossSection.circle(30, 64) - CrossSection.circle(24, 64)
    body -= prism(track, 10, (0, 0, -5)) ^ block((0, -40, -10), (40, 14, 10))
    return body - bore(3.2, (33, 24, 0), segments=32) - bore(4, (-10, -27, 0))


def fork_end() -> Manifold:
    """Group 3: a fork on a round shank: two cheeks with a cross bore, one of them cut back, a flat and a pin hole."""
    body = block((-6, -23, -20), (46, 23, 20)) ^ (rod(27, 60, (20, 0, -30)) + block((-10, -40, -40), (20, 40, 40)))
    body = body + rod(14, 62, (-64, 0, 0), "x") + rod(19, 7, (-13, 0, 0), "x")
    body += rod(12, 5, (24, 22, 0), "y")
    body -= block((6, -10, -40), (60, 11, 40)) + bore(8, (24, 0, 0), "y", 100) + block((34, -40, -40), (60, -5, 40))
    body -= bore(2.8, (-52, 0, 0), "y", 60, 32) + block((-70, -20, 9.5), (-38, 20, 30))
    return body - prism(profile([(-7, 10), (-7, 24), (8, 24)]), 80, (0, 0, -40))


def heat_sink() -> Manifold:
    """Group 1: a base with eight equal fins, some cut short, a pocket below and two ears."""
    body = block((-45, -34, -14), (45, 34, -7))
    body += block((-57, -12, -14), (-40, 8, -9)) + block((40, -2, -14), (55, 20, -9))
    for k in range(8):
        x = -42 + 11.5 * k
        body += block((x, -34, -8), (x + 3.5, 34 if k < 5 else 12, 16))
    body -= block((-50, -40, 6), (-26, 40, 30)) + bore(2.6, (-51, -2, 0)) + bore(2.6, (49, 9, 0))
    return body - block((-16, -20, -20), (24, 16, -11))


def tee_fitting() -> Manifold:
    """Group 4: a pipe tee: a run with a flat flange, a hexagon end and a slanting branch, bored through."""
    branch = rod(13, 46).rotate((-62, 0, 0)) + rod(17, 8, (0, 0, 40)).rotate((-62, 0, 0))
    body = rod(17, 92, (-44, 0, 0), "x") + rod(22, 14, (34, 0, 0), "x", segments=6) + branch
    plate = profile([(-24, -22), (24, -22), (24, 16), (14, 26), (-24, 26)], 5)
    body += prism(plate, 8, (-52, 0, 0), "x") + rod(6, 10, (12, 0, -20), "z")
    body -= bore(11, (0, 0, 0), "x", 200) + Manifold.cylinder(80, 8, 8, 48).rotate((-62, 0, 0))
    for y, z in ((-17, -15), (17, -15), (-17, 19)):
        body -= bore(3, (-48, y, z), "x", 20, 32)
    return body - bore(2.4, (12, 0, -20), "z", 20, 24)


MACHINED: dict[str, tuple[int, Callable[[], Manifold]]] = {
    "keyed_shaft": (3, keyed_shaft),
    "t_slot_plate": (1, t_slot_plate),
    "cover_plate": (2, cover_plate),
    "flange_nut": (3, flange_nut),
    "bearing_ring": (3, bearing_ring),
    "pillow_block": (4, pillow_block),
    "corner_bracket": (2, corner_bracket),
    "port_block": (1, port_block),
    "cam_disc": (4, cam_disc),
    "fork_end": (3, fork_end),
    "heat_sink": (1, heat_sink),
    "tee_fitting": (4, tee_fitting),
}
"""Group and builder by name."""


def turn_about_z(degrees: float) -> list[float]:
    """The 16 numbers, row by row, of a turn about the object's z axis, as models_info.json has them."""
    turn = np.eye(4)
    turn[:3, :3] = Rotation.from_euler("z", degrees, degrees=True).as_matrix()
    return [float(value) for value in turn.ravel()]


SYMMETRIES: dict[str, dict[str, object]] = {
    "flange_nut": {"symmetries_discrete": [turn_about_z(60 * k) for k in range(1, 6)]},
    "bearing_ring": {"symmetries_continuous": [{"axis": [0.0, 0.0, 1.0], "offset": [0.0, 0.0, 0.0]}]},
}
"""What models_info.json says of the parts that have symmetries."""
