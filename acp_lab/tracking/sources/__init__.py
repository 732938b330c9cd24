"""Sources of generated edges inside one frame: t(I) of a rigid generator, or read off a painted edge image.

A source takes an estimate and hands over edge points. It knows nothing of images, losses or solvers.
"""

from __future__ import annotations

from typing import Protocol

from acp_lab.generator.base import GeneratedEdges
from acp_lab.geometry.arrays import FloatArray
from acp_lab.tracking.frame_view import Estimate


class EdgeSource(Protocol):
    """t(I) in one frame.

    Attributes:
        name: of the generator in use.
        regions: the view regions 0..5 that it was prepared for.
        knows_samples: whether its edge points are 3D edge samples of the CAD model.
        is_exact: whether they lie just where these project to.
        canonical_size: px, side of the canonical image.
    """

    name: str
    regions: tuple[int, ...]
    knows_samples: bool
    is_exact: bool
    canonical_size: int

    def generate(self, at: Estimate, count: int) -> GeneratedEdges:
        """At most `count` edge points of an estimate; GeometryError where its control points are degenerate."""
        ...

    def reproject(self, at: Estimate, edges: GeneratedEdges) -> GeneratedEdges:
        """The edges of an estimate, given those of one nearby.

        Sources that know which samples these show only move them: which ones show changes more slowly.
        """
        ...

    def flow(self, at: Estimate, edges: GeneratedEdges, by_differences: bool) -> FloatArray:
        """(n, 2, 8) how the edge points that `generate` gave move by I, when edges are generated anew."""
        ...
