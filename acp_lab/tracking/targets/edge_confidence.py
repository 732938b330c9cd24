"""SLET: image edges on lines across the outline, each as sure as its colours and its distance make it.

A line across the outline crosses many image edges. An edge of the part's outline has the part's colours inside and the
background's outside; an edge within the part, or within the background, has the same colours on both sides. With f and
b the likelihoods of a pixel's colour in the part and in the background, products over some pixels beside an edge::

    outline     f(inside) b(outside)
    clutter     f(inside) f(outside)   in the part,      b(inside) b(outside)   in the background

An edge that is rather clutter is left out. Of the others the one of greatest confidence is taken: the share of
"outline" in the three, times exp(-(d / sigma)^2 / 2) of its distance d. The confidence is its weight in the least
squares, so lines whose outline is hidden say little.

Source: Huang, Zhong, Sun and Qin, "An occlusion-aware edge-based method for monocular 3D object tracking using edge
confidence" (Computer Graphics Forum 39(7), 2020), from its description. Deviations: one histogram for the part and one
for its background instead of many local ones; the outline is the CAD's edge samples instead of a rendered mask.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import numpy as np

from acp_lab.compiled import kernel
from acp_lab.errors import TrackingError
from acp_lab.generator.base import GeneratedEdges
from acp_lab.geometry.arrays import Float32Array, FloatArray, Uint16Array
from acp_lab.imaging.edge_search import AS_THEY_ARE, ImagePatch, SearchConfig, image_patch, search_along_normals
from acp_lab.prepared_part import PreparedPart
from acp_lab.tracking.frame_view import Estimate, FrameView
from acp_lab.tracking.learning.knowledge import SampleKnowledge
from acp_lab.tracking.learning.region_colours import ColourConfig
from acp_lab.tracking.result import TargetView
from acp_lab.tracking.schedule import Level
from acp_lab.tracking.targets import QUALITY_SIGMA_PX
from acp_lab.tracking.targets.contour_regions import ContourMemory, ContourRegions, ContourTarget, LineMeasurement
from acp_lab.tracking.targets.correspondence_lines import ColourCrop, CorrespondenceLines


@dataclass(frozen=True)
class EdgeConfidence:
    """Configuration: image edges along outline normals, chosen and weighted by colours and distance.

    Attributes:
        lines: at most. search: how image edges are found on them.
        beside_px: how many pixels on either side of an image edge are asked for their colours.
        gap_px: pixels next to the edge that are not asked: a blurred edge mixes the colours of both sides.
        least_contrast: score in [0, 1] below which an image edge is noise.
        reach_px: how far a line is free of other outlines, at most.
        colours: how they are learnt, and how far from the outline.
    """

    kind: ClassVar[str] = "edge-confidence"
    searches: ClassVar[bool] = True
    learns: ClassVar[bool] = True
    lines: int = 200
    search: SearchConfig = AS_THEY_ARE
    beside_px: int = 5
    gap_px: int = 2
    least_contrast: float = 0.05
    reach_px: float = 24.0
    colours: ColourConfig = field(default_factory=ColourConfig)

    def __post_init__(self) -> None:
        if not self.lines >= 6:
            raise TrackingError(f"targets.lines = {self.lines}: give 6 or more")
        if not 1 <= self.beside_px <= 100:
            raise TrackingError(f"targets.beside_px = {self.beside_px}: give 1 to 100")
        if not 0 <= self.gap_px <= 100:
            raise TrackingError(f"targets.gap_px = {self.gap_px}: give 0 to 100")
        if not 0.0 <= self.least_contrast < 1.0:
            raise TrackingError(f"targets.least_contrast = {self.least_contrast:g}: give a score from 0 to 1")
        if not 3.0 <= self.reach_px <= 1000.0:
            raise TrackingError(f"targets.reach_px = {self.reach_px:g}: give 3 to 1000")

    def memory(self, model: PreparedPart) -> ConfidenceMemory:
        """Nothing known yet."""
        return ConfidenceMemory(self, model)

    def precision_at(self, level: Level) -> float:
        """Information of a line of full confidence, per squared px."""
        return 1.0 / level.sigma_px**2


class ConfidenceMemory:
    """What is kept from frame to frame: colours, and where lines are free; see `ContourMemory`."""

    def __init__(self, config: EdgeConfidence, model: PreparedPart) -> None:
        self.config = config
        outline = ContourRegions(lines=config.lines, reach_px=config.reach_px, colours=config.colours)
        self.outline = ContourMemory(outline, model)

    def see(self, view: FrameView, knowledge: SampleKnowledge) -> ConfidenceTarget:
        """The target of one frame."""
        colours = ContourTarget(ColourCrop(view.image, view.box, self.outline.colours), self.outline)
        return ConfidenceTarget(image_patch(view.image, view.box, self.config.search), colours, self.config)


@dataclass(frozen=True, eq=False)
class ConfidenceTarget:
    """Gradients (patch) and colours of one frame around the part."""

    patch: ImagePatch
    colours: ContourTarget
    config: EdgeConfidence

    def bind(self, edges: GeneratedEdges, at: Estimate, level: Level) -> ConfidenceMeasure:
        """The measure of one level."""
        return ConfidenceMeasure(self, edges, at, level)

    def agreement(self, edges: GeneratedEdges, at: Estimate, level: Level, sigma_px: float) -> float:
        """In [0, 1]: mean over the lines of the best edge's confidence, as near as sigma_px."""
        confidence = ConfidenceMeasure(self, edges, at, level).confidence_within(sigma_px)
        return float(confidence.mean()) if len(confidence) else 0.0


class ConfidenceMeasure:
    """The image edges on the lines of one level, and how sure each is.

    directions: (n, 2) unit, across the outline at the level's n edge points; those that are no lines have weight 0.
    """

    def __init__(self, target: ConfidenceTarget, edges: GeneratedEdges, at: Estimate, level: Level) -> None:
        config, crop = target.config, target.colours.crop
        self.target, self.directions, self._start = target, edges.normals.copy(), edges.points
        self._sigma_px = level.sigma_px
        self.lines = target.colours.lines(edges, at)
        self.directions[self.lines.rows] = self.lines.outward
        found = search_along_normals(target.patch, self.lines.points, self.lines.outward, level.reach_px, config.search)
        self._offsets = found.offsets
        self.sureness = np.zeros_like(found.scores)
        if crop.colours.is_known and len(self.lines):
            _outline_shares(
                crop.bins, crop.colours.log_odds, np.ascontiguousarray(self.lines.points - crop.origin),
                np.ascontiguousarray(self.lines.outward), np.ascontiguousarray(found.offsets),
                config.gap_px, config.beside_px, self.sureness,
            )  # fmt: skip
            self.sureness[found.scores < config.least_contrast] = 0.0

    def __call__(self, edges: GeneratedEdges) -> LineMeasurement:
        """Of each line the surest edge, from where its point is now."""
        distances, confidence = self._chosen(edges, self._sigma_px)
        residuals, weights = np.zeros(len(edges)), np.zeros(len(edges))
        residuals[self.lines.rows], weights[self.lines.rows] = distances, confidence
        loss = 0.5 * float(confidence @ distances**2) / max(len(edges), 1)
        return LineMeasurement(residuals, self.directions, weights, loss)

    def confidence_within(self, sigma_px: float, edges: GeneratedEdges | None = None) -> FloatArray:
        """(l,) of each line's surest edge, at edge points, where they were bound by default."""
        return self._chosen(edges, sigma_px)[1]

    def _chosen(self, edges: GeneratedEdges | None, sigma_px: float) -> tuple[FloatArray, FloatArray]:
        """(l,) px still to go to each line's surest edge, and its confidence."""
        distances = self._offsets
        if edges is not None:
            rows = self.lines.rows
            moved = np.einsum("nj,nj->n", edges.points[rows] - self._start[rows], self.directions[rows])
            distances = distances - moved[:, None]
        confidence = self.sureness * np.exp(-0.5 * (distances / sigma_px) ** 2)
        best = np.arange(len(distances)), confidence.argmax(1)
        return distances[best], confidence[best]

    def reported_loss(self, edges: GeneratedEdges) -> float:
        """Half the squared distance to the chosen edges, by their confidence, the mean over the edge points, px^2."""
        return self(edges).loss

    def judge(self, moved: GeneratedEdges, drawn: GeneratedEdges, at: Estimate) -> ConfidenceJudgement:
        """What image and colours say of a later estimate."""
        return ConfidenceJudgement(drawn if len(drawn) == len(moved) else moved, moved, self, at)


@kernel("void(u2[:, ::1], f4[::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], i8, i8, f8[:, ::1])")
def _outline_shares(
    bins: Uint16Array, log_odds: Float32Array, points: FloatArray, outward: FloatArray, offsets: FloatArray,
    gap_px: int, beside_px: int, shares: FloatArray,
) -> None:  # fmt: skip
    """Fill shares (l, m): of "outline" among outline and clutter, 0 where an edge is rather clutter.

    points, outward: (l, 2) px of the crop, unit normals; offsets: (l, m) px of the image edges along them. With the
    log-odds of the pixels inside and outside summed to i and o, the three products stand as 1 : exp(o) : exp(-i).
    """
    height, width = bins.shape
    for line in range(len(points)):
        for k in range(offsets.shape[1]):
            inside, outside = 0.0, 0.0
            for step in range(gap_px + 1, gap_px + beside_px + 1):
                for side in (-1, 1):
                    way = offsets[line, k] + side * step
                    column = int(np.floor(points[line, 0] + way * outward[line, 0] + 0.5))
                    row = int(np.floor(points[line, 1] + way * outward[line, 1] + 0.5))
                    if 0 <= column < width and 0 <= row < height:
                        if side < 0:
                            inside += log_odds[bins[row, column]]
                        else:
                            outside += log_odds[bins[row, column]]
            if inside > 0.0 and outside < 0.0:
                shares[line, k] = 1.0 / (1.0 + np.exp(outside) + np.exp(-inside))


@dataclass(frozen=True, eq=False)
class ConfidenceJudgement:
    """See `targets.Judgement`; moved: the level's points where its motion put them."""

    edges: GeneratedEdges
    moved: GeneratedEdges
    measure: ConfidenceMeasure
    at: Estimate
    matches: None = None

    @cached_property
    def loss(self) -> float:
        """As reported."""
        return self.measure.reported_loss(self.moved)

    @cached_property
    def quality(self) -> float:
        """Mean confidence of the lines' surest edges; 1 in a first frame, of whose colours nothing is known."""
        target = self.measure.target.colours
        if not target.crop.colours.is_known:
            return 0.0 if target.memory.has_looked else 1.0
        confidence = self.measure.confidence_within(QUALITY_SIGMA_PX, self.moved)
        return float(confidence.mean()) if len(confidence) else 0.0

    @property
    def score(self) -> float:
        """The quality."""
        return self.quality

    @cached_property
    def lines(self) -> CorrespondenceLines:
        """The lines at the estimate."""
        return self.measure.target.colours.lines(self.edges, self.at)

    def learn(self, trusted: bool) -> None:
        """Take in the colours."""
        self.measure.target.colours.memory.learn(self.lines)

    @property
    def residuals_px(self) -> FloatArray:
        """(n,) px to the chosen edges, NaN where a line has none."""
        seen = self.measure(self.moved)
        return np.where(seen.weights > 0.0, seen.residuals, np.nan)

    @property
    def target_view(self) -> TargetView:
        """The image edges that are no clutter."""
        measure = self.measure
        rows, columns = np.nonzero(measure.sureness > 0.0)
        offsets = measure._offsets[rows, columns]
        height, width = measure.target.patch.channels.shape[:2]
        points = measure.lines.points[rows] + offsets[:, None] * measure.lines.outward[rows]
        return TargetView(points, measure.target.patch.origin, (width, height))
