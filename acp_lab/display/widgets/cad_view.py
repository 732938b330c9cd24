"""A picture of the CAD model alone, turned by the hand, with the object's axes, whose corners can be pointed at."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import traitlets

from acp_lab.cad.corners import corner_points, visible_points
from acp_lab.cad.part import Part
from acp_lab.cad.ray_shading import FINE, ray_shade
from acp_lab.cad.raycast import make_caster
from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.display.colours import GREY, lighter
from acp_lab.display.widgets.controls import Turn
from acp_lab.display.widgets.overlay import Overlay
from acp_lab.display.widgets.point_canvas import PointCanvas
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import make_pose, so3_exp, transform

SIZE_PX = 360
DISTANCE_IN_RADII = 5.0
FILL = 0.44
REACH_PX = 16.0
"""A click this near to a corner means it."""
_AXIS_PX, _LETTER_PX = 30.0, 4.0
_AXES_AT = np.array([48.0, SIZE_PX - 48.0])
_LETTERS = (
    [[[-1, -1], [1, 1]], [[-1, 1], [1, -1]]],
    [[[-1, -1], [0, 0]], [[1, -1], [0, 0]], [[0, 0], [0, 1]]],
    [[[-1, -1], [1, -1]], [[1, -1], [-1, 1]], [[-1, 1], [1, 1]]],
)
"""Strokes of x, y and z, px / _LETTER_PX."""


class CadView(PointCanvas):
    """The part from a distance of five radii, in the middle of a square picture; traits as in `PointCanvas`.

    pose: (4, 4) cam_T_obj of the view, camera: its pinhole camera. corners_obj: (n, 3) mm, what can be picked.
    on_orbit: called with a turn (deg, camera axes) when the hand drags the ground; by default this view turns.
    """

    def __init__(self, part: Part, rotation: FloatArray, **traits: Any) -> None:
        """rotation: (3, 3), object to camera axes."""
        self.part = part
        self.corners_obj = corner_points(part)
        self._caster = make_caster(part)
        focal = FILL * SIZE_PX * np.sqrt(DISTANCE_IN_RADII**2 - 1.0)
        middle = 0.5 * (SIZE_PX - 1)
        self.camera = Camera(SIZE_PX, SIZE_PX, float(focal), float(focal), middle, middle)
        self.on_orbit: Callable[[Turn], object] = self.turn
        self._drawn: tuple[Overlay, ...] = ()
        super().__init__(None, **{"height_px": 340, "orbits": True, **traits})
        self.look(rotation)

    def look(self, rotation: FloatArray) -> None:
        """Turn the view; rotation (3, 3), object to camera axes."""
        distance = np.array([0.0, 0.0, DISTANCE_IN_RADII * self.part.radius])
        self.pose = make_pose(rotation, distance - rotation @ self.part.box_centre)
        with self.hold_sync():
            self.draw(self._drawn)
            # A hand that drags wants to see it move, a quarter of the rays do for that.
            self.show(ray_shade(self.part, self._caster, self.camera, self.pose, fine=1 if self.dragging else FINE))

    def draw(self, overlays: Iterable[Overlay]) -> None:
        """Replace the overlays; the object's axes are always drawn, below them."""
        self._drawn = tuple(overlays)
        super().draw((*axes_drawing(self.pose[:3, :3]), *self._drawn))

    def turn(self, turn_deg: Turn) -> None:
        """Turn the view about the camera's axes."""
        self.look(so3_exp(np.radians(turn_deg)) @ self.pose[:3, :3])

    def project(self, points_obj: FloatArray) -> FloatArray:
        """Pixels (n, 2) of object points (n, 3)."""
        return self.camera.project(transform(self.pose, points_obj))

    def seen_corners(self) -> np.ndarray:
        """Rows of `corners_obj` that this view shows."""
        slack_mm = 0.005 * self.part.diameter
        return np.flatnonzero(visible_points(self._caster, self.corners_obj, eye_position(self.pose), slack_mm))

    def corner_at(self, pixel: FloatArray) -> int | None:
        """The row of the corner shown nearest to a pixel (2,); None when none is near."""
        rows = self.seen_corners()
        if len(rows) == 0:
            return None
        distance = np.linalg.norm(self.project(self.corners_obj[rows]) - pixel, axis=1)
        return int(rows[distance.argmin()]) if distance.min() <= REACH_PX else None

    @traitlets.observe("orbit")
    def _orbit(self, change: Any) -> None:
        """The side that faces the hand goes with it: a radius of the part is one radian."""
        right, down = np.subtract(change.new, change.old) / (FILL * SIZE_PX)
        self.on_orbit((float(np.degrees(down)), float(-np.degrees(right)), 0.0))

    @traitlets.observe("dragging")
    def _finish(self, _: object) -> None:
        if not self.dragging:
            self.look(self.pose[:3, :3])


def axes_drawing(rotation: FloatArray) -> tuple[Overlay, ...]:
    """The object's axes in the lower left of a `CadView`, each with its letter; rotation (3, 3), object to camera.

    An axis that points away from the eye is thin.
    """
    strokes: dict[bool, list[FloatArray]] = {True: [], False: []}
    letters = []
    for axis, letter in zip(rotation.T, _LETTERS, strict=True):
        tip = _AXES_AT + _AXIS_PX * axis[:2]
        strokes[bool(axis[2] > 0.0)].append(np.stack([_AXES_AT, tip]))
        beyond = axis[:2] / max(float(np.linalg.norm(axis[:2])), 0.25)
        letters.append(tip + 3.0 * _LETTER_PX * beyond + _LETTER_PX * np.array(letter, np.float64))
    light = lighter(GREY, 0.7)
    shade = (light[0], light[1], light[2])
    drawn = [
        Overlay("strokes", np.array(rows), shade, "object axes", 1.2 if is_far else 3.0)
        for is_far, rows in strokes.items()
        if rows
    ]
    return (*drawn, Overlay("strokes", np.concatenate(letters), shade, "object axes", 1.8))
