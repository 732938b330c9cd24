"""Four control points over a picture, to be dragged: the quad, its order, and what is wrong with it.

Convention: px of the full image, (x, y), in the order of W's rows; on the screen they are counted from 1.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

import numpy as np
import traitlets
from numpy.typing import ArrayLike

from acp_lab.display.widgets.overlay import Overlay
from acp_lab.display.widgets.point_canvas import PointCanvas
from acp_lab.display.widgets.still import Still
from acp_lab.errors import GeometryError
from acp_lab.geometry.arrays import ByteImage, FloatArray
from acp_lab.geometry.homography import check_quad

SMALLEST_HEIGHT_PX = 3.0
"""A corner nearer than this to the line through two others says nothing about a pose."""


class ControlPointEditor(Still, PointCanvas):
    """A picture with four control points as handles; traits as in `PointCanvas`.

    points: (4, 2) px. Drag them with mouse or finger, or choose one and use the arrow keys (1 px, with Shift
    10 px); the area between them moves all four. Wheel and buttons zoom, the ground pans.
    problem: why the quad is no quad, in one line; "" for a good one.
    """

    still = "widget_editor.png"

    def __init__(
        self, image: ByteImage | None, points: ArrayLike, overlays: Iterable[Overlay] = (), **traits: Any
    ) -> None:
        """image: (h, w[, 3]) uint8 or None; points: (4, 2) px; TraitError for another shape."""
        super().__init__(image, points, overlays=tuple(overlays), **{"closed": True, "editable": True, **traits})

    @property
    def is_good(self) -> bool:
        """Whether the points are a convex quad in order around it."""
        return self.problem == ""

    @traitlets.validate("points")
    def _four(self, proposal: dict[str, Any]) -> FloatArray:
        points: FloatArray = proposal["value"]
        if points.shape != (4, 2):
            raise traitlets.TraitError(f"control points of shape {points.shape}: give four rows of (x, y)")
        return points

    @traitlets.observe("points")
    def _judge(self, _: object = None) -> None:
        self.problem = quad_problem(self.points)


def quad_problem(points: FloatArray, minimum_px: float = SMALLEST_HEIGHT_PX) -> str:
    """What is wrong with four points (4, 2) as a quad, in one line; "" when nothing is.

    The words of `check_quad`, with the points counted from 1, as the handles are.
    """
    try:
        check_quad(np.asarray(points), minimum_px, "the quad")
    except GeometryError as error:
        return re.sub(
            r"(?<=points )\d(?:, \d)*", lambda m: re.sub(r"\d", lambda d: str(int(d[0]) + 1), m[0]), str(error)
        )
    return ""
