"""From edge points to residuals: the distance map of the paper, or the search along normals, behind one call.

A `Measure` takes edge points and hands back what the frame says about them; solvers know nothing else of the frame.
"""

from __future__ import annotations

import numpy as np

from acp_lab.generator.base import GeneratedEdges
from acp_lab.tracking.learning.edge_memory import EdgeMemory
from acp_lab.tracking.loss import soft_assignment
from acp_lab.tracking.losses import LossForm, edge_loss, least_squares_weights
from acp_lab.tracking.solvers import Measurement
from acp_lab.tracking.targets.distance_map import DistanceTarget
from acp_lab.tracking.targets.image_edges import Candidates, ImagePatch, SearchConfig, search_along_normals

_OUTLIER = 0.5
_MIN_REACH_PX, _MAX_REACH_PX = 5, 20


class DistanceMeasure:
    """Distances to the nearest image edge, weighed by a loss (eq. 6 as the text means it)."""

    def __init__(self, target: DistanceTarget, form: LossForm, alpha_px: float) -> None:
        self._target = target
        self._form = form
        self._alpha_px = alpha_px

    def __call__(self, edges: GeneratedEdges) -> Measurement:
        """What the distance map says about edge points."""
        seen = self._target.distances(edges.points, edges.normals)
        loss = edge_loss(self._form, seen.values, self._alpha_px)
        weights = least_squares_weights(self._form, seen.values, self._alpha_px) * edges.weights
        # The distance grows along its gradient, so the image edge lies the other way.
        return Measurement(seen.values, -seen.gradients, weights, loss.values, edges.weights)


class SearchMeasure:
    """Image edges along the normals, softly assigned; sigma is half of alpha, as wide as Geman-McClure's core."""

    def __init__(
        self,
        patch: ImagePatch,
        alpha_px: float,
        search: SearchConfig,
        memory: EdgeMemory | None,
        trust: np.ndarray | None,
    ) -> None:
        self._patch = patch
        self._search = search
        self._sigma_px = max(0.5 * alpha_px, 1.0)
        self._reach_px = int(np.clip(round(1.6 * alpha_px), _MIN_REACH_PX, _MAX_REACH_PX))
        self._memory = memory
        self._trust = trust

    def candidates(self, edges: GeneratedEdges) -> tuple[Candidates, np.ndarray]:
        """Image edges along the normals of n edge points, and their scores (n, m) after the memory had its say."""
        found = search_along_normals(self._patch, edges.points, edges.normals, self._reach_px, self._search)
        scores = found.scores
        if self._memory is not None:
            scores = scores * self._memory.factors(edges.sample_ids, found)
        return found, scores * edges.weights[:, None]

    def __call__(self, edges: GeneratedEdges) -> Measurement:
        """What the image says about edge points."""
        found, scores = self.candidates(edges)
        assigned = soft_assignment(found.offsets, scores, self._sigma_px, _OUTLIER)
        weights = assigned.weights if self._trust is None else assigned.weights * self._trust[edges.sample_ids]
        mass = (scores * np.exp(-0.5 * (found.offsets / self._sigma_px) ** 2)).sum(1)
        losses = self._sigma_px**2 * (np.log1p(_OUTLIER) - np.log(np.minimum(mass, 1.0) + _OUTLIER))
        return Measurement(assigned.residuals, edges.normals, weights, losses, np.ones(len(edges)))
