"""Regions: correspondence lines across the outline, on which colours say where the part ends.

Edges of a metal part's inside are many and alike; its outline is where its colours end, however blurred. On short
lines along the outward normals the log-odds of the pixels are compared with a smoothed step; the posterior over where
the step lies gives each line a residual and, by its variance, a weight (Stoiber et al., "SRT3D", 2022, and the works
cited there). Lines are those outline samples behind which there is background, which rays decide.

Where the colour boundary lies beside the CAD's outline is learnt per sample, and how steadily: before that, lines
speak at coarse levels only.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import numpy as np

from acp_lab.cad.raycast import RayCaster, make_caster
from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.errors import TrackingError
from acp_lab.generator.base import GeneratedEdges
from acp_lab.geometry.arrays import Float32Array, FloatArray, IntArray
from acp_lab.geometry.pose import transform
from acp_lab.geometry.pose_step import image_directions
from acp_lab.prepared_part import PreparedPart
from acp_lab.tracking.frame_view import Estimate, FrameView
from acp_lab.tracking.learning.knowledge import SampleKnowledge
from acp_lab.tracking.learning.region_colours import ColourConfig, RegionColours
from acp_lab.tracking.result import TargetView
from acp_lab.tracking.schedule import Level
from acp_lab.tracking.targets import check_precision

# Places at which the step is tried, in segments about the line's middle, and the segments that each looks at.
_PLACES, _WINDOW = 12, 8
_SEGMENTS = _PLACES + _WINDOW - 1
# Amplitude and steepness of the smoothed step function.
_STEP = -0.43 * np.tanh(np.arange(_WINDOW) - 0.5 * (_WINDOW - 1))
_MOST_LOG_ODDS = 4.0
_RAY_STEP_PX = 2.0
_LARGEST_OFFSET_MM = 0.8


@dataclass(frozen=True)
class RegionLines:
    """Configuration: colours on lines across the outline.

    Attributes:
        lines: at most; reach_px: how far a line may look for other parts of the part.
        colours: how they are learnt.
        precision: information of a line of full weight, per squared px, at coarse levels; fine_share: of it from
            `fine_sigma_px` downwards.
        margin: difference of the mean probabilities inside and outside at which lines have no and full weight.
        scatter_px: rms residual at which a line has half weight at fine levels; unknown_px: what is assumed at first;
            calibration_rate: share of a frame in the running mean.
        smooth_share: how much more lines count at fine levels where the outline is no crease.
        fade_px: segments from the line's middle beyond which its posterior counts less.
    """

    kind: ClassVar[str] = "regions"
    searches: ClassVar[bool] = False
    lines: int = 200
    reach_px: float = 24.0
    colours: ColourConfig = field(default_factory=ColourConfig)
    precision: float = 2.0
    fine_share: float = 0.9
    fine_sigma_px: float = 2.0
    margin: tuple[float, float] = (0.05, 0.35)
    scatter_px: float = 0.25
    unknown_px: float = 2.0
    calibration_rate: float = 0.2
    smooth_share: float = 15.0
    fade_px: float = 2.5

    def __post_init__(self) -> None:
        check_precision(self.precision)
        if not self.margin[0] < self.margin[1]:
            raise TrackingError(f"targets.margin = {self.margin}: give two rising numbers")

    def memory(self, model: PreparedPart) -> RegionMemory:
        """Nothing known yet."""
        return RegionMemory(self, model)

    def precision_at(self, level: Level) -> float:
        """Information of a line of full weight at a level, per squared px."""
        return self.precision * (self.fine_share if level.sigma_px <= self.fine_sigma_px else 1.0)


class RegionMemory:
    """What is kept from frame to frame: colours, and where and how steadily each outline sample's boundary was found.

    margin: running difference of the mean probabilities inside and outside the outline.
    offsets_mm: (n,) of the part's n edge samples, outwards from the CAD's outline to the colours' boundary.
    mean_square: (n,) px^2, running mean of how far beside that it was found.
    known: (n,) bool, whether a sample was ever a line.
    """

    def __init__(self, config: RegionLines, model: PreparedPart) -> None:
        self.config = config
        self.edges = model.edges
        self.part = model.part
        self.colours = RegionColours(config.colours)
        self.margin = 0.0
        count = len(model.edges)
        self.offsets_mm = np.zeros(count)
        self.mean_square = np.full(count, config.unknown_px**2)
        self.known = np.zeros(count, bool)

    @cached_property
    def caster(self) -> RayCaster:
        """Rays against the part."""
        return make_caster(self.part)

    @property
    def gate(self) -> float:
        """In [0, 1]: how much the colours may say at all."""
        low, high = self.config.margin
        return float(np.clip((self.margin - low) / (high - low), 0.0, 1.0)) if self.colours.is_known else 0.0

    def see(self, view: FrameView, knowledge: SampleKnowledge) -> RegionTarget:
        """The target of one frame."""
        return RegionTarget(view, self)


class RegionTarget:
    """The colours of one frame around the part.

    bins: (h, w) of the crop's pixels, see `RegionColours.bins`; origin: (x, y) px of its first pixel in the full image.
    """

    def __init__(self, view: FrameView, memory: RegionMemory) -> None:
        height, width = view.image.shape[:2]
        x0, y0, x1, y1 = view.box
        self.origin = (min(max(x0, 0), width - 2), min(max(y0, 0), height - 2))
        crop = view.image[self.origin[1] : max(y1, self.origin[1] + 2), self.origin[0] : max(x1, self.origin[0] + 2)]
        self.bins = RegionColours.bins(crop)
        self.memory = memory
        self._free = np.full((2, len(memory.edges)), np.nan)

    def bind(self, edges: GeneratedEdges, at: Estimate, level: Level) -> RegionMeasure:
        """The measure of one level."""
        return RegionMeasure(self, edges, at, level)

    def agreement(self, edges: GeneratedEdges, at: Estimate, level: Level, sigma_px: float) -> float:
        """The margin of the colours at an estimate."""
        return CorrespondenceLines(self, edges, at).margin()

    def pixels(self, points: FloatArray) -> IntArray:
        """(...) colour bins at points (..., 2) px of the full image; the nearest pixel of the crop."""
        height, width = self.bins.shape
        x = np.clip(np.rint(points[..., 0] - self.origin[0]), 0, width - 1).astype(np.intp)
        y = np.clip(np.rint(points[..., 1] - self.origin[1]), 0, height - 1).astype(np.intp)
        return self.bins[y, x]

    def free_px(self, ids: IntArray, points: FloatArray, outward: FloatArray, at: Estimate) -> FloatArray:
        """(2, n) px from outline samples to where the part ends inwards, and begins again outwards, at most `reach_px`.

        0 where there is no part inside or no background outside. By rays, once per frame and sample: a pose that is
        refined changes it little.
        """
        asked = np.flatnonzero(np.isnan(self._free[0, ids]))
        if len(asked):
            reach = np.arange(_RAY_STEP_PX, self.memory.config.reach_px + 0.1, _RAY_STEP_PX)
            way = np.concatenate([-reach, reach])
            pixels = points[asked, None] + way[:, None] * outward[asked, None]
            pose = at.cam_T_obj
            rays_obj = at.view.camera.rays(pixels.reshape(-1, 2)) @ pose[:3, :3]
            eye = np.broadcast_to(eye_position(pose), rays_obj.shape)
            hit = self.memory.caster.occluded(eye, rays_obj, 1e9).reshape(len(asked), 2, len(reach))
            # As far as the part reaches without a gap inwards, and the background outwards.
            inwards = np.cumprod(hit[:, 0], axis=1).sum(1)
            outwards = np.cumprod(~hit[:, 1], axis=1).sum(1)
            self._free[:, ids[asked]] = _RAY_STEP_PX * np.stack([inwards, outwards])
        return self._free[:, ids]


class CorrespondenceLines:
    """Lines across the outline at one estimate.

    Attributes:
        rows: (n,) of the edge points that are lines; ids: (n,) their samples.
        points: (n, 2) px; outward: (n, 2) unit, off the part; free: (2, n) see `RegionTarget.free_px`.
        px_per_mm: (n,) scale across the outline.
    """

    def __init__(self, target: RegionTarget, edges: GeneratedEdges, at: Estimate) -> None:
        self.target = target
        rows = np.flatnonzero(edges.outline & (edges.sample_ids >= 0))[: target.memory.config.lines]
        ids, normals, pose = edges.sample_ids[rows], edges.normals[rows], at.cam_T_obj
        samples = target.memory.edges
        points_cam = transform(pose, samples.points_obj[ids])
        directions_obj = image_directions(points_cam, normals, at.view.camera) @ pose[:3, :3]
        side = np.sign(np.einsum("nj,nj->n", directions_obj, samples.normals_obj[ids].sum(1)))
        outward = normals * side[:, None]
        free = target.free_px(ids, edges.points[rows], outward, at)
        keep = (free.min(0) > 0.0) & (side != 0.0)
        self.rows, self.ids, self.outward = rows[keep], ids[keep], outward[keep]
        self.points, self.free = edges.points[self.rows], free[:, keep]
        self.px_per_mm: FloatArray = np.linalg.norm(directions_obj[keep], axis=1)

    def __len__(self) -> int:
        return len(self.rows)

    def log_odds(self, way_px: FloatArray) -> Float32Array:
        """(n, m) log-odds of being the part's, at m px along the outward normals."""
        pixels = self.points[:, None] + way_px[:, None] * self.outward[:, None]
        return self.target.memory.colours.log_odds[self.target.pixels(pixels)]

    def posterior(self, scale: int) -> tuple[FloatArray, FloatArray]:
        """(n,) px from the line's middle to where the part ends, and (n,) weights in [0, 1].

        scale: px per segment.
        """
        within = (np.arange(_SEGMENTS * scale) - 0.5 * (_SEGMENTS * scale - 1)).astype(np.float64)
        odds = self.log_odds(within).reshape(len(self), _SEGMENTS, scale).sum(2)
        odds = np.clip(odds, -_MOST_LOG_ODDS, _MOST_LOG_ODDS)
        evidence = odds @ _WINDOWS
        evidence = np.exp(evidence - evidence.max(1, keepdims=True))
        probability = evidence / evidence.sum(1, keepdims=True)
        mean = probability @ _OFFSETS
        variance = np.maximum((probability * (_OFFSETS - mean[:, None]) ** 2).sum(1), _LEAST_VARIANCE)
        weights = _LEAST_VARIANCE / variance
        beyond = np.abs(mean) - self.target.memory.config.fade_px
        weights = weights * np.clip(1.0 - np.maximum(beyond, 0.0) / 1.5, 0.0, 1.0)
        weights[self.free.min(0) < 2.0 * scale] = 0.0
        return mean * scale, weights

    def margin(self) -> float:
        """Mean probability just inside less that just outside, in [-1, 1]; 0 with fewer than four lines."""
        if len(self) < 4 or not self.target.memory.colours.is_known:
            return 0.0
        way = np.arange(1.0, 9.0)
        inside, outside = (1.0 / (1.0 + np.exp(-self.log_odds(sign * way))) for sign in (-1.0, 1.0))
        free = way <= self.free.min(0)[:, None]
        return float((((inside - outside) * free).sum(1) / np.maximum(free.sum(1), 1)).mean())

    def learn(self, trusted: bool) -> None:
        """Take in colours, and where the boundary lies; trusted: the pose is exact, so that offsets can be measured."""
        memory = self.target.memory
        is_first = not memory.colours.is_known
        way = np.arange(1.0, memory.config.colours.reach_px)
        sides = []
        for sign, free in ((-1.0, self.free[0]), (1.0, self.free[1])):
            pixels = self.target.pixels(self.points[:, None] + sign * way[:, None] * self.outward[:, None])
            sides.append(pixels[way < free[:, None]])
        memory.colours.learn(*sides)
        memory.margin += (1.0 if is_first else 0.25) * (self.margin() - memory.margin)
        if len(self) >= 6:
            self._calibrate(trusted)

    def _calibrate(self, trusted: bool) -> None:
        memory, ids = self.target.memory, self.ids
        found_px, weights = self.posterior(1)
        clear = weights > 0.15
        if trusted:
            near = clear & (np.abs(found_px) < 3.0)
            offsets = np.clip(0.8 * found_px / self.px_per_mm, -0.6, 0.6)
            # What was not seen lies, for all that is known, half as far as the others.
            memory.offsets_mm[:] = 0.5 * np.median(offsets[near]) if near.sum() > 10 else 0.0
            memory.offsets_mm[ids[near]] = offsets[near]
            memory.mean_square[ids] = np.where(near, 0.5, 9.0)
            memory.known[ids] = True
            return
        rest = found_px - memory.offsets_mm[ids] * self.px_per_mm
        square = np.where(clear, np.minimum(rest * rest, 9.0), 9.0)
        rate = np.where(memory.known[ids], memory.config.calibration_rate, 0.5)
        memory.mean_square[ids] += rate * (square - memory.mean_square[ids])
        memory.known[ids] = True


class RegionMeasure:
    """Where colours say that the part ends, for the lines of one level.

    directions: (n, 2) unit, the normals of the level's n edge points; those that are no lines have weight 0.
    """

    def __init__(self, target: RegionTarget, edges: GeneratedEdges, at: Estimate, level: Level) -> None:
        memory, config = target.memory, target.memory.config
        self.target = target
        self._count = len(edges)
        self._start = edges.points
        self.directions = edges.normals
        self.lines = CorrespondenceLines(target, edges, at)
        self._residuals, self._weights = np.zeros(self._count), np.zeros(self._count)
        gate = memory.gate
        if gate == 0.0 or len(self.lines) < 6:
            return
        is_fine = level.sigma_px <= config.fine_sigma_px
        found_px, weights = self.lines.posterior(max(1, round(0.67 * level.sigma_px)))
        ids = self.lines.ids
        if is_fine:
            found_px = found_px - memory.offsets_mm[ids] * self.lines.px_per_mm
            weights = weights * config.scatter_px**2 / (config.scatter_px**2 + memory.mean_square[ids])
            weights = weights * np.where(memory.edges.crease[ids], 1.0, config.smooth_share)
        rows = self.lines.rows
        # Along the edge points' own normals, which may point inwards.
        self._residuals[rows] = found_px * np.einsum("nj,nj->n", self.lines.outward, self.directions[rows])
        self._weights[rows] = gate * weights

    def __call__(self, edges: GeneratedEdges) -> RegionMeasurement:
        """Residuals of the lines where their points are now."""
        residuals = self._residuals - np.einsum("nj,nj->n", edges.points - self._start, self.directions)
        return RegionMeasurement(residuals, self.directions, self._weights)

    def reported_loss(self, edges: GeneratedEdges) -> float:
        """See `RegionMeasurement.loss`."""
        return self(edges).loss

    def judge(self, moved: GeneratedEdges, drawn: GeneratedEdges, at: Estimate) -> RegionJudgement:
        """What the colours say of a later estimate."""
        return RegionJudgement(drawn if len(drawn) == len(moved) else moved, self, at, self.reported_loss(moved))


@dataclass(frozen=True, eq=False)
class RegionMeasurement:
    """See `solvers.Measurement`: residuals (n,) px along directions (n, 2), weights (n,)."""

    residuals: FloatArray
    directions: FloatArray
    weights: FloatArray

    @property
    def loss(self) -> float:
        """Half the weighted squared residual, the mean over the edge points, px^2."""
        return 0.5 * float(self.weights @ self.residuals**2) / max(len(self.weights), 1)


@dataclass(frozen=True, eq=False)
class RegionJudgement:
    """See `targets.Judgement`."""

    edges: GeneratedEdges
    measure: RegionMeasure
    at: Estimate
    loss: float
    matches: None = None

    @cached_property
    def lines(self) -> CorrespondenceLines:
        """The lines at the estimate."""
        return CorrespondenceLines(self.measure.target, self.edges, self.at)

    @cached_property
    def score(self) -> float:
        """The margin of the colours."""
        return self.lines.margin()

    @property
    def quality(self) -> float:
        """The margin, in [0, 1]."""
        return max(self.score, 0.0)

    def learn(self, trusted: bool) -> None:
        """Take in colours, and where the boundary lies."""
        self.lines.learn(trusted)

    @property
    def residuals_px(self) -> FloatArray:
        """(n,) NaN: lines say where regions end, not which edge belongs to which."""
        return np.full(len(self.edges), np.nan)

    @property
    def target_view(self) -> TargetView:
        """The crop, without edges."""
        target = self.measure.target
        height, width = target.bins.shape
        return TargetView(np.zeros((0, 2)), target.origin, (width, height))


def _windows() -> tuple[FloatArray, FloatArray, float]:
    """(segments, places) weights of the segments, (places,) offsets of the places, and the variance of a clean step."""
    windows = np.zeros((_SEGMENTS, _PLACES))
    for place in range(_PLACES):
        windows[place : place + _WINDOW, place] = _STEP
    offsets: FloatArray = np.arange(_PLACES, dtype=np.float64) - 0.5 * (_PLACES - 1)
    clean = np.where(np.arange(_SEGMENTS) < 0.5 * _SEGMENTS, 3.0, -3.0) @ windows
    probability = np.exp(clean - clean.max())
    probability /= probability.sum()
    spread = offsets - probability @ offsets
    return windows, offsets, max(0.05, float(probability @ spread**2))


_WINDOWS, _OFFSETS, _LEAST_VARIANCE = _windows()
