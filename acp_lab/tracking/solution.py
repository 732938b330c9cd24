"""What one frame offers, and what solving it gave."""

from __future__ import annotations

from dataclasses import dataclass

from acp_lab.geometry.arrays import FloatArray
from acp_lab.tracking.frame_view import Estimate, FrameView
from acp_lab.tracking.result import TrackStep
from acp_lab.tracking.targets import Judgement, Target


@dataclass(frozen=True, eq=False)
class SeenFrame:
    """What one frame offers: a view, and its image prepared for each target of the method."""

    view: FrameView
    targets: tuple[Target, ...]


@dataclass(frozen=True, eq=False)
class Solution:
    """An estimate with what the frame says of it.

    Attributes:
        estimate: control points and pose.
        judgement: by the method's first target, of the edges of the last level where the estimate has them.
        loss: e, see `TrackResult.loss`.
        iterations: of the solver, on all levels; steps: each of them, when they are recorded.
    """

    estimate: Estimate
    judgement: Judgement
    loss: float
    iterations: int = 0
    steps: tuple[TrackStep, ...] = ()

    @property
    def cam_T_obj(self) -> FloatArray:
        """(4, 4) mm."""
        return self.estimate.cam_T_obj

    @property
    def quality(self) -> float:
        """In [0, 1]: how well the frame agrees."""
        return min(max(self.judgement.quality, 0.0), 1.0)
