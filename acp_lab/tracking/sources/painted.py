"""Edges of the auto-encoder: an edge image E = t(I) painted in the canonical frame, and two ways to read points off it.

I goes into the canonical frame (see `control_points.canonical_frame`) by a homography, and what is read comes back by
it. That frame stands where the network was trained for it to stand, which the prepared part says: at the pose of I,
anew at every painting, and then what is painted is the rigid neighbour of I; or at the predicted pose, fixed within
the frame.

    PaintedRidges    the points are where E has its ridges: the paper's t(I) as it is, with the network's errors of
                     about half a canonical pixel
    PaintedSamples   E tells *which* of the CAD's edge samples show, and these stand where the pose of I puts them.
                     (Deviation from the paper: positions are the CAD's, the choice is the network's.)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np

from acp_lab.cad.edges import EdgeSamples, facing
from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.errors import TrackingError
from acp_lab.generator.base import GeneratedEdges, VisibleSamples
from acp_lab.generator.painted.edge_images import PaintingFrame
from acp_lab.generator.painted.edge_points import RidgePoints, ridge, ridge_motion, sample_bilinear, threshold
from acp_lab.generator.painted.image_generator import AutoencoderGenerator, PointSet
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.homography import apply_homography
from acp_lab.prepared_part import PreparedPart
from acp_lab.tracking.frame_view import Estimate, View
from acp_lab.tracking.sources.rigid import (
    DIFFERENCE_PX,
    outline_inset_mm,
    project_again,
    project_inset,
    rigid_flow,
)

Reader = Callable[[np.ndarray, float], RidgePoints]

# Control points that differ by less (canonical px; the rounding of a pose that was worked out twice) paint the same.
_SAME_PX = 1e-6
# Samples that are asked for; a quarter of them shows at most.
_SAMPLES_PER_EDGE = 3
# From this multiple of the threshold on a sample counts fully: how brightly a line is painted says little.
_FULL_WEIGHT = 4.0


@dataclass(frozen=True)
class PaintedRidges:
    """Configuration: edge points read off the painted image alone.

    Attributes:
        read: along ridges, or as bright pixels thinned; how the paper does it, it does not say.
        level: the least brightness of an edge point, in (0, 1).
        frame: of painting, at the "pose" of I or at the "prediction"; a part whose auto-encoder was trained for the
            other one is refused.
    """

    kind: ClassVar[str] = "painted-ridges"
    knows_samples: ClassVar[bool] = False
    inset_outlines: ClassVar[bool] = False
    read: Literal["ridge", "threshold"] = "ridge"
    level: float = 0.05
    frame: PaintingFrame = "pose"

    def __post_init__(self) -> None:
        _check_level(self.level)

    def open(self, model: PreparedPart, point_set: PointSet) -> RidgeSource:
        """The source of a part; PreparationError when its auto-encoder is not prepared, or for the other frame."""
        generator = model.autoencoder()
        generator.check_frame(self.frame)
        read = ridge if self.read == "ridge" else threshold
        return RidgeSource(generator, point_set, read, self.level, self.frame)


@dataclass(frozen=True)
class PaintedSamples:
    """Configuration: CAD edge samples gated by the painted image.

    Attributes:
        level: the least brightness of the painted image at a sample, in (0, 1).
        inset_outlines: draw outlines inside the CAD's by what broken edges take off (not in the paper).
    """

    kind: ClassVar[str] = "painted-samples"
    knows_samples: ClassVar[bool] = True
    level: float = 0.05
    inset_outlines: bool = True

    def __post_init__(self) -> None:
        _check_level(self.level)

    def open(self, model: PreparedPart, point_set: PointSet) -> SampleSource:
        """The source of a part; PreparationError when its auto-encoder is not prepared."""
        inset_mm = outline_inset_mm(model) if self.inset_outlines else 0.0
        return SampleSource(model.autoencoder(), point_set, model.edges, inset_mm, self.level)


def _check_level(level: float) -> None:
    if not 0.0 < level < 1.0:
        raise TrackingError(f"source.level = {level:g}: give a brightness between 0 and 1")


class RidgeSource:
    """Edge points are the ridges of the edge image, or its bright pixels thinned: the paper's t(I) as it is.

    With frame "prediction" the network is asked at any I as it is, beside the prior of the estimate's view.
    """

    name = "autoencoder"
    knows_samples = False
    is_exact = False

    def __init__(
        self, generator: AutoencoderGenerator, point_set: PointSet, read: Reader, level: float, frame: PaintingFrame
    ) -> None:
        self._frame = frame
        self.regions = generator.regions
        self.canonical_size = generator.size
        self._generator = generator
        self._point_set = point_set
        self._read = read
        self._level = level
        self._last: tuple[FloatArray, int, RidgePoints] | None = None

    def generate(self, at: Estimate, count: int) -> GeneratedEdges:
        """The edges of an estimate."""
        at = painting_estimate(at, self._frame)
        view = at.view
        found = _thinned(self._ridges(_canonical(at), view.region), count)
        local = _local_scale(view.image_H_canonical, found.points)
        tangents = np.einsum("nij,nj->ni", local, found.tangents)
        tangents /= np.maximum(np.hypot(tangents[:, 0], tangents[:, 1]), 1e-12)[:, None]
        points = apply_homography(view.image_H_canonical, found.points)
        return GeneratedEdges(points, tangents, found.strengths, np.full(len(points), -1))

    def reproject(self, at: Estimate, edges: GeneratedEdges) -> GeneratedEdges:
        """As many edges of the estimate, painted anew: ridges are nothing that could be moved."""
        return self.generate(at, len(edges))

    def flow(self, at: Estimate, edges: GeneratedEdges, by_differences: bool) -> FloatArray:
        """(n, 2, 8), across the ridge only; NaN where lines fade or meet, which solvers leave out.

        For a frame at the prediction: one at the pose moves with I, and methods do not ask for that.
        """
        view, canonical = at.view, _canonical(at)
        if by_differences:
            image, by_canonical = self._differences(canonical, view.region)
        else:
            image, by_canonical = self._generator.edge_image_derivatives(canonical, view.region, self._point_set)
        found = _thinned(self._read(image, self._level), len(edges))
        across = ridge_motion(image, by_canonical, found)
        to_image = np.einsum("nij,nj->ni", _local_scale(view.image_H_canonical, found.points), found.normals)
        # I comes into the canonical frame by the inverse homography, each control point by its own 2x2 scale there.
        to_canonical = np.zeros((8, 8))
        for k, local in enumerate(_local_scale(view.canonical_H_image, at.control_points)):
            to_canonical[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = local
        flow: FloatArray = to_image[:, :, None] * (across @ to_canonical)[:, None, :]
        return flow

    def _ridges(self, canonical: FloatArray, region: int) -> RidgePoints:
        """The edge points of the edge image of I (4, 2) in the canonical frame.

        The last ones are kept: what a frame ends with is painted to judge it, and again where the next one begins.
        """
        if self._last is not None:
            last_canonical, last_region, found = self._last
            if region == last_region and np.abs(canonical - last_canonical).max() <= _SAME_PX:
                return found
        found = self._read(self._generator.edge_image(canonical, region, self._point_set), self._level)
        self._last = canonical, region, found
        return found

    def _differences(self, canonical: FloatArray, region: int) -> tuple[np.ndarray, np.ndarray]:
        nudges = np.eye(8).reshape(8, 4, 2) * DIFFERENCE_PX
        batch = np.concatenate([canonical[None], canonical + nudges, canonical - nudges])
        images = self._generator.edge_images(batch, region, self._point_set)
        return images[0], np.moveaxis(images[1:9] - images[9:], 0, -1) / (2.0 * DIFFERENCE_PX)


class SampleSource:
    """Edge points are the CAD's edge samples that lie on painted lines."""

    name = "autoencoder"
    knows_samples = True

    def __init__(
        self, generator: AutoencoderGenerator, point_set: PointSet, edges: EdgeSamples, inset_mm: float, level: float
    ) -> None:
        self.regions = generator.regions
        self.canonical_size = generator.size
        self._generator = generator
        self._point_set = point_set
        self._edges = edges
        self._inset_mm = inset_mm
        self.is_exact = not inset_mm
        self._level = level

    def generate(self, at: Estimate, count: int) -> GeneratedEdges:
        """The edges of an estimate."""
        at = painting_estimate(at, self._generator.frame)
        view, pose = at.view, at.cam_T_obj
        image = self._generator.edge_image(_canonical(at), view.region, self._point_set)
        turned = facing(self._edges, eye_position(pose))
        rows = np.flatnonzero(turned.shows)[: _SAMPLES_PER_EDGE * count]
        visible = VisibleSamples(rows, turned.outline[rows], np.ones(len(rows)))
        drawn = project_inset(self._edges, visible, view, pose, self._inset_mm)
        brightness = sample_bilinear(image, view_to_canonical(view, drawn.points))
        # Samples are in an order that spreads evenly wherever it is cut.
        lit = np.flatnonzero(brightness > self._level)[:count]
        weights = np.minimum(brightness[lit] / (_FULL_WEIGHT * self._level), 1.0)
        return GeneratedEdges(
            drawn.points[lit], drawn.tangents[lit], weights, drawn.sample_ids[lit], drawn.outline[lit]
        )

    def reproject(self, at: Estimate, edges: GeneratedEdges) -> GeneratedEdges:
        """The same samples at the estimate's pose."""
        return project_again(self._edges, edges, at, self._inset_mm)

    def flow(self, at: Estimate, edges: GeneratedEdges, by_differences: bool) -> FloatArray:
        """(n, 2, 8), see `rigid_flow`: which samples show changes slowly, where they are is the pose of I."""
        return rigid_flow(at, self._edges.points_obj[edges.sample_ids], by_differences)


def _thinned(found: RidgePoints, count: int) -> RidgePoints:
    """The edge points of an image, thinned evenly to at most `count`."""
    if len(found) <= count:
        return found
    keep = np.linspace(0, len(found) - 1, count).astype(np.intp)
    return RidgePoints(found.points[keep], found.tangents[keep], found.strengths[keep])


def painting_estimate(at: Estimate, frame: PaintingFrame) -> Estimate:
    """The estimate that is painted, its view's prior where the canonical frame stands.

    For a frame at the pose it is the rigid neighbour of `at`; GeometryError where its control points are degenerate.
    """
    if frame == "prediction":
        return at
    return replace(at.view, prior=at.cam_T_obj).at_pose(at.cam_T_obj)


def view_to_canonical(view: View, points: FloatArray) -> FloatArray:
    """Points (n, 2) px of the image in the view's canonical frame."""
    return apply_homography(view.canonical_H_image, points)


def _canonical(at: Estimate) -> FloatArray:
    """(4, 2) I in its view's canonical frame."""
    return view_to_canonical(at.view, at.control_points)


def _local_scale(homography: FloatArray, points: FloatArray) -> FloatArray:
    """(n, 2, 2) derivative of a homography (3, 3) at points (n, 2)."""
    homogeneous = points @ homography[:, :2].T + homography[:, 2]
    w = homogeneous[:, 2, None, None]
    moved = homogeneous[:, :2] / homogeneous[:, 2:]
    scale: FloatArray = (homography[None, :2, :2] - moved[:, :, None] * homography[None, 2:, :2]) / w
    return scale
