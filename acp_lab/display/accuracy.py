"""The error of a pose that a display may show beside it, where truth is known; never seen by a tracker.

ADD, or ADD-S for a part with symmetries, in percent of the diameter, on at most 1000 vertices: a curve needs
no more than that, `acp-lab eval` uses them all.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial import cKDTree

from acp_lab.cad.part import Part
from acp_lab.evaluation import add_mm, adds_mm
from acp_lab.geometry.arrays import FloatArray

_MOST_VERTICES = 1000


class AddPercent:
    """ADD(-S) of poses of one part in percent of its diameter."""

    def __init__(self, part: Part) -> None:
        # Every k-th vertex, a fixed choice: the same run shows the same curve.
        step = max(1, -(-len(part.vertices) // _MOST_VERTICES))
        self._points_obj = np.ascontiguousarray(part.vertices[::step])
        self._tree = cKDTree(self._points_obj) if part.symmetries else None
        self._diameter = part.diameter

    def __call__(self, cam_T_obj: FloatArray, cam_T_true: FloatArray | None) -> float:
        """Percent of the diameter for two poses (4, 4), mm; NaN without truth."""
        if cam_T_true is None:
            return math.nan
        if self._tree is None:
            distance_mm = add_mm(self._points_obj, cam_T_obj, cam_T_true)
        else:
            distance_mm = adds_mm(self._points_obj, cam_T_obj, cam_T_true, self._tree)
        return 100.0 * distance_mm / self._diameter
