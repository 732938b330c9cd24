"""The error of a pose that a display may show beside it, where truth is known; never seen by a tracker.

In percent of the diameter by the part's own metric, on at most 1000 vertices: a curve needs no more than that,
`acp-lab eval` uses them all.
"""

from __future__ import annotations

from acp_lab.cad.part import Part
from acp_lab.evaluation import PartMetric
from acp_lab.geometry.arrays import FloatArray

_MOST_VERTICES = 1000


class AddPercent:
    """ADD, or ADD-S with symmetries, of poses of one part in percent of its diameter.

    metric: the name of the one that counts.
    """

    def __init__(self, part: Part) -> None:
        # A fixed choice of vertices: the same run shows the same curve.
        self._metric = PartMetric(part, _MOST_VERTICES)
        self.metric = self._metric.name

    def __call__(self, cam_T_obj: FloatArray, cam_T_true: FloatArray | None) -> float:
        """Percent of the diameter for two poses (4, 4), mm; NaN without truth."""
        return self._metric.percent(cam_T_obj, cam_T_true)
