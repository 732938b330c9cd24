"""What a sequence can show: the names of parts and kinds, and the frozen plan of one sequence.

Nothing here needs the solid modeller, so that `--help` works without the `recipes` extra.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from acp_lab.geometry.camera import Camera
from data_recipes.metal.surfaces import Finish
from data_recipes.metal.table import TableKind

PART_NAMES = (
    "slot_block", "l_bracket", "u_clevis", "flange_hub", "valve_body", "finned_cover", "lever_arm", "v_block",
    "keyed_shaft", "t_slot_plate", "cover_plate", "flange_nut", "bearing_ring", "pillow_block",
    "corner_bracket", "port_block", "cam_disc", "fork_end", "heat_sink", "tee_fitting",
    "connecting_rod", "spur_gear", "bent_pipe", "bent_bracket", "hexagon_bolt", "turbine_blade", "sieve_plate",
    "torsion_spring", "forged_lever", "pump_housing", "helical_pinion", "crane_hook", "knurled_knob", "spanner",
    "impeller", "door_handle", "chain_sprocket", "splined_shaft", "ratchet_wheel", "bolted_flange", "timing_pulley",
    "slotted_nut", "brake_disc", "milling_cutter",
)  # fmt: skip
FIRST_PARTS = PART_NAMES[:7]
"""The default parts, and those that serve as clutter. Later parts stay out of it: another one would change what every
seed has shown so far."""
Kind = Literal["regular", "reflection", "rotation", "occlusion", "fast"]
KINDS: tuple[Kind, ...] = ("regular", "reflection", "rotation", "occlusion", "fast")
SPP = 64
"""Samples per pixel of the path tracer, unless chosen otherwise."""


@dataclass(frozen=True)
class SceneConfig:
    """What one sequence shows. rot_deg and trans_mm are means per frame; None takes the kind's own.

    shake_deg: by how much the hand that holds the camera turns it to and fro, root mean square; 0 for a stand.
    look_alikes: how many more parts like the tracked one lie around; then what passes in front is such, too.
    readout: share of the time between two frames in which a rolling shutter reads a picture row by row; 0 for a shutter
    that is open for all rows at once.
    """

    kind: Kind
    frames: int
    width: int
    height: int
    seed: int
    edge_break_mm: float = 0.0
    rot_deg: float | None = None
    trans_mm: float | None = None
    table: TableKind | None = None
    metal: str | None = None
    finish: Finish | None = None
    clutter: int | None = None
    look_alikes: int = 0
    shake_deg: float = 0.0
    readout: float = 0.0
    rest: int | None = None  # which stable pose the part lies in, 0 = the steadiest

    @property
    def camera(self) -> Camera:
        """Pinhole with f = 915 px at 640 px width, principal point near the middle."""
        rng = np.random.default_rng([self.seed, 1])
        f = 915.0 * self.width / 640.0 * (1 + 0.004 * rng.uniform(-1, 1))
        shift = rng.uniform(-4, 4, 2) * self.width / 640.0
        cx, cy = (self.width - 1) / 2 + shift[0], (self.height - 1) / 2 + shift[1]
        return Camera(self.width, self.height, round(f, 3), round(f, 3), round(cx, 3), round(cy, 3))


@dataclass(frozen=True)
class Plan:
    """One sequence of a data set: which part (by name) and what happens to it."""

    part: str
    config: SceneConfig
