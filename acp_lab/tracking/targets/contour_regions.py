"""Regions alone: the sparse region tracker RBGT/SRT3D as a target of the frame loop.

Lines across the outline, at most some hundred, whose posterior over the place of a smoothed step (`step_posterior`) is
climbed by regularised Newton steps: the first one of a level takes the posterior for a Gaussian (the global term), the
next take its slope where the line stands (the local term). Which lines are free of the part itself is looked up by view
(`viewpoints`). Other than `RegionLines`, which helps edges, it calibrates nothing and needs no edges.

Source: Stoiber et al., "A sparse Gaussian approach to region-based 6DoF object tracking" (ACCV 2020); "SRT3D" (IJCV
2022), sections 3.2 to 3.5.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import numpy as np

from acp_lab.cad.raycast import caster_of
from acp_lab.compiled import kernel
from acp_lab.errors import TrackingError
from acp_lab.generator.base import GeneratedEdges
from acp_lab.geometry.arrays import BoolArray, FloatArray, IntArray
from acp_lab.prepared_part import PreparedPart
from acp_lab.tracking.frame_view import Estimate, FrameView
from acp_lab.tracking.learning.knowledge import SampleKnowledge
from acp_lab.tracking.learning.region_colours import ColourConfig, RegionColours
from acp_lab.tracking.result import TargetView
from acp_lab.tracking.schedule import Level
from acp_lab.tracking.targets.correspondence_lines import ColourCrop, CorrespondenceLines
from acp_lab.tracking.targets.step_posterior import PLACES, SEGMENTS, SmoothStep, fill_posteriors
from acp_lab.tracking.targets.viewpoints import SparseViews

_RAY_STEP_PX = 3.0
_STILL_PX = 1e-6


@dataclass(frozen=True)
class ContourRegions:
    """Configuration: colours on lines across the outline, and nothing else.

    Attributes:
        lines: at most; step: what the outline looks like on them.
        local_rate: length of a local step, relative to Newton's.
        free_segments: how far, in segments, a line must be free of other outlines on both sides.
        reach_px: how far that is looked for.
        colours: how they are learnt.

    A level's `reach_px` is half the length of its lines, `sigma_px` the standard deviation that a line is given.
    """

    kind: ClassVar[str] = "contour-regions"
    searches: ClassVar[bool] = True
    learns: ClassVar[bool] = True
    lines: int = 200
    step: SmoothStep = field(default_factory=SmoothStep)
    local_rate: float = 1.3
    free_segments: float = 3.0
    reach_px: float = 24.0
    colours: ColourConfig = field(default_factory=ColourConfig)

    def __post_init__(self) -> None:
        if not self.lines >= 6:
            raise TrackingError(f"targets.lines = {self.lines}: give 6 or more")
        for name in ("local_rate", "free_segments"):
            if not 0.0 < getattr(self, name) <= 100.0:
                raise TrackingError(f"targets.{name} = {getattr(self, name):g}: give a number above 0, at most 100")
        if not _RAY_STEP_PX <= self.reach_px <= 1000.0:
            raise TrackingError(f"targets.reach_px = {self.reach_px:g}: give px from {_RAY_STEP_PX:g} to 1000")

    def memory(self, model: PreparedPart) -> ContourMemory:
        """Nothing known yet."""
        return ContourMemory(self, model)

    def precision_at(self, level: Level) -> float:
        """Information of a line of full weight, per squared px."""
        return 1.0 / level.sigma_px**2


class ContourMemory:
    """What is kept from frame to frame: the colours of the part and of its background, and the views met so far.

    off_obj: (n, 3) the sum of the two face normals of each edge sample, which points off the material.
    has_looked: whether a frame was learnt from, also if no colours were seen there.
    """

    def __init__(self, config: ContourRegions, model: PreparedPart) -> None:
        self.config = config
        self.edges = model.edges
        self.off_obj = model.edges.off_obj
        self.colours = RegionColours(config.colours)
        self.has_looked = False
        self.views = SparseViews(
            len(model.edges), model.part.box_centre, caster_of(model.part), config.reach_px, _RAY_STEP_PX
        )

    def see(self, view: FrameView, knowledge: SampleKnowledge) -> ContourTarget:
        """The target of one frame."""
        return ContourTarget(ColourCrop(view.image, view.box, self.colours), self)

    def learn(self, lines: CorrespondenceLines) -> None:
        """Take in the colours beside the lines of a solved frame."""
        self.colours.learn(*lines.bins_beside(self.config.colours.reach_px))
        self.has_looked = True


@dataclass(frozen=True, eq=False)
class ContourTarget:
    """The colours of one frame around the part."""

    crop: ColourCrop
    memory: ContourMemory

    def bind(self, edges: GeneratedEdges, at: Estimate, level: Level) -> ContourMeasure:
        """The measure of one level."""
        return ContourMeasure(self, edges, at, level)

    def agreement(self, edges: GeneratedEdges, at: Estimate, level: Level, sigma_px: float) -> float:
        """The margin of the colours at an estimate, in [0, 1]."""
        return max(self.lines(edges, at).margin(), 0.0)

    def lines(self, edges: GeneratedEdges, at: Estimate) -> CorrespondenceLines:
        """Across the outline at an estimate with its edge points: those with part inside and background outside."""
        memory, most = self.memory, min(self.memory.config.lines, len(edges))
        rows, ids = np.empty((2, most), np.int64)
        points, outward = np.empty((2, most, 2))
        free, px_per_mm = np.empty((2, most)), np.empty(most)
        camera, pose = at.view.camera, np.ascontiguousarray(at.cam_T_obj)
        given = (
            np.ascontiguousarray(edges.points), np.ascontiguousarray(edges.normals), edges.outline,
            np.ascontiguousarray(edges.sample_ids, np.int64), memory.edges.points_obj, memory.off_obj,
            memory.edges.crease, pose, camera.fx, camera.fy, memory.views.free_mm(at),
        )  # fmt: skip
        count, unknown = _across(*given, rows, ids, points, outward, free, px_per_mm)
        if unknown:
            memory.views.look_along(ids[:count], points[:count], outward[:count], px_per_mm[:count], at)
            count, _ = _across(*given, rows, ids, points, outward, free, px_per_mm)
        return CorrespondenceLines(
            self.crop, rows[:count], ids[:count], points[:count], outward[:count], free[:, :count], px_per_mm[:count]
        )


@kernel(
    "UniTuple(i8, 2)(f8[:, ::1], f8[:, ::1], b1[::1], i8[::1], f8[:, ::1], f8[:, ::1], b1[::1], f8[:, ::1], f8, f8,"
    " f8[:, ::1], i8[::1], i8[::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[::1])"
)
def _across(
    edge_points: FloatArray, normals: FloatArray, outline: BoolArray, sample_ids: IntArray, points_obj: FloatArray,
    off_obj: FloatArray, crease: BoolArray, cam_T_obj: FloatArray, fx: float, fy: float, free_mm: FloatArray,
    rows: IntArray, ids: IntArray, points: FloatArray, outward: FloatArray, free: FloatArray, px_per_mm: FloatArray,
) -> tuple[int, int]:  # fmt: skip
    """Fill the arrays of `CorrespondenceLines` with the lines across an outline; returns how many, and of how many of
    these nobody knows yet how far they are free.

    edge_points, normals: (n, 2); outline, sample_ids: (n,); points_obj, off_obj, crease, free_mm: of all samples. The
    first `len(rows)` points of the outline are asked, and those left out that are known not to be free.

    On creases a line runs along the edge's own normal. Where the surface turns away smoothly the silhouette of a mesh
    zigzags, and its normals with it: there it is the projection of the direction off the material.
    """
    asked, count, unknown = 0, 0, 0
    point, off = np.empty(3), np.empty(3)
    for n in range(len(edge_points)):
        i = sample_ids[n]
        if asked == len(rows) or not (outline[n] and i >= 0):
            continue
        asked += 1
        for row in range(3):
            point[row], off[row] = cam_T_obj[row, 3], 0.0
            for k in range(3):
                point[row] += cam_T_obj[row, k] * points_obj[i, k]
                off[row] += cam_T_obj[row, k] * off_obj[i, k]
        x = fx * (off[0] - point[0] / point[2] * off[2])
        y = fy * (off[1] - point[1] / point[2] * off[2])
        length = max(np.hypot(x, y), 1e-12)
        x, y = x / length, y / length
        if crease[i]:
            side = -1.0 if normals[n, 0] * x + normals[n, 1] * y < 0.0 else 1.0
            x, y = side * normals[n, 0], side * normals[n, 1]
        along, down = fx * x / point[2], fy * y / point[2]
        forth = -(along * point[0] + down * point[1]) / point[2]
        scale = np.sqrt(along * along + down * down + forth * forth)
        inwards, outwards = scale * free_mm[0, i], scale * free_mm[1, i]
        if min(inwards, outwards) <= 0.0:
            continue
        unknown += np.isnan(inwards)
        rows[count], ids[count], px_per_mm[count] = n, i, scale
        points[count], outward[count, 0], outward[count, 1] = edge_points[n], x, y
        free[0, count], free[1, count] = inwards, outwards
        count += 1
    return count, unknown


class ContourMeasure:
    """The posterior of each line of one level, and how far along it the outline has moved since.

    directions: (n, 2) unit, across the outline at the level's n edge points; those that are no lines have weight 0.
    start: (n, 2) px, where these were.
    """

    def __init__(self, target: ContourTarget, edges: GeneratedEdges, at: Estimate, level: Level) -> None:
        config = target.memory.config
        self.target, self.directions = target, edges.normals.copy()
        self.start, self._rate = np.ascontiguousarray(edges.points), config.local_rate
        self.scale = max(1, round(2.0 * level.reach_px / SEGMENTS))
        lines = target.lines(edges, at)
        usable = lines.free.min(0) >= config.free_segments * self.scale
        points, outward = (lines.points - target.crop.origin)[usable], lines.outward[usable]
        self._rows = lines.rows[usable]
        self._found = np.empty((len(points), PLACES + 2))
        colours = target.crop.colours
        fill_posteriors(
            target.crop.bins, colours.log_odds, np.ascontiguousarray(points), np.ascontiguousarray(outward), self.scale,
            config.step.values, self._found,
        )  # fmt: skip
        least = config.step.least_variance
        self._variance = np.maximum(self._found[:, PLACES + 1], least)
        self._certainty = least / self._variance if colours.is_known else np.zeros(len(points))
        self.directions[self._rows] = outward

    def __call__(self, edges: GeneratedEdges) -> LineMeasurement:
        """Residuals of the lines where their points are now: of the Gaussian at first, then of the slope."""
        residuals, weights = np.zeros(len(edges)), np.zeros(len(edges))
        points = np.ascontiguousarray(edges.points)
        loss = newton_steps(*self.posteriors, points, self.start, self.directions, residuals, weights)
        return LineMeasurement(residuals, self.directions, weights, loss)

    @property
    def posteriors(self) -> tuple[FloatArray, FloatArray, FloatArray, float, float, IntArray]:
        """Of the m lines, for `newton_steps`: found, variance, certainty, scale, rate, rows."""
        return self._found, self._variance, self._certainty, float(self.scale), self._rate, self._rows

    def reported_loss(self, edges: GeneratedEdges) -> float:
        """Half the squared distance to the posteriors' means, weighted, the mean over the edge points, px^2."""
        return self(edges).loss

    def judge(self, moved: GeneratedEdges, drawn: GeneratedEdges, at: Estimate) -> ContourJudgement:
        """What the colours say of a later estimate."""
        return ContourJudgement(drawn if len(drawn) == len(moved) else moved, self, at, self.reported_loss(moved))


@kernel(
    "f8(f8[:, ::1], f8[::1], f8[::1], f8, f8, i8[::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[::1], f8[::1])"
)
def newton_steps(
    found: FloatArray, variance: FloatArray, certainty: FloatArray, scale: float, rate: float, rows: IntArray,
    points: FloatArray, start: FloatArray, directions: FloatArray, residuals: FloatArray, weights: FloatArray,
) -> float:  # fmt: skip
    """Fill residuals (n,) px and weights (n,) of the edge points that are lines; returns the loss, the mean
    over the edge points.

    found, variance, certainty: of the m lines, whose edge points are `rows`. Where no line has moved since the
    posteriors were taken, a step goes to the Gaussian's mean; afterwards, by the slope of the log-posterior between the
    two places next to it, times the variance, which is Newton's step. Who has left its line says nothing.
    """
    along, moved = np.empty(len(rows)), 0.0
    for i in range(len(rows)):
        row = rows[i]
        way = (points[row, 0] - start[row, 0]) * directions[row, 0]
        way += (points[row, 1] - start[row, 1]) * directions[row, 1]
        along[i] = way / scale
        moved = max(moved, abs(way))
    loss = 0.0
    for i in range(len(rows)):
        row, weight = rows[i], certainty[i]
        to_mean = found[i, PLACES] - along[i]
        loss += 0.5 * weight * (scale * to_mean) ** 2
        step = to_mean
        if moved >= _STILL_PX:
            lower = int(np.floor(along[i] + 0.5 * (PLACES - 1)))
            if not 0 <= lower < PLACES - 1:
                continue
            step = rate * variance[i] * (found[i, lower + 1] - found[i, lower])
        residuals[row], weights[row] = scale * step, weight
    return loss / max(len(points), 1)


@dataclass(frozen=True, eq=False)
class LineMeasurement:
    """See `solvers.Measurement`: residuals (n,) px along directions (n, 2), weights (n,), loss px^2."""

    residuals: FloatArray
    directions: FloatArray
    weights: FloatArray
    loss: float


@dataclass(frozen=True, eq=False)
class ContourJudgement:
    """See `targets.Judgement`."""

    edges: GeneratedEdges
    measure: ContourMeasure
    at: Estimate
    loss: float
    matches: None = None

    @cached_property
    def lines(self) -> CorrespondenceLines:
        """The lines at the estimate."""
        return self.measure.target.lines(self.edges, self.at)

    @cached_property
    def score(self) -> float:
        """The margin of the colours: mean probability just inside less that just outside."""
        return self.lines.margin()

    @property
    def quality(self) -> float:
        """The margin, in [0, 1]; 1 in a first frame, of whose colours nothing is known that could speak against it."""
        target = self.measure.target
        if not target.crop.colours.is_known:
            return 0.0 if target.memory.has_looked else 1.0
        return min(max(self.score, 0.0), 1.0)

    def learn(self, trusted: bool) -> None:
        """Take in the colours."""
        self.measure.target.memory.learn(self.lines)

    @property
    def residuals_px(self) -> FloatArray:
        """(n,) NaN: lines say where regions end, not which edge belongs to which."""
        return np.full(len(self.edges), np.nan)

    @property
    def target_view(self) -> TargetView:
        """The crop, without edges."""
        height, width = self.measure.target.crop.bins.shape
        return TargetView(np.zeros((0, 2)), self.measure.target.crop.origin, (width, height))
