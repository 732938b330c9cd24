"""Image edges searched along the normals of the generated edges, softly assigned.

Each generated edge point reads the image along its normal and keeps the strongest image edges as candidates; what
was learnt of its 3D sample says which of them it may be, and where it lies beside the CAD's edge. (Deviation from
paper IV-B, whose distance map attracts an edge point to whatever edge is nearest.)
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar, Literal

import numpy as np

from acp_lab.compiled import kernel
from acp_lab.errors import TrackingError
from acp_lab.generator.base import GeneratedEdges
from acp_lab.geometry.arrays import BoolArray, FloatArray, IntArray, plain
from acp_lab.geometry.in_image import in_image
from acp_lab.imaging.edge_search import Candidates, ImagePatch, SearchConfig, image_patch, search_along_normals
from acp_lab.prepared_part import PreparedPart
from acp_lab.tracking.frame_view import Estimate, FrameView
from acp_lab.tracking.learning.knowledge import Matches, Off, SampleKnowledge
from acp_lab.tracking.result import TargetView
from acp_lab.tracking.schedule import Level
from acp_lab.tracking.targets import QUALITY_SIGMA_PX, check_precision
from acp_lab.tracking.targets.shared_edges import EdgeSharing
from acp_lab.tracking.targets.soft_assignment import (
    Assignment,
    mixture_loss,
    negative_log_likelihood,
    robust_loss,
    soft_assignment,
)

# The search has whole pixels; a narrower capture range would only pick among their rounding errors.
_LEAST_SIGMA_PX = 1.0
# For judging edges that were never searched from: just beyond the px that still count as found.
_JUDGE_LEVEL = Level(5, QUALITY_SIGMA_PX)
_FOUND, _SURELY_FOUND = 0.02, 0.1
# Where chance alone would find edges: near, but not where those of a right pose still count.
_BESIDE_PX = 2.5
# Were fewer edge points asked, a pose that leads out of the image would fit by the last few that are left in it.
_LEAST_SHOWN = 0.25


@dataclass(frozen=True)
class NormalSearch:
    """Configuration: image edges along the normals.

    Attributes:
        search: how candidates are found.
        bind: search once per "level", at its start, or at every "step".
        outlier: mass of "no image edge belongs here" in the soft assignment.
        min_score: candidates below it are noise.
        plain_share: how much of the score by which poses are compared leaves out what the memory says.
        precision: information of an edge point of full weight, per squared px; how much this measure counts beside
            others and beside a motion prior.
        sharing: how an image edge is shared out among the samples that may own it, where they are remembered.
    """

    kind: ClassVar[str] = "normals"
    searches: ClassVar[bool] = True
    learns: ClassVar[bool] = False
    search: SearchConfig = field(default_factory=SearchConfig)
    bind: Literal["level", "step"] = "level"
    outlier: float = 0.5
    min_score: float = 0.02
    plain_share: float = 0.3
    precision: float = 6.0
    sharing: EdgeSharing | Off = field(default_factory=EdgeSharing)

    def __post_init__(self) -> None:
        check_precision(self.precision)
        if not self.outlier > 0.0:
            raise TrackingError(f"targets.outlier = {self.outlier:g}: give a mass above 0")
        if not 0.0 <= self.min_score < 1.0:
            raise TrackingError(f"targets.min_score = {self.min_score:g}: give a score from 0 to 1")
        if not 0.0 <= self.plain_share <= 1.0:
            raise TrackingError(f"targets.plain_share = {self.plain_share:g}: give a share from 0 to 1")

    def memory(self, model: PreparedPart) -> NormalSearch:
        """What is kept from frame to frame is the method's `SampleKnowledge`."""
        return self

    def precision_at(self, level: Level) -> float:
        """Information of an edge point of full weight at a level, per squared px."""
        return self.precision * level.edge_share

    def see(self, view: FrameView, knowledge: SampleKnowledge) -> NormalTarget:
        """The target of one frame."""
        search = self.search if knowledge.gamma is None else replace(self.search, gamma=knowledge.gamma)
        patch = image_patch(view.image, view.edge_box, search, knowledge.lens_blur_px)
        return NormalTarget(patch, self, knowledge)


class NormalTarget:
    """The gradients of one frame around the part, to be searched."""

    def __init__(self, patch: ImagePatch, config: NormalSearch, knowledge: SampleKnowledge) -> None:
        self.patch = patch
        self.config = config
        self.knowledge = knowledge

    def bind(self, edges: GeneratedEdges, at: Estimate, level: Level) -> NormalMeasure | RepeatedSearch:
        """The measure of one level, or one that searches at every step."""
        if self.config.bind == "step":
            return RepeatedSearch(self, at, level)
        return self.search(edges, at, level)

    def search(self, edges: GeneratedEdges, at: Estimate, level: Level, use_memory: bool = True) -> NormalMeasure:
        """The candidates of edge points generated at an estimate."""
        return NormalMeasure(self, edges, at, level, use_memory)

    def agreement(self, edges: GeneratedEdges, at: Estimate, level: Level, sigma_px: float) -> float:
        """Mean over the edge points of the best candidate's score times its nearness."""
        return self.search(edges, at, level, use_memory=False).agreement(sigma_px)


class NormalMeasure:
    """Candidates of one level's edge points.

    Attributes:
        at: the estimate that was searched from.
        edges: its n points; points (n, 2) px and normals (n, 2) unit are theirs; places (n, 2) px are where the picture
            shows them, elsewhere where it was read while the part moved.
        candidates: image edges along the normals.
        scores: (n, m) their scores after the memory had its say.
        targets: (n, m) px along the normal from the point to where the candidate says it belongs, its expected
            offset taken off.
        expected: those offsets, None where they are not learnt.
        trust: (n,) of each sample.
        sigma_px, outlier: of the soft assignment.
    """

    def __init__(
        self, target: NormalTarget, edges: GeneratedEdges, at: Estimate, level: Level, use_memory: bool
    ) -> None:
        config, knowledge = target.config, target.knowledge
        self._target = target
        self.sigma_px = max(level.sigma_px, _LEAST_SIGMA_PX)
        self.outlier = config.outlier
        self.at, self.edges, self.points, self.normals = at, edges, edges.points, edges.normals
        self.places = self.points if at.view.readout is None else at.read_places(self.points, self.points_obj)
        blur_px = knowledge.blur_px(edges, self.normals, at)
        self.candidates: Candidates = search_along_normals(
            target.patch, self.places, self.normals, level.reach_px, config.search, blur_px
        )
        scores = self.candidates.scores
        if use_memory:
            scores = knowledge.agreement(edges.sample_ids, self.candidates, scores)
        self.shifts = knowledge.read_profiles(
            target.patch, self.places, edges, self.normals, self.candidates, at, self.sigma_px, config.min_score,
            blur_px,
        )  # fmt: skip
        scatter_px, offsets = None, self.candidates.offsets
        if self.shifts is not None:
            offsets = offsets + self.shifts.shifts_px
            scatter_px = self.shifts.spread_of_best(scores, offsets, self.sigma_px)
        self.expected = knowledge.expect(edges, self.normals, at, scatter_px)
        expected_px = np.zeros(len(edges)) if self.expected is None else self.expected.offsets_px
        self.scores, self.targets = np.empty((2, *scores.shape))
        _place(
            offsets, self.candidates.gradients, scores, plain(edges.weights), edges.outline,
            expected_px, knowledge.shift_px, config.min_score, self.scores, self.targets,
        )  # fmt: skip
        if use_memory:
            self._share_out(offsets, level)
        trust = knowledge.trust(edges, self.expected, self.sigma_px)
        self.trust: FloatArray = np.ones(len(edges)) if trust is None else trust

    def _share_out(self, offsets: FloatArray, level: Level) -> None:
        """Leave each sample its share of its candidates, where any sample is known.

        offsets: (n, m) px from the generated points to where the candidates' profiles say that the CAD's edge lies; the
        samples' expected offsets are not taken off.
        """
        sharing, memory, ids = self._target.config.sharing, self.knowledge.memory, self.edges.sample_ids
        if isinstance(sharing, Off) or memory is None or not (known := memory.known[ids]).any():
            return
        jacobian = self.at.lines(self.points_obj, self.normals).jacobian
        self.scores = sharing.share_out(
            self.scores, offsets, self.places, self.normals, known, level, jacobian, self.at.view.prior_covariance
        )

    @property
    def knowledge(self) -> SampleKnowledge:
        """What is known of the samples."""
        return self._target.knowledge

    @property
    def patch(self) -> ImagePatch:
        """The image that was searched."""
        return self._target.patch

    @property
    def plain_share(self) -> float:
        """See `NormalSearch`."""
        return self._target.config.plain_share

    def shown(self, edges: GeneratedEdges) -> float:
        """Share of edge points that the image can show; a quarter, where it is less. Means are over these."""
        inside = in_image(edges.points, self.at.view.camera)
        return max(np.count_nonzero(inside) / max(len(inside), 1), _LEAST_SHOWN)

    def plain_quality(self, distances: FloatArray, shift_px: float = 0.0) -> float:
        """The quality of distances (n, m) px, less a shift, to the candidates, whatever the memory says of these."""
        return float(_mean_nearness(self.candidates.scores, self.edges.weights, distances, shift_px, QUALITY_SIGMA_PX))

    @property
    def points_obj(self) -> FloatArray:
        """(n, 3) mm: the 3D samples of the edge points, where these are known."""
        points_obj: FloatArray = self._target.knowledge.edges.points_obj.take(self.edges.sample_ids, axis=0)
        return points_obj

    def distances(self, edges: GeneratedEdges) -> FloatArray:
        """(n, m) px along the normals from the points where they are now to where the candidates say."""
        found = np.empty_like(self.targets)
        _distances(self.targets, plain(self.points), plain(self.normals), plain(edges.points), found)
        return found

    def __call__(self, edges: GeneratedEdges) -> NormalMeasurement:
        """What the candidates say about the points where they are now."""
        distances = self.distances(edges)
        assigned = soft_assignment(distances, self.scores, self.sigma_px, self.outlier)
        return NormalMeasurement(assigned, self.normals, self.trust, self.sigma_px, self.outlier)

    def reported_loss(self, edges: GeneratedEdges) -> float:
        """e with one width for all levels, so that they can be compared."""
        return robust_loss(self.distances(edges), self.scores, QUALITY_SIGMA_PX, self.outlier)

    def agreement(self, sigma_px: float) -> float:
        """In [0, 1]: mean over the points of the best candidate's score times its nearness, without moving them.

        Of points beyond the image nothing can be found, and that says nothing against the estimate.
        """
        found = (self.scores * np.exp(-0.5 * (self.targets / sigma_px) ** 2)).max(1)
        return min(float(found.mean()) / self.shown(self.edges), 1.0)

    def judge(self, moved: GeneratedEdges, drawn: GeneratedEdges, at: Estimate) -> NormalJudgement:
        """What the candidates say about the level's points where its motion put them."""
        distances, count = self.distances(moved), len(moved)
        best, found, mass = np.empty(count, np.int64), np.empty(count), np.empty(count)
        _best_candidates(self.scores, distances, QUALITY_SIGMA_PX, best, found, mass)
        # Edges that were painted anew are other points than those that were searched from.
        edges = drawn if len(drawn) == len(moved) else moved
        return NormalJudgement(edges, self, distances, best, found, mixture_loss(mass, self.outlier))

    def target_view(self) -> TargetView:
        """The image edges that were found."""
        rows, columns = np.nonzero(self.candidates.scores > self._target.config.min_score)
        offsets = self.candidates.offsets[rows, columns]
        height, width = self._target.patch.channels.shape[:2]
        points = self.places[rows] + offsets[:, None] * self.normals[rows]
        return TargetView(points, self._target.patch.origin, (width, height))


@kernel(
    "void(f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[::1], b1[::1], f8[::1], f8, f8, f8[:, ::1], f8[:, ::1])",
)
def _place(
    offsets: FloatArray, gradients: FloatArray, scores: FloatArray, weights: FloatArray, outline: BoolArray,
    expected_px: FloatArray, shift_px: float, min_score: float, weighed: FloatArray, targets: FloatArray,
) -> None:  # fmt: skip
    """Fill weighed and targets (n, m), the scores and targets of a `NormalMeasure`.

    offsets, gradients, scores: (n, m) of the candidates; weights, outline, expected_px: (n,) of the edge points;
    shift_px: by which outlines lie to their bright side.
    """
    for i in range(len(offsets)):
        for k in range(offsets.shape[1]):
            weighed[i, k] = scores[i, k] * weights[i] if scores[i, k] > min_score else 0.0
            targets[i, k] = offsets[i, k] - expected_px[i]
            if outline[i]:
                targets[i, k] -= shift_px * np.sign(gradients[i, k])


@kernel("void(f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, ::1])")
def _distances(
    targets: FloatArray, start: FloatArray, normals: FloatArray, points: FloatArray, found: FloatArray
) -> None:  # fmt: skip
    """Fill found (n, m): what is left of targets (n, m) px when points have moved from start; both (n, 2)."""
    for i in range(len(targets)):
        moved = (points[i, 0] - start[i, 0]) * normals[i, 0] + (points[i, 1] - start[i, 1]) * normals[i, 1]
        for k in range(targets.shape[1]):
            found[i, k] = targets[i, k] - moved


@kernel("f8(f8[:, ::1], f8[::1], f8[:, ::1], f8, f8)")
def _mean_nearness(
    scores: FloatArray, weights: FloatArray, distances: FloatArray, shift_px: float, sigma_px: float
) -> float:
    """Mean over n points, of weights (n,), of their best candidate's score times its nearness; 0 without points."""
    total, narrow = 0.0, -0.5 / (sigma_px * sigma_px)
    for i in range(len(scores)):
        best = 0.0
        for k in range(scores.shape[1]):
            if scores[i, k] > best:
                distance = distances[i, k] - shift_px
                best = max(best, scores[i, k] * np.exp(narrow * distance * distance))
        total += weights[i] * best
    return total / max(len(scores), 1)


@kernel("void(f8[:, ::1], i8[::1], f8[::1], f8, f8[::1])")
def _residuals(distances: FloatArray, best: IntArray, found: FloatArray, above: float, residuals: FloatArray) -> None:
    """Fill residuals (n,): distances (n, m) in the columns `best` (n,), NaN where `found` (n,) is not above a limit."""
    for i in range(len(best)):
        residuals[i] = distances[i, best[i]] if found[i] > above else np.nan


@kernel("void(f8[:, ::1], f8[:, ::1], f8, i8[::1], f8[::1], f8[::1])")
def _best_candidates(
    scores: FloatArray, distances: FloatArray, sigma_px: float, best: np.ndarray, found: FloatArray, mass: FloatArray
) -> None:
    """Fill best (n,), the column of each point's best candidate, found, its score times its nearness, and their sum."""
    narrow = -0.5 / (sigma_px * sigma_px)
    for i in range(len(scores)):
        best[i], found[i], mass[i] = 0, 0.0, 0.0
        for k in range(scores.shape[1]):
            if scores[i, k] == 0.0:
                continue
            fit = scores[i, k] * np.exp(narrow * distances[i, k] * distances[i, k])
            mass[i] += fit
            if fit > found[i]:
                best[i], found[i] = k, fit


class RepeatedSearch:
    """A measure that searches anew from wherever the points are."""

    def __init__(self, target: NormalTarget, at: Estimate, level: Level) -> None:
        self._target = target
        self._at = at
        self._level = level

    def __call__(self, edges: GeneratedEdges) -> NormalMeasurement:
        """What the image says about edge points."""
        return self._target.search(edges, self._at, self._level)(edges)

    def reported_loss(self, edges: GeneratedEdges) -> float:
        """e with one width for all levels."""
        return self._target.search(edges, self._at, self._level).reported_loss(edges)

    def judge(self, moved: GeneratedEdges, drawn: GeneratedEdges, at: Estimate) -> NormalJudgement:
        """What a new search at the estimate's own edges says."""
        return self._target.search(drawn, at, _JUDGE_LEVEL).judge(drawn, drawn, at)


@dataclass(frozen=True, eq=False)
class NormalMeasurement:
    """See `solvers.Measurement`; trust: (n,) of each sample."""

    assigned: Assignment
    directions: FloatArray
    trust: FloatArray
    sigma_px: float
    outlier: float

    @property
    def residuals(self) -> FloatArray:
        """(n,) px still to go along the normals."""
        return self.assigned.residuals

    @property
    def weights(self) -> FloatArray:
        """(n,) of the least squares."""
        return self.assigned.weights * self.trust

    @property
    def loss(self) -> float:
        """e of the level, in px^2; as one of n points moves along its normal the slope is -weight residual / n."""
        return self.sigma_px**2 * negative_log_likelihood(self.assigned.mass, self.trust, self.outlier)


@dataclass(frozen=True, eq=False)
class NormalJudgement:
    """See `targets.Judgement`.

    Attributes:
        measure: whose candidates decided.
        distances: (n, m) px from each point to its candidates.
        best: (n,) column of the candidate that fits best.
        found: (n,) in [0, 1], its score times its nearness.
        loss: e with one width for all levels, so that they can be compared.
    """

    edges: GeneratedEdges
    measure: NormalMeasure
    distances: FloatArray
    best: np.ndarray
    found: FloatArray
    loss: float

    @cached_property
    def quality(self) -> float:
        """In [0, 1]: mean of `found` over the points that the image can show; 0 without points."""
        return min(float(self.found.mean()) / self._shown, 1.0) if len(self.found) else 0.0

    @cached_property
    def score(self) -> float:
        """The quality, for a share without what the memory says."""
        share = self.measure.plain_share
        return (1.0 - share) * self.quality + (share * self._plain_quality if share else 0.0)

    @cached_property
    def _plain_quality(self) -> float:
        return self._plain_quality_beside(0.0)

    def _plain_quality_beside(self, shift_px: float) -> float:
        return self.measure.plain_quality(self.distances, shift_px) / self._shown

    @cached_property
    def _shown(self) -> float:
        return self.measure.shown(self.edges)

    @cached_property
    def contrast(self) -> float:
        """In [-1, 1]: how many more image edges are at the points than beside them, whatever the memory says."""
        beside = 0.5 * (self._plain_quality_beside(_BESIDE_PX) + self._plain_quality_beside(-_BESIDE_PX))
        return self._plain_quality - beside

    def learn(self, trusted: bool) -> None:
        """What was learnt goes into the method's `SampleKnowledge`."""
        matches = self.matches
        if matches is not None:
            self.measure.knowledge.learn(matches)

    @cached_property
    def residuals_px(self) -> FloatArray:
        """(n,) px to the best candidate, NaN where none was found."""
        return self.residuals_above(_FOUND)

    def residuals_above(self, found: float) -> FloatArray:
        """(n,) px to the best candidate, NaN where `found` is not above a limit."""
        residuals = np.empty(len(self.best))
        _residuals(self.distances, self.best, self.found, found, residuals)
        return residuals

    @property
    def target_view(self) -> TargetView:
        """The image edges that were found, whatever the memory said of them."""
        return self.measure.target_view()

    @property
    def matches(self) -> Matches | None:
        """For those who learn; None where the edge points are no known samples."""
        measure = self.measure
        ids = measure.edges.sample_ids
        if (ids < 0).any():
            return None
        return Matches(
            measure.at,
            measure.points_obj,
            measure.edges,
            measure.normals,
            measure.candidates,
            self.best,
            self.residuals_px,
            self.residuals_above(_SURELY_FOUND),
            measure.expected,
            measure.knowledge.edges.off_obj.take(ids, axis=0),
            measure.patch,
            measure.places,
            measure.shifts,
        )
