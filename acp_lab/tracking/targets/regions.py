"""Regions: correspondence lines across the outline, on which colours say where the part ends.

Edges of a metal part's inside are many and alike; its outline is where its colours end, however blurred. On short
lines along the outward normals the log-odds of the pixels are compared with a smoothed step; the posterior over where
the step lies gives each line a residual and, by its variance, a weight (Stoiber et al., "SRT3D", 2022, and the works
cited there). Lines are those outline samples behind which there is background, which rays decide.

Where the colour boundary lies beside the CAD's outline is learnt per sample, and how steadily: before that, lines
speak at coarse levels only.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import numpy as np

from acp_lab.cad.raycast import RayCaster, caster_of
from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.errors import TrackingError
from acp_lab.generator.base import GeneratedEdges
from acp_lab.geometry.arrays import FloatArray, IntArray, plain
from acp_lab.prepared_part import PreparedPart
from acp_lab.tracking.frame_view import Estimate, FrameView
from acp_lab.tracking.learning.knowledge import SampleKnowledge
from acp_lab.tracking.learning.region_colours import ColourConfig, RegionColours
from acp_lab.tracking.result import TargetView
from acp_lab.tracking.schedule import Level
from acp_lab.tracking.targets import check_precision
from acp_lab.tracking.targets.correspondence_lines import ColourCrop, CorrespondenceLines
from acp_lab.tracking.targets.region_kernels import (
    CLEAR,
    WORST,
    expect_of_unseen,
    follow_scatter,
    free_lengths,
    keep_free,
    line_rays,
    mean_square_rest,
    outline_lines,
    weigh_lines,
)

_RAY_STEP_PX = 3.0
# Fewer lines say nothing.
_LEAST_LINES = 6
_MARGIN_RATE = 0.25


@dataclass(frozen=True)
class RegionLines:
    """Configuration: colours on lines across the outline.

    Attributes:
        lines: at most; reach_px: how far a line may look for other parts of the part; colours are learnt within.
        colours: how they are learnt.
        precision: information of a line of full weight, per squared px, at coarse levels; fine_share: of it from
            `fine_sigma_px` downwards.
        margin: difference of the mean probabilities inside and outside at which lines have no and full weight.
        scatter_px: rms residual at which a line has half weight at fine levels; unknown_px: what is assumed at first;
            calibration_rate: share of a frame in the running mean.
        smooth_share: how much more lines count at fine levels where the outline is no crease.
        fade_px: segments, of a px at the finest level, from the line's middle beyond which its posterior counts less.
        same_view_deg: how far the part may turn, as the camera sees it, until rays ask anew how far its lines are free.
        most_offset_mm: that colours may lie beside the CAD's outline.
    """

    kind: ClassVar[str] = "regions"
    searches: ClassVar[bool] = False
    learns: ClassVar[bool] = False
    in_mm: ClassVar[Mapping[str, int]] = {"most_offset_mm": 1}
    lines: int = 200
    reach_px: float = 12.0
    colours: ColourConfig = field(default_factory=ColourConfig)
    precision: float = 2.0
    fine_share: float = 0.9
    fine_sigma_px: float = 2.0
    margin: tuple[float, float] = (0.05, 0.35)
    scatter_px: float = 0.25
    unknown_px: float = 2.0
    calibration_rate: float = 0.2
    smooth_share: float = 6.0
    fade_px: float = 2.5
    same_view_deg: float = 2.0
    most_offset_mm: float = 0.6

    def __post_init__(self) -> None:
        check_precision(self.precision)
        checks = (
            ("lines", self.lines >= 6, "6 or more"),
            ("reach_px", _RAY_STEP_PX <= self.reach_px <= 1000.0, f"px from {_RAY_STEP_PX:g} to 1000"),
            ("fine_share", 0.0 <= self.fine_share <= 100.0, "0 to 100"),
            ("fine_sigma_px", 0.0 <= self.fine_sigma_px <= 1000.0, "px from 0 to 1000"),
            ("scatter_px", 0.0 < self.scatter_px <= 1000.0, "px above 0, at most 1000"),
            ("unknown_px", 0.0 <= self.unknown_px <= 1000.0, "px from 0 to 1000"),
            ("calibration_rate", 0.0 <= self.calibration_rate <= 1.0, "a share from 0 to 1"),
            ("smooth_share", 0.0 <= self.smooth_share <= 1000.0, "0 to 1000"),
            ("fade_px", 0.0 <= self.fade_px <= 1000.0, "segments from 0 to 1000"),
            ("same_view_deg", 0.0 <= self.same_view_deg <= 30.0, "degrees from 0 to 30"),
            ("most_offset_mm", 0.0 <= self.most_offset_mm < float("inf"), "mm, 0 or more"),
        )
        for name, good, wanted in checks:
            if not good:
                raise TrackingError(f"targets.{name} = {getattr(self, name):g}: give {wanted}")
        if not -1.0 <= self.margin[0] < self.margin[1] <= 1.0:
            raise TrackingError(f"targets.margin = {self.margin}: give two rising numbers from -1 to 1")

    def memory(self, model: PreparedPart) -> RegionMemory:
        """Nothing known yet."""
        return RegionMemory(self, model)

    def precision_at(self, level: Level) -> float:
        """Information of a line of full weight at a level, per squared px."""
        return self.precision * (self.fine_share if level.sigma_px <= self.fine_sigma_px else 1.0)


_SAME_DISTANCE = 0.85


@dataclass(frozen=True, eq=False)
class FreeLengths:
    """How far lines are free in one view of the part.

    to_eye_obj: (3,) mm, from the part's centre to the camera. mm: (2, n) from each edge sample to where the part ends
    inwards, and begins again outwards; NaN where nobody asked.
    """

    to_eye_obj: FloatArray
    mm: FloatArray

    def seen_along(self, to_eye_obj: FloatArray, same_view_deg: float) -> FreeLengths:
        """These, to be added to, as long as the view has turned by less, at about the same distance; else none."""
        before, now = (math.sqrt(to_eye @ to_eye) for to_eye in (self.to_eye_obj, to_eye_obj))
        turned_less = to_eye_obj @ self.to_eye_obj > before * now * math.cos(math.radians(same_view_deg))
        # Lines are asked for in px, and so for shorter lengths where the part is near.
        if turned_less and _SAME_DISTANCE * now < before < now / _SAME_DISTANCE:
            return FreeLengths(self.to_eye_obj, self.mm.copy())
        return FreeLengths(to_eye_obj, np.full_like(self.mm, np.nan))


class RegionMemory:
    """What is kept from frame to frame: colours, and where and how steadily each outline sample's boundary was found.

    off_obj: (n, 3) the sum of the two face normals of each of the part's n edge samples, off the material.
    margin: running difference of the mean probabilities inside and outside the outline.
    offsets_mm: (n,) outwards from the CAD's outline to the colours' boundary.
    mean_square: (n,) px^2, running mean of how far beside that it was found.
    known: (n,) bool, whether a sample was ever a line.
    free: how far lines are free, as it was in the last frame that was learnt from.
    """

    def __init__(self, config: RegionLines, model: PreparedPart) -> None:
        self.config = config
        self.edges = model.edges
        self.part = model.part
        self.off_obj = model.edges.off_obj
        self.colours = RegionColours(config.colours)
        self.margin = 0.0
        count = len(model.edges)
        self.offsets_mm = np.zeros(count)
        self.mean_square = np.full(count, float(config.unknown_px) ** 2)
        self.known = np.zeros(count, bool)
        self._unseen = np.flatnonzero(~model.edges.crease)
        self.free = FreeLengths(np.zeros(3), np.full((2, count), np.nan))

    @cached_property
    def caster(self) -> RayCaster:
        """Rays against the part."""
        return caster_of(self.part)

    @property
    def gate(self) -> float:
        """In [0, 1]: how much the colours may say at all."""
        low, high = self.config.margin
        return min(max((self.margin - low) / (high - low), 0.0), 1.0) if self.colours.is_known else 0.0

    def see(self, view: FrameView, knowledge: SampleKnowledge) -> RegionTarget:
        """The target of one frame."""
        return RegionTarget(view, self)

    def learn(self, lines: CorrespondenceLines, trusted: bool) -> None:
        """Take in the colours beside the lines of a solved frame, and where they find the boundary.

        trusted: the pose is exact, so that offsets can be measured.
        """
        rate = _MARGIN_RATE if self.colours.is_known else 1.0
        self.colours.learn(*lines.bins_beside(self.config.colours.reach_px))
        self.margin += rate * (lines.margin() - self.margin)
        if len(lines) >= _LEAST_LINES:
            self._calibrate(lines, trusted)

    def _calibrate(self, lines: CorrespondenceLines, trusted: bool) -> None:
        ids, seen = lines.ids, lines.in_image
        found_px, weights = lines.posterior(1, self.config.fade_px)
        if trusted:
            near = seen & (weights > CLEAR) & (np.abs(found_px) < 3.0)
            most_mm = self.config.most_offset_mm
            offsets = np.clip(0.8 * found_px / lines.px_per_mm, -most_mm, most_mm)
            # What was not seen lies, for all that is known, half as far as the others.
            self.offsets_mm[:] = 0.5 * np.median(offsets[near]) if near.sum() > 10 else 0.0
            self.offsets_mm[ids[near]] = offsets[near]
            self.mean_square[ids[seen]] = np.where(near[seen], 0.5, WORST)
        else:
            follow_scatter(
                ids, seen, found_px, weights, lines.px_per_mm, self.offsets_mm, self.known,
                self.config.calibration_rate, self.mean_square,
            )  # fmt: skip
        ids = ids[seen]
        smooth = ids[~self.edges.crease[ids]]
        known = int(np.count_nonzero(self.known[smooth]))
        self.known[ids] = True
        if len(smooth) >= _LEAST_LINES:
            self._expect_of_new(smooth, known / len(smooth))

    def _expect_of_new(self, smooth: IntArray, known_share: float) -> None:
        """How steadily samples of smooth outlines that were no line yet will be found.

        smooth: ids of a frame's lines on such outlines; known_share: how many of them were lines before. A smooth
        outline wanders over a part that turns, so that hardly a line stays for long enough to become known. The more of
        a frame's are new, the more is expected of others what these showed.
        """
        unknown = self.config.unknown_px**2
        typical = min(float(np.sort(self.mean_square[smooth])[len(smooth) // 2]), unknown)
        expected = typical ** (1.0 - known_share) * unknown**known_share
        self._unseen = self._unseen[: expect_of_unseen(self._unseen, self.known, expected, self.mean_square)]


class RegionTarget:
    """The colours of one frame around the part."""

    def __init__(self, view: FrameView, memory: RegionMemory) -> None:
        self.crop = ColourCrop(view.image, view.box, memory.colours)
        self.memory = memory
        to_eye_obj = eye_position(view.prior) - memory.part.box_centre
        self.free = memory.free.seen_along(to_eye_obj, memory.config.same_view_deg)

    def bind(self, edges: GeneratedEdges, at: Estimate, level: Level) -> RegionMeasure:
        """The measure of one level."""
        return RegionMeasure(self, edges, at, level)

    def agreement(self, edges: GeneratedEdges, at: Estimate, level: Level, sigma_px: float) -> float:
        """The margin of the colours at an estimate."""
        return self.lines(edges, at).margin()

    def lines(self, edges: GeneratedEdges, at: Estimate) -> CorrespondenceLines:
        """Across the outline at an estimate with its edge points: those with part inside and background outside."""
        memory, most = self.memory, min(self.memory.config.lines, len(edges))
        rows, ids = np.empty((2, most), np.int64)
        (points, outward), px_per_mm = np.empty((2, most, 2)), np.empty(most)
        count = outline_lines(
            edges.outline, np.ascontiguousarray(edges.sample_ids), plain(edges.points), plain(edges.normals),
            plain(at.cam_T_obj), at.view.camera.numbers, memory.edges.points_obj, memory.off_obj, rows, ids, points,
            outward, px_per_mm,
        )  # fmt: skip
        self._cast(ids[:count], points, outward, px_per_mm, at)
        free = np.empty((2, count))
        count = keep_free(self.free.mm, rows[:count], ids[:count], points, outward, px_per_mm, free)
        if at.view.readout is not None:
            points[:count] = at.read_places(points[:count], memory.edges.points_obj[ids[:count]])
        return CorrespondenceLines(
            self.crop, rows[:count], ids[:count], points[:count], outward[:count], free[:, :count], px_per_mm[:count]
        )

    def _cast(
        self, ids: IntArray, points: FloatArray, outward: FloatArray, px_per_mm: FloatArray, at: Estimate
    ) -> None:
        """How far it is from outline samples to where the part ends inwards, and begins again outwards.

        At most `reach_px`; 0 where there is no part inside or no background outside. By rays, once per view and
        sample: a pose that is refined, or a part that moves on without turning, changes it little.
        """
        asked = np.flatnonzero(np.isnan(self.free.mm[0].take(ids)))
        if not len(asked):
            return
        reach = np.arange(_RAY_STEP_PX, self.memory.config.reach_px + 0.1, _RAY_STEP_PX)
        rays_of_lines = np.empty((len(asked), 2 * len(reach), 3))
        pose = plain(at.cam_T_obj)
        line_rays(asked, points, outward, pose, at.view.camera.numbers, np.concatenate([-reach, reach]), rays_of_lines)
        rays_obj = rays_of_lines.reshape(-1, 3)
        eyes = np.empty_like(rays_obj)
        eyes[:] = eye_position(pose)
        hit = self.memory.caster.occluded(eyes, rays_obj, 1e9).reshape(len(asked), 2, len(reach))
        free_lengths(ids[asked], hit, _RAY_STEP_PX / px_per_mm[asked], self.free.mm)


class RegionMeasure:
    """Where colours say that the part ends, for the lines of one level.

    directions: (n, 2) unit, the normals of the level's n edge points. residuals: (n,) px along these at the level's
    start; weights: (n,), 0 for those that are no lines.
    """

    def __init__(self, target: RegionTarget, edges: GeneratedEdges, at: Estimate, level: Level) -> None:
        memory, config = target.memory, target.memory.config
        self.target = target
        self._count = len(edges)
        self._start = edges.points
        self.directions = edges.normals
        self.lines = target.lines(edges, at)
        self.residuals, self.weights = np.zeros(self._count), np.zeros(self._count)
        gate = memory.gate
        if gate == 0.0 or len(self.lines) < _LEAST_LINES:
            return
        is_fine = level.sigma_px <= config.fine_sigma_px
        lines = self.lines
        found = lines.posterior(max(1, round(0.67 * level.sigma_px)), config.fade_px)
        weigh_lines(
            gate, is_fine, config.scatter_px, config.smooth_share, found, lines.rows, lines.ids, lines.outward,
            lines.px_per_mm, memory.offsets_mm, memory.mean_square, memory.edges.crease, self.directions,
            self.residuals, self.weights,
        )  # fmt: skip

    def __call__(self, edges: GeneratedEdges) -> RegionMeasurement:
        """Residuals of the lines where their points are now."""
        residuals = self.residuals - np.einsum("nj,nj->n", edges.points - self._start, self.directions)
        return RegionMeasurement(residuals, self.directions, self.weights)

    def reported_loss(self, edges: GeneratedEdges) -> float:
        """See `RegionMeasurement.loss`."""
        return mean_square_rest(
            self.residuals, self.weights, plain(self._start), plain(edges.points), plain(self.directions)
        )

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
        return self.measure.target.lines(self.edges, self.at)

    @cached_property
    def score(self) -> float:
        """The margin of the colours."""
        return self.lines.margin()

    @property
    def quality(self) -> float:
        """The margin where it is above 0."""
        return max(self.score, 0.0)

    def learn(self, trusted: bool) -> None:
        """Take in colours, where the boundary lies, and how far lines are free."""
        target = self.measure.target
        target.memory.learn(self.lines, trusted)
        target.memory.free = target.free

    @property
    def residuals_px(self) -> FloatArray:
        """(n,) NaN: lines say where regions end, not which edge belongs to which."""
        return np.full(len(self.edges), np.nan)

    @property
    def target_view(self) -> TargetView:
        """The crop, without edges."""
        target = self.measure.target
        height, width, _ = target.crop.pixels.shape
        return TargetView(np.zeros((0, 2)), target.crop.origin, (width, height))
