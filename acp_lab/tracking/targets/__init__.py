"""What generated edges are compared with in a frame: a distance map, or image edges along their normals.

A target's configuration *sees* a frame once; the target *binds* the edges of a level; the measure that comes of it
hands the solver residuals, directions and weights, at every step anew. A new cue is one more target.
"""

from __future__ import annotations

from typing import Protocol

from acp_lab.errors import TrackingError
from acp_lab.generator.base import GeneratedEdges
from acp_lab.geometry.arrays import FloatArray
from acp_lab.tracking.frame_view import Estimate
from acp_lab.tracking.learning.knowledge import Matches
from acp_lab.tracking.result import TargetView
from acp_lab.tracking.schedule import Level
from acp_lab.tracking.solvers import Measurement


class Target(Protocol):
    """One frame, prepared to be compared with."""

    def bind(self, edges: GeneratedEdges, at: Estimate, level: Level) -> Measure:
        """The measure of a level whose edges were generated at an estimate."""
        ...

    def agreement(self, edges: GeneratedEdges, at: Estimate, level: Level, sigma_px: float) -> float:
        """Up to 1: how well the frame agrees with an estimate's edges, whatever was learnt of how they look.

        sigma_px: how near an image edge must lie.
        """
        ...


class Measure(Protocol):
    """How edge points of one level are compared with the frame."""

    def __call__(self, edges: GeneratedEdges) -> Measurement:
        """Residuals, directions and weights of the level's edges where they are now."""
        ...

    def reported_loss(self, edges: GeneratedEdges) -> float:
        """e at a step, in the units of `Judgement.loss`."""
        ...

    def judge(self, moved: GeneratedEdges, drawn: GeneratedEdges, at: Estimate) -> Judgement:
        """What the frame says of a later estimate.

        moved: the level's edges where its motion put them; drawn: the estimate's own.
        """
        ...


class Judgement(Protocol):
    """How well a frame agrees with an estimate.

    Attributes:
        edges: n edge points that were judged.
        residuals_px: (n,) signed px along the normals to the image edge of each, NaN where none was found.
        quality: in [0, 1].
        score: what poses of one frame are compared by.
        loss: e as `TrackResult.loss` reports it.
        matches: which image edges were chosen, for those who learn from them; None where there is no choice.
        target_view: what was found in the image, for those who look inside.
    """

    @property
    def edges(self) -> GeneratedEdges: ...
    @property
    def residuals_px(self) -> FloatArray: ...
    @property
    def quality(self) -> float: ...
    @property
    def score(self) -> float: ...
    @property
    def loss(self) -> float: ...
    @property
    def matches(self) -> Matches | None: ...
    @property
    def target_view(self) -> TargetView: ...

    def learn(self, trusted: bool) -> None:
        """Take in what the target keeps of a solved frame; trusted: its pose was given and is exact."""
        ...


QUALITY_SIGMA_PX = 1.5
"""How near an image edge must lie to count as found."""


def check_precision(precision: float) -> None:
    """TrackingError for a precision that is not above 0."""
    if not 0.0 < precision < float("inf"):
        raise TrackingError(f"targets.precision = {precision:g}: give a number above 0")
