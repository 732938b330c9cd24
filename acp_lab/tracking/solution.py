"""What one frame offers, and what solving it gave."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from acp_lab.geometry.arrays import FloatArray
from acp_lab.tracking.explained_edges import ImageEdges
from acp_lab.tracking.frame_view import Estimate, FrameView
from acp_lab.tracking.result import TrackStep
from acp_lab.tracking.targets import Judgement, Target


@dataclass(frozen=True, eq=False)
class SeenFrame:
    """What one frame offers: a view, and its image prepared for each target of the method."""

    view: FrameView
    targets: tuple[Target, ...]

    @cached_property
    def image_edges(self) -> ImageEdges:
        """What the image has of edges, whatever the part."""
        return ImageEdges(self.view.image, self.view.box)


@dataclass(frozen=True, eq=False)
class Solution:
    """An estimate with what the frame says of it.

    Attributes:
        estimate: control points and pose.
        judgements: by each of the method's targets, of the edges of the last level where the estimate has them.
        loss: e, see `TrackResult.loss`.
        information: (8, 8) by the image alone, the inverse covariance of a pose step (rad, mm) about the part's centre
            and of two edge breaks (mm), see `edge_breaks`; None where the method's prediction does not ask for it, or
            the estimate was only looked at. Edge points of no known sample say nothing of breaks.
        iterations: of the solver, on all levels; steps: each of them, when they are recorded.
    """

    estimate: Estimate
    judgements: tuple[Judgement, ...]
    loss: float
    information: FloatArray | None
    iterations: int = 0
    steps: tuple[TrackStep, ...] = ()

    @property
    def judgement(self) -> Judgement:
        """By the first target, whose quality and residuals are reported."""
        return self.judgements[0]

    @cached_property
    def score(self) -> float:
        """What solutions of one frame are compared by: the sum of the targets' scores."""
        return sum(judgement.score for judgement in self.judgements)

    @property
    def cam_T_obj(self) -> FloatArray:
        """(4, 4) mm."""
        return self.estimate.cam_T_obj

    @property
    def pose_information(self) -> FloatArray | None:
        """(6, 6) of the pose step alone, as if the edge breaks were known."""
        return None if self.information is None else self.information[:6, :6].copy()

    @property
    def quality(self) -> float:
        """In [0, 1]: how well the frame agrees."""
        return min(max(self.judgement.quality, 0.0), 1.0)
