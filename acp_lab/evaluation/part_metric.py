"""Which distance between poses counts for a part: ADD, or ADD-S where models_info.json lists symmetries.

Scores, explanations and displays all ask here, so that they never measure one part in two ways. (Studies of what poses
the images allow, such as `studies.pose_bound`, ask for ADD of the pose as it is.)
"""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial import cKDTree

from acp_lab.cad.part import Part
from acp_lab.evaluation.metrics import add_mm, adds_mm
from acp_lab.geometry.arrays import FloatArray


def metric_name(part: Part) -> str:
    """"ADD-S" for a part with symmetries, else "ADD"."""
    return "ADD-S" if part.symmetries else "ADD"


class PartMetric:
    """The distance of an estimated pose of a part from its true pose.

    name: "ADD" or "ADD-S".
    """

    def __init__(self, part: Part, most_vertices: int | None = None) -> None:
        """most_vertices: measure at every k-th vertex, so that there are at most that many; at all by default.

        The nearest point of ADD-S is sought among all vertices either way.
        """
        step = 1 if most_vertices is None else max(1, -(-len(part.vertices) // most_vertices))
        self.name = metric_name(part)
        self._points_obj = np.ascontiguousarray(part.vertices[::step])
        # Were these thinned, too, a turned part would be off by the gaps between its vertices.
        self._tree = cKDTree(part.vertices) if part.symmetries else None
        self._diameter = part.diameter

    def mm(self, cam_T_est: FloatArray, cam_T_true: FloatArray) -> float:
        """The distance of two poses (4, 4), mm; infinite for an estimate that is not finite."""
        if not np.isfinite(cam_T_est).all():
            return math.inf
        if self._tree is None:
            return add_mm(self._points_obj, cam_T_est, cam_T_true)
        return adds_mm(self._points_obj, cam_T_est, cam_T_true, self._tree)

    def share(self, cam_T_est: FloatArray, cam_T_true: FloatArray) -> float:
        """The same as a share of the part's diameter: 0.02 is the usual strict limit."""
        return self.mm(cam_T_est, cam_T_true) / self._diameter

    def percent(self, cam_T_est: FloatArray, cam_T_true: FloatArray | None) -> float:
        """The same in percent of the diameter; NaN where the truth is unknown (None)."""
        return math.nan if cam_T_true is None else 100.0 * self.share(cam_T_est, cam_T_true)
