"""What is said of a solved frame: how likely the part is there, and how exact its pose is then."""

from __future__ import annotations

from acp_lab.cad.part import Part
from acp_lab.geometry.arrays import FloatArray
from acp_lab.tracking.learning.knowledge import Off
from acp_lab.tracking.method import Method
from acp_lab.tracking.solution import Solution
from acp_lab.tracking.uncertainty import ExpectedError

LEAST_EXACT = 0.5
"""Exactness below which nothing fixes a pose."""


class Assessment:
    """Of one part's solutions, by its method's `confidence` and `uncertainty`."""

    def __init__(self, part: Part, method: Method) -> None:
        self._part, self._confidence, self._uncertainty = part, method.confidence, method.uncertainty
        self._expected_error = ExpectedError(part)

    def quality(self, solution: Solution) -> float:
        """In [0, 1]: the probability that the part is there; without `confidence` how well the edges fit."""
        return solution.quality if isinstance(self._confidence, Off) else self._confidence.of(solution)

    def covariance(self, solution: Solution) -> FloatArray | None:
        """(6, 6) of a pose step (rad, mm) about the part's centre; None without `uncertainty`."""
        if isinstance(self._uncertainty, Off) or solution.information is None:
            return None
        estimate = solution.estimate
        mm_per_px = float(estimate.centre_cam[2]) / estimate.view.camera.fx
        return self._uncertainty.covariance(solution.information, mm_per_px)

    def exactness(self, cam_T_obj: FloatArray, covariance: FloatArray | None) -> float:
        """In [0, 1]: the probability that a pose (4, 4) of a part that is there is right, see `confidence`.

        1 without a covariance (6, 6): then nobody knows.
        """
        if covariance is None or isinstance(self._confidence, Off):
            return 1.0
        return self._confidence.exactness(self.expected_error(cam_T_obj, covariance))

    def expected_error(self, cam_T_obj: FloatArray, covariance: FloatArray) -> float:
        """Root mean square ADD of a pose (4, 4) with a covariance (6, 6), as a share of the diameter."""
        return self._expected_error.rms_mm(covariance, cam_T_obj) / self._part.diameter

    def right(self, solution: Solution) -> float:
        """In [0, 1]: the probability that its pose is right."""
        return self.quality(solution) * self._exactness_of(solution)

    def is_exact(self, solution: Solution) -> bool:
        """Whether what is seen fixes its pose."""
        return self._exactness_of(solution) >= LEAST_EXACT

    def _exactness_of(self, solution: Solution) -> float:
        return self.exactness(solution.cam_T_obj, self.covariance(solution))
