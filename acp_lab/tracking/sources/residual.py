"""The residual homography: what edges do where I is no projection of W.

Eight free coordinates have two degrees of freedom more than a rigid part. A generator knows rigid views only, and
what it makes of any other I is a guess: a painting network bends or smears, a rigid one snaps back. So edges are
generated at the rigid neighbour of I, I_r = project(PnP(I)), and moved from there by the homography that takes I_r
to I. That is the very direction in which the paper moves edges within a step (III, IV-C); it is identity where I is
rigid. (Deviation from the paper, which generates t(I) at any I.)
"""

from __future__ import annotations

from dataclasses import replace

from acp_lab.generator.base import GeneratedEdges
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.homography import QuadWarp
from acp_lab.tracking.frame_view import Estimate
from acp_lab.tracking.sources import EdgeSource


class ResidualHomography:
    """Any source, asked at the rigid neighbour of I only."""

    is_exact = False

    def __init__(self, source: EdgeSource) -> None:
        self._source = source
        self.name = source.name
        self.regions = source.regions
        self.knows_samples = source.knows_samples
        self.canonical_size = source.canonical_size

    def generate(self, at: Estimate, count: int) -> GeneratedEdges:
        """The edges of the rigid neighbour, moved to I; GeometryError where I, or its neighbour, is degenerate."""
        neighbour = rigid_neighbour(at)
        return moved_by_homography(self._source.generate(neighbour, count), neighbour, at)

    def reproject(self, at: Estimate, edges: GeneratedEdges) -> GeneratedEdges:
        """The same edges for another I nearby."""
        neighbour = rigid_neighbour(at)
        return moved_by_homography(self._source.reproject(neighbour, edges), neighbour, at)

    def flow(self, at: Estimate, edges: GeneratedEdges, by_differences: bool) -> FloatArray:
        """Not needed: the directions that go with this source, "homography" and "rigid", are analytic."""
        raise NotImplementedError("a residual homography has no flow: methods ask for an analytic direction")


def rigid_neighbour(at: Estimate) -> Estimate:
    """The estimate of the pose that planar PnP reads off I; its control points are I_r.

    Raises GeometryError where I is degenerate.
    """
    return at.view.at_pose(at.cam_T_obj)


def moved_by_homography(edges: GeneratedEdges, start: Estimate, to: Estimate) -> GeneratedEdges:
    """Edges moved by the homography from the control points of one estimate to those of another.

    Raises GeometryError where one of the two has three collinear points.
    """
    if to.points is None or len(edges) == 0:  # of a pose: rigid as it is
        return edges
    warped = QuadWarp(start.control_points, edges.points).to(to.control_points)
    return replace(edges, points=warped.points, tangents=warped.tangents(edges.tangents))
