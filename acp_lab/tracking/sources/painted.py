"""Edges of the auto-encoder: an edge image E = t(I) painted in the canonical frame, and two ways to read points off it.

The canonical frame is fixed for the frame by the predicted pose (see `control_points.canonical_frame`); I goes there by
a homography, and what is read comes back by it.

    RidgeSource     the points are where E has its ridges: the paper's t(I) as it is, with the network's errors of
                    about half a canonical pixel
    SampleSource    E tells *which* of the CAD's edge samples show, and these stand where the pose of I puts them.
                    (Deviation from the paper: positions are the CAD's, the choice is the network's.)
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from acp_lab.cad.edges import facing
from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.generator.base import GeneratedEdges, VisibleSamples
from acp_lab.generator.painted.edge_points import RidgePoints, ridge_motion, sample_bilinear
from acp_lab.generator.painted.image_generator import AutoencoderGenerator, PointSet
from acp_lab.geometry.homography import apply_homography
from acp_lab.tracking.frame_view import DIFFERENCE_PX, View
from acp_lab.tracking.learning.contour_offsets import ContourOffsets
from acp_lab.tracking.sources.rigid import project_again, project_with_offsets, rigid_flow

Reader = Callable[[np.ndarray, float], RidgePoints]

# Samples that are asked for; a quarter of them shows at most.
_SAMPLES_PER_EDGE = 3
# From this multiple of the threshold on a sample counts fully: how brightly a line is painted says little.
_FULL_WEIGHT = 4.0


class RidgeSource:
    """Edge points are the ridges of the edge image, or its bright pixels thinned: the paper's t(I) as it is."""

    def __init__(
        self, generator: AutoencoderGenerator, point_set: PointSet, read: Reader, level: float, count: int
    ) -> None:
        self._generator = generator
        self._point_set = point_set
        self._read = read
        self._level = level
        self._count = count

    def generate(self, view: View, control_points: np.ndarray) -> GeneratedEdges:
        """The edges of I (4, 2) px."""
        canonical = view_to_canonical(view, control_points)
        image = self._generator.edge_image(canonical, view.region, self._point_set)
        found = self._points(image)
        local = _local_scale(view.image_H_canonical, found.points)
        tangents = np.einsum("nij,nj->ni", local, found.tangents)
        tangents /= np.maximum(np.hypot(tangents[:, 0], tangents[:, 1]), 1e-12)[:, None]
        points = apply_homography(view.image_H_canonical, found.points)
        return GeneratedEdges(points, tangents, found.strengths, np.full(len(points), -1))

    def settled(
        self, view: View, control_points: np.ndarray, cam_T_obj: np.ndarray, edges: GeneratedEdges
    ) -> GeneratedEdges:
        """The edges of I, painted anew: ridges are nothing that could be moved."""
        return self.generate(view, control_points)

    def flow(self, view: View, control_points: np.ndarray, edges: GeneratedEdges, by_differences: bool) -> np.ndarray:
        """(n, 2, 8), across the ridge only; NaN where lines fade or meet, which solvers leave out."""
        canonical = view_to_canonical(view, control_points)
        if by_differences:
            image, by_canonical = self._differences(canonical, view.region)
        else:
            image, by_canonical = self._generator.edge_image_derivatives(canonical, view.region, self._point_set)
        found = self._points(image)
        across = ridge_motion(image, by_canonical, found)
        to_image = np.einsum("nij,nj->ni", _local_scale(view.image_H_canonical, found.points), found.normals)
        # I comes into the canonical frame by the inverse homography, each control point by its own 2x2 scale there.
        to_canonical = np.zeros((8, 8))
        for k, local in enumerate(_local_scale(view.canonical_H_image, control_points)):
            to_canonical[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = local
        flow: np.ndarray = to_image[:, :, None] * (across @ to_canonical)[:, None, :]
        return flow

    def _points(self, image: np.ndarray) -> RidgePoints:
        """The edge points of an edge image, thinned evenly to at most `count`."""
        found = self._read(image, self._level)
        if len(found) <= self._count:
            return found
        keep = np.linspace(0, len(found) - 1, self._count).astype(np.intp)
        return RidgePoints(found.points[keep], found.tangents[keep], found.strengths[keep])

    def _differences(self, canonical: np.ndarray, region: int) -> tuple[np.ndarray, np.ndarray]:
        nudges = np.eye(8).reshape(8, 4, 2) * DIFFERENCE_PX
        batch = np.concatenate([canonical[None], canonical + nudges, canonical - nudges])
        images = self._generator.edge_images(batch, region, self._point_set)
        return images[0], np.moveaxis(images[1:9] - images[9:], 0, -1) / (2.0 * DIFFERENCE_PX)


class SampleSource:
    """Edge points are the CAD's edge samples that lie on painted lines."""

    def __init__(
        self,
        generator: AutoencoderGenerator,
        point_set: PointSet,
        offsets: ContourOffsets,
        level: float,
        count: int,
    ) -> None:
        self._generator = generator
        self._point_set = point_set
        self._offsets = offsets
        self._level = level
        self._count = count

    def generate(self, view: View, control_points: np.ndarray) -> GeneratedEdges:
        """The edges of I (4, 2) px."""
        pose = view.pose(control_points)
        image = self._generator.edge_image(view_to_canonical(view, control_points), view.region, self._point_set)
        turned = facing(self._offsets.edges, eye_position(pose))
        rows = np.flatnonzero(turned.shows)[: _SAMPLES_PER_EDGE * self._count]
        drawn = project_with_offsets(
            self._offsets, VisibleSamples(rows, turned.outline[rows], np.ones(len(rows))), view, pose
        )
        brightness = sample_bilinear(image, view_to_canonical(view, drawn.points))
        # Samples are in an order that spreads evenly wherever it is cut.
        lit = np.flatnonzero(brightness > self._level)[: self._count]
        weights = np.minimum(brightness[lit] / (_FULL_WEIGHT * self._level), 1.0)
        return GeneratedEdges(drawn.points[lit], drawn.tangents[lit], weights, drawn.sample_ids[lit])

    def settled(
        self, view: View, control_points: np.ndarray, cam_T_obj: np.ndarray, edges: GeneratedEdges
    ) -> GeneratedEdges:
        """The same samples at the pose (4, 4)."""
        return project_again(self._offsets, edges, view, cam_T_obj)

    def flow(self, view: View, control_points: np.ndarray, edges: GeneratedEdges, by_differences: bool) -> np.ndarray:
        """(n, 2, 8), see `rigid_flow`: which samples show changes slowly, where they are is the pose of I."""
        return rigid_flow(view, control_points, self._offsets.edges.points_obj[edges.sample_ids], by_differences)


def view_to_canonical(view: View, points: np.ndarray) -> np.ndarray:
    """Points (n, 2) px of the image in the view's canonical frame."""
    return apply_homography(view.canonical_H_image, points)


def _local_scale(homography: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(n, 2, 2) derivative of a homography (3, 3) at points (n, 2)."""
    homogeneous = points @ homography[:, :2].T + homography[:, 2]
    w = homogeneous[:, 2, None, None]
    moved = homogeneous[:, :2] / homogeneous[:, 2:]
    scale: np.ndarray = (homography[None, :2, :2] - moved[:, :, None] * homography[None, 2:, :2]) / w
    return scale
