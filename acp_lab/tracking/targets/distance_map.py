"""The target of paper IV-B: a frame's edge map and its distance map, where e(I) looks up how far an edge point is off.

Blur, denoise, Canny with automatic thresholds, exact Euclidean distance transform, all in a crop around the part
(paper: the whole image). Between pixels the map is read bilinearly, and its gradient is that of what is read.

With `orientation_bins` above 1 the edges are sorted by direction into as many maps, and a point looks into the one of
its own direction. (Deviation, off by default: one map attracts an edge point to edges of any direction.)
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar, Literal

import cv2
import numpy as np

from acp_lab.errors import TrackingError
from acp_lab.generator.base import GeneratedEdges
from acp_lab.geometry.arrays import BoolArray, ByteImage, FloatArray, IntArray
from acp_lab.imaging.canny import CannyConfig, canny, to_grey
from acp_lab.imaging.distance import distance_map
from acp_lab.imaging.distance_at import ColumnDistances, column_distances, distances_at
from acp_lab.prepared_part import PreparedPart
from acp_lab.tracking.frame_view import Box, Estimate, FrameView
from acp_lab.tracking.learning.knowledge import SampleKnowledge
from acp_lab.tracking.losses import LossForm, edge_loss
from acp_lab.tracking.result import TargetView
from acp_lab.tracking.schedule import Level
from acp_lab.tracking.targets import QUALITY_SIGMA_PX, check_precision

Denoiser = Literal["none", "median", "bilateral", "nonlocal-means"]


@dataclass(frozen=True)
class EdgeMapConfig:
    """How a frame becomes an edge map and its distance map.

    Attributes:
        blur_px: standard deviation of the Gaussian before Canny.
        denoise: what takes out noise before the blur.
        thresholds: rule of Canny's automatic thresholds, see `imaging.canny`.
        orientation_bins: 1 for the paper's single map, more for one map per edge direction.
    """

    blur_px: float = 0.7
    denoise: Denoiser = "none"
    thresholds: Literal["otsu", "median"] = "otsu"
    orientation_bins: int = 1

    def __post_init__(self) -> None:
        if not 0.0 <= self.blur_px <= 20.0:
            raise TrackingError(f"edge_map.blur_px = {self.blur_px:g}: give px from 0 to 20")
        if not 1 <= self.orientation_bins <= 32:
            raise TrackingError(f"edge_map.orientation_bins = {self.orientation_bins}: give 1 to 32")


@dataclass(frozen=True)
class DistanceMap:
    """Configuration: generated edge points look up their distance to the nearest image edge (the paper).

    Attributes:
        loss: e(I) of a distance, see `losses`; "printed", eq. 6, cannot be minimised and is refused. (The default is a
            deviation from the paper: what its text means by a lower weight beyond alpha.)
        edge_map: how the edges of the frame are found.
        precision: information of an edge point of full weight, per squared px; how much this measure counts beside
            others and beside a motion prior.
    """

    kind: ClassVar[str] = "distance-map"
    searches: ClassVar[bool] = False
    learns: ClassVar[bool] = False
    loss: LossForm = "geman-mcclure"
    edge_map: EdgeMapConfig = field(default_factory=EdgeMapConfig)
    precision: float = 6.0

    def __post_init__(self) -> None:
        if self.loss == "printed":
            raise TrackingError(
                "loss form printed: eq. 6 has a pole at D = alpha and no minimum: choose logistic, saturating, "
                "geman-mcclure or tukey"
            )
        check_precision(self.precision)

    def memory(self, model: PreparedPart) -> DistanceMap:
        """A distance map keeps nothing from frame to frame."""
        return self

    def precision_at(self, level: Level) -> float:
        """The same at all levels."""
        return self.precision

    def see(self, view: FrameView, knowledge: SampleKnowledge) -> DistanceMapTarget:
        """The target of one frame."""
        return DistanceMapTarget(distance_target(view.image, view.box, self.edge_map), self.loss)


class DistanceMapTarget:
    """A frame's distance map with a loss."""

    def __init__(self, target: DistanceTarget, loss: LossForm) -> None:
        self._target = target
        self._loss = loss

    def bind(self, edges: GeneratedEdges, at: Estimate, level: Level) -> DistanceMeasure:
        """The measure of one level."""
        return DistanceMeasure(self._target, self._loss, level.alpha_px)

    def agreement(self, edges: GeneratedEdges, at: Estimate, level: Level, sigma_px: float) -> float:
        """The quality of an estimate's edges."""
        return DistanceJudgement.of(self._target, edges, sigma_px).quality


class DistanceMeasure:
    """Distances to the nearest image edge, weighted by a loss (eq. 6 as the text means it)."""

    def __init__(self, target: DistanceTarget, form: LossForm, alpha_px: float) -> None:
        self._target = target
        self._form = form
        self._alpha_px = alpha_px

    def __call__(self, edges: GeneratedEdges) -> DistanceMeasurement:
        """What the distance map says about edge points."""
        seen = self._target.distances(edges.points, edges.normals)
        loss = edge_loss(self._form, seen.values, self._alpha_px)
        weights = loss.least_squares_weights(seen.values) * edges.weights
        # The distance grows along its gradient, so the image edge lies the other way.
        return DistanceMeasurement(seen.values, -seen.gradients, weights, loss.values, edges.weights)

    def reported_loss(self, edges: GeneratedEdges) -> float:
        """e with the level's alpha."""
        return self(edges).loss

    def judge(self, moved: GeneratedEdges, drawn: GeneratedEdges, at: Estimate) -> DistanceJudgement:
        """What the frame says of an estimate's own edges."""
        return DistanceJudgement.of(self._target, drawn, QUALITY_SIGMA_PX, self.reported_loss(moved))


@dataclass(frozen=True)
class DistanceMeasurement:
    """See `solvers.Measurement`; values: (n,) the loss per point; shares: (n,) how much each counts in the mean."""

    residuals: FloatArray
    directions: FloatArray
    weights: FloatArray
    values: FloatArray
    shares: FloatArray

    @property
    def loss(self) -> float:
        """e: the mean over the edge points."""
        total = float(self.shares.sum())
        return float(self.values @ self.shares) / total if total > 0.0 else float("inf")


@dataclass(frozen=True, eq=False)
class DistanceJudgement:
    """See `targets.Judgement`; every edge point has a nearest image edge, so there is nothing to learn."""

    edges: GeneratedEdges
    residuals_px: FloatArray
    quality: float
    loss: float
    target: DistanceTarget
    matches: None = None

    @property
    def score(self) -> float:
        """The quality."""
        return self.quality

    def learn(self, trusted: bool) -> None:
        """A distance map keeps nothing."""

    @property
    def target_view(self) -> TargetView:
        """The edge map and the distance map."""
        target = self.target
        height, width = target.edges.shape
        rows, columns = np.nonzero(target.edges)
        points = np.stack([columns, rows], 1) + np.array(target.origin)
        return TargetView(points, target.origin, (width, height), distance_map(target.edges))

    @classmethod
    def of(
        cls, target: DistanceTarget, edges: GeneratedEdges, sigma_px: float, loss: float = float("nan")
    ) -> DistanceJudgement:
        """Quality: the weighted mean nearness of the edge points to image edges."""
        seen = target.distances(edges.points, edges.normals)
        residuals = -seen.values * np.sign((seen.gradients * edges.normals).sum(1) - 1e-12)
        near = np.exp(-0.5 * (residuals / sigma_px) ** 2)
        return cls(edges, residuals, float(near @ edges.weights / max(edges.weights.sum(), 1e-9)), loss, target)


@dataclass(frozen=True)
class Distances:
    """values: (n,) px to the nearest image edge; gradients: (n, 2) by the point's position, of length about 1."""

    values: FloatArray
    gradients: FloatArray


@dataclass(frozen=True, eq=False)
class DistanceTarget:
    """Edge maps of a crop, and the distances to them.

    Attributes:
        edges: (h, w) bool, Canny's edge pixels.
        layers: (bins, h, w) bool, those of each direction; one layer is all of them.
        origin: (x, y) of the crop's first pixel in the full image.
    """

    edges: BoolArray
    layers: BoolArray
    origin: tuple[int, int]

    @cached_property
    def _columns(self) -> ColumnDistances:
        return column_distances(self.layers)

    def distances(self, points: FloatArray, normals: FloatArray) -> Distances:
        """Distance and gradient at points (n, 2) px of the full image with edge normals (n, 2).

        Outside the crop the border's value is read, grown by the way to the border, so that a point which left the
        crop is far from everything, and one that is nowhere (NaN) infinitely far.
        """
        return Distances(*distances_at(self._columns, self._layer_of(normals), points - self.origin))

    def _layer_of(self, normals: FloatArray) -> IntArray:
        bins = len(self.layers)
        if bins == 1:
            return np.zeros(len(normals), np.int64)
        return np.round(_angle(normals[:, 0], normals[:, 1]) * bins / np.pi).astype(np.int64) % bins


def distance_target(image: ByteImage, box: Box, config: EdgeMapConfig) -> DistanceTarget:
    """Edge maps of an image (h, w, 3) uint8 RGB inside a box (x0, y0, x1, y1), cut to the image."""
    height, width = image.shape[:2]
    x0, y0 = min(max(box[0], 0), width - 8), min(max(box[1], 0), height - 8)
    x1, y1 = max(min(box[2], width), x0 + 8), max(min(box[3], height), y0 + 8)
    grey = _denoised(to_grey(image[y0:y1, x0:x1]), config.denoise)
    edges = canny(grey, CannyConfig(config.blur_px, config.thresholds))
    layers = edges[None] if config.orientation_bins == 1 else _layers_by_direction(grey, edges, config)
    return DistanceTarget(edges, layers, (x0, y0))


def _denoised(grey: ByteImage, denoise: Denoiser) -> ByteImage:
    if denoise == "median":
        return cv2.medianBlur(grey, 3).astype(np.uint8, copy=False)
    if denoise == "bilateral":
        return cv2.bilateralFilter(grey, 5, 25.0, 2.0).astype(np.uint8, copy=False)
    if denoise == "nonlocal-means":
        return cv2.fastNlMeansDenoising(grey, None, 7.0, 5, 11).astype(np.uint8, copy=False)
    return grey


def _layers_by_direction(grey: ByteImage, edges: BoolArray, config: EdgeMapConfig) -> BoolArray:
    smooth = cv2.GaussianBlur(grey, (0, 0), max(config.blur_px, 0.3))
    rows, columns = np.nonzero(edges)
    dx, dy = (cv2.Sobel(smooth, cv2.CV_32F, *axis, borderType=cv2.BORDER_REPLICATE) for axis in ((1, 0), (0, 1)))
    angle = _angle(dx[rows, columns], dy[rows, columns])
    bins = config.orientation_bins
    centres = (np.arange(bins) * np.pi / bins).astype(np.float32)[:, None]
    # Each edge is in the two nearest bins: at a border between bins a small turn must not lose it.
    near = np.abs((angle - centres + 0.5 * np.pi) % np.pi - 0.5 * np.pi) <= np.pi / bins
    layers = np.zeros((bins, *edges.shape), np.bool_)
    for layer, of_layer in zip(layers, near, strict=True):
        layer[rows[of_layer], columns[of_layer]] = True
    return layers


def _angle(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Direction of a line in [0, pi): a normal and its opposite are the same."""
    angle: np.ndarray = np.arctan2(y, x) % np.pi
    return angle
