"""Why did the tracker do badly in a frame? Causes in plain language, each from a measurement.

`diagnose(run, frame)` looks at the run around the frame and at its images. Every cause has a measured quantity and
a limit (`causes`). Causes beyond their limit are named, the worst first, with the setting that helps. Where the truth
is known, the image is measured at the true pose: there it must show the part's edges, wherever the tracker believed
the part to be. Several causes may apply at once, or none.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise, takewhile

import numpy as np

from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.control_points.view_regions import REGION_NAMES, region_scores
from acp_lab.diagnosis import causes
from acp_lab.diagnosis.causes import Cause, DiagnosisConfig, Finding
from acp_lab.diagnosis.frame_evidence import EdgeEvidence, PartObserver, image_motion
from acp_lab.errors import SequenceError
from acp_lab.evaluation import PartMetric, closest_truth, metric_name
from acp_lab.geometry.arrays import BoolArray, ByteImage, FloatArray
from acp_lab.geometry.homography import corner_areas, extent
from acp_lab.geometry.pose import transform
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.sequences.protocol import Sequence
from acp_lab.tracking.confidence import weight_of_evidence
from acp_lab.tracking.result import EXACT, TrackResult, TrackState
from acp_lab.tracking.session import TrackRun, check_run

ELSEWHERE_PERCENT = 10.0
"""ADD in percent of the diameter above which a pose is beside the part."""
MOST_VERTICES = 2000
"""Enough to tell whether a pose is beside the part, in every frame of a run."""
LOOK_BACK = 6
"""The frame to compare with is one of so many before the problem."""


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """The diagnosis of one object in one frame. Prints as text.

    Attributes:
        run_name, object_id: which run and object; frame: counted from 0; frame_id: the image id.
        state, quality: of the result; usual_quality: upper quartile over the frames tracked until then.
        has_good_before: whether there is a good frame before this one.
        onset: the first frame of the bad stretch that `frame` belongs to; `frame` itself when it is good.
        findings: the worst first.
        metric: "ADD", or "ADD-S" for a part with symmetries.
        add_percent: that of the tracked pose in percent of the diameter, NaN where truth is unknown.
        result: of the tracker in `frame`.
        measured_frame: whose image was measured: `frame`, or `onset` where the tracked pose is lost and truth unknown.
        image: (h, w, 3) of that frame, None where it cannot be had.
        evidence: what it shows at `measured_at`, "the true pose" or "the tracked pose"; found_limit: share of found
            edges below which they are few.
        hidden: (n,) bool, which of the evidence's edge points are missing in one connected region; none in a good
            frame without one to compare with.
        lost_since: the first frame of the lost stretch that `frame` belongs to; None where it is not lost.
    """

    run_name: str
    object_id: int
    frame: int
    frame_id: int
    state: TrackState
    quality: float
    usual_quality: float
    onset: int
    findings: tuple[Finding, ...]
    metric: str
    add_percent: float
    result: TrackResult
    measured_frame: int
    image: ByteImage | None = None
    evidence: EdgeEvidence | None = None
    measured_at: str = ""
    hidden: BoolArray = field(default_factory=lambda: np.zeros(0, bool))
    found_limit: float = DiagnosisConfig.found_share
    lost_since: int | None = None
    has_good_before: bool = True

    @property
    def is_good(self) -> bool:
        """Whether the frame itself was tracked well, as far as is known, and no cause is named."""
        return self._has_good_quality and not self.is_beside and not self.findings

    @property
    def is_beside(self) -> bool:
        """Whether the truth is known and the tracked pose is beside the part, whatever its quality."""
        return self.add_percent > ELSEWHERE_PERCENT

    @property
    def _has_good_quality(self) -> bool:
        return self.state is TrackState.TRACKING and self.onset == self.frame

    @property
    def causes(self) -> tuple[Cause, ...]:
        """The causes, the worst first."""
        return tuple(finding.cause for finding in self.findings)

    @property
    def summary(self) -> str:
        """The state of the frame, in one line."""
        text = f"Frame {self.frame} (image {self.frame_id}), object {self.object_id}: {self.state}, "
        usual = f"{self.usual_quality:.2f} in the good frames" if self.has_good_before else "no good frame"
        text += f"quality {self.quality:.2f}, {usual} before it"
        if math.isfinite(self.add_percent):
            text += f", {self.metric} {self.add_percent:.1f}% of the diameter"
        text += "."
        if self.result.exactness < EXACT:
            text += f" What is seen fixes its pose poorly: exactness {self.result.exactness:.2f}."
        if self.onset < self.frame:
            text += f" The problem began in frame {self.onset}."
        if self.lost_since is not None:
            text += f" Lost since frame {self.lost_since}"
            text += "." if self.result.sought is None else f"; {self.result.sought}."
        return text

    @property
    def conclusion(self) -> str:
        """What is said when no cause is named. Never that all is well: nothing measured here can show that."""
        if self.is_beside:
            words = [
                "The tracked pose is beside the part.",
                f"It is off by {self.add_percent:.1f}% of the diameter ({self.metric}), and no known cause stands out.",
            ]
            if self._has_good_quality:
                words.append("The quality does not show it.")
            return " ".join([*words, *self._edges_found()])
        if not self.is_good:
            return "No known cause stands out."
        words = ["Nothing stands out."]
        if self.has_good_before and self.usual_quality > 0.0:
            change = round(100.0 * (self.quality / self.usual_quality - 1.0))
            than = f"{abs(change)}% {'above' if change > 0 else 'below'}" if change else "as in"
            words.append(f"The quality is {than} the good frames before it.")
        words += self._edges_found()
        words.append("Neither would reveal a pose that drifts slowly or was wrong from the start.")
        return " ".join(words)

    def _edges_found(self) -> list[str]:
        """A sentence on the share of edges that the image shows; none without an image."""
        if self.evidence is None:
            return []
        share, limit = self.evidence.found_share, self.found_limit
        told = f"{100.0 * share:.0f}% of the edges in view are found in the image"
        if self.is_beside:
            told += f" at {self.measured_at}, which says nothing of the tracked one"
        # Fewer are no cause where something hides the others.
        hidden = f", {100.0 * float(self.hidden.mean()):.0f}% are hidden" if self.hidden.any() else ""
        return [f"{told} (few: below {100.0 * limit:.0f}%)." if share >= limit else f"{told}{hidden}."]

    def __str__(self) -> str:
        lines = [self.summary]
        for number, finding in enumerate(self.findings, 1):
            lines += [f"{number}. {finding.cause}: {finding.text}", f"   What helps: {finding.advice}"]
        return "\n".join(lines if self.findings else [*lines, self.conclusion])


def diagnose(
    run: TrackRun,
    frame: int,
    object_id: int | None = None,
    sequence: Sequence | None = None,
    config: DiagnosisConfig | None = None,
) -> Diagnosis:
    """Explain what the tracker did in a frame.

    Args:
        frame: counted from 0, as viewers count; negative ones from the end.
        object_id: by default the run's first object.
        sequence: where the images are, by default the one that was tracked; without images only the run is examined.

    Raises:
        SequenceError: the run has no such frame or object, or does not know its part.
    """
    check_run(run)
    if not isinstance(frame, int | np.integer):
        raise SequenceError(f"frame {frame!r}: is no number: frames are counted from 0, -1 is the last")
    results, object_id = _results_of(run, frame, object_id)
    frame = range(len(results))[frame]
    config = config or DiagnosisConfig()
    usual, onset = _history(results, frame, config)
    good = _reference(results, onset)
    frames = _frames(sequence or run.sequence, results, {0, good, *range(max(onset - 1, 0), frame + 1)})
    return _Case(run, object_id, results, frame, onset, good, usual, frames, config).diagnosis()


def first_beside(run: TrackRun, object_id: int) -> int | None:
    """The first frame, counted from 0, whose pose is beside the part; None for none, and where truth is unknown."""
    session = run.session
    if session is None or session.truth is None or object_id not in run.parts:
        return None
    metric = PartMetric(run.parts[object_id], most_vertices=MOST_VERTICES)
    for number, result in enumerate(run.results[object_id]):
        truth = session.truth(result.frame_id, object_id)
        if metric.percent(result.cam_T_obj, truth) > ELSEWHERE_PERCENT:  # False where the truth is unknown
            return number
    return None


def _results_of(run: TrackRun, frame: int, object_id: int | None) -> tuple[tuple[TrackResult, ...], int]:
    tracked = [one for one, results in run.results.items() if results]
    if not tracked:
        raise SequenceError(f"{run.name}: has no results: give a run that tracked at least one frame")
    object_id = tracked[0] if object_id is None else object_id
    if object_id not in tracked:
        raise SequenceError(f"{run.name}: object {object_id} was not tracked: there are {sorted(tracked)}")
    results = run.results[object_id]
    if not -len(results) <= frame < len(results):
        raise SequenceError(f"{run.name}: no frame {frame}: there are {len(results)}, counted from 0")
    if object_id not in run.parts:
        raise SequenceError(f"{run.name}: the run does not know its parts: take one that Tracker.run returned")
    return results, object_id


def _history(results: tuple[TrackResult, ...], frame: int, config: DiagnosisConfig) -> tuple[float, int]:
    """The usual quality before `frame`, and the first frame of the bad stretch that it belongs to."""
    tracked = [r.quality for r in results[: frame + 1] if r.state is TrackState.TRACKING and r.quality > 0.0]
    # The upper quartile: a long bad stretch must not become the norm.
    usual = float(np.percentile(tracked, 75)) if tracked else results[0].quality
    onset = frame
    while onset >= 0 and not _is_good(results[onset], usual, config):
        onset -= 1
    return usual, min(onset + 1, frame)


def _reference(results: tuple[TrackResult, ...], onset: int) -> int:
    """A frame to compare with: the best one shortly before the problem, which may have begun gradually; -1 for none."""
    before = range(max(onset - LOOK_BACK, 0), onset)
    return max(before, key=lambda number: results[number].quality, default=-1)


def _is_good(result: TrackResult, usual: float, config: DiagnosisConfig) -> bool:
    least = config.good_evidence * weight_of_evidence(usual)
    return result.state is TrackState.TRACKING and weight_of_evidence(result.quality) >= least


def _frames(
    sequence: Sequence | None, results: tuple[TrackResult, ...], wanted: set[int]
) -> dict[int, Frame | UnreadableFrame]:
    """Frames by the count of their results, which need not cover the sequence; none of a live camera, which cannot
    repeat them."""
    if sequence is None or not sequence.frame_ids:
        return {}
    numbers = {results[number].frame_id: number for number in wanted if 0 <= number < len(results)}
    read = getattr(sequence, "frame", None)
    if read is not None:  # a data set: any image by its id
        return {numbers[frame_id]: read(frame_id) for frame_id in numbers.keys() & set(sequence.frame_ids)}
    passing = takewhile(lambda frame: frame.index <= max(numbers), sequence.frames())
    return {numbers[frame.index]: frame for frame in passing if frame.index in numbers}


class _Case:
    """All that is needed to examine one frame."""

    def __init__(
        self,
        run: TrackRun,
        object_id: int,
        results: tuple[TrackResult, ...],
        frame: int,
        onset: int,
        reference: int,
        usual: float,
        frames: Mapping[int, Frame | UnreadableFrame],
        config: DiagnosisConfig,
    ) -> None:
        self.run, self.object_id, self.results = run, object_id, results
        self.frame, self.onset, self.reference = frame, onset, reference
        self.usual, self.frames, self.config = usual, frames, config
        self.part = run.parts[object_id]
        self.result = results[frame]
        self.is_bad = not _is_good(self.result, usual, config)
        self.was_good = any(result.state is TrackState.TRACKING for result in results)
        self.observer = PartObserver(self.part)

    def diagnosis(self) -> Diagnosis:
        """Measure, and name the causes beyond their limits."""
        number = self.measured_frame()
        evidence, before = self.evidence(number), self.evidence(self.reference)
        hidden = np.zeros(0, bool)
        if evidence is not None:
            # What is missing in a good frame may never have been found: only a frame before it tells that it was.
            is_known = self.is_bad or before is not None
            hidden = evidence.hidden(before) if is_known else np.zeros(len(evidence.scores), bool)
        found = [self.start(), *self.geometry(), *(self.motion(), self.region()) * self.is_bad]
        if evidence is not None:
            found += self.image(evidence, before, hidden)
        own = self.frames.get(self.frame)
        if isinstance(own, UnreadableFrame):
            found.append(causes.unreadable(own.reason))
        if not self.was_good and not self.start_is_right():
            found.append(causes.wrong_start(len(self.results)))
        named = sorted((finding for finding in found if finding), key=lambda finding: -finding.severity)
        shown = self.frames.get(number)
        return Diagnosis(
            self.run.name,
            self.object_id,
            self.frame,
            self.result.frame_id,
            self.result.state,
            self.result.quality,
            self.usual,
            self.onset,
            tuple(named),
            metric_name(self.part),
            self.add_percent(),
            self.result,
            number,
            shown.image if isinstance(shown, Frame) else None,
            evidence,
            "the tracked pose" if self.truth(number) is None else "the true pose",
            hidden,
            self.config.found_share,
            self.lost_since(),
            any(_is_good(result, self.usual, self.config) for result in self.results[: self.frame]),
        )

    def lost_since(self) -> int | None:
        """The first frame of the lost stretch, None where the part is not lost."""
        if self.result.state is not TrackState.LOST:
            return None
        first = self.frame
        while first > 0 and self.results[first - 1].state is TrackState.LOST:
            first -= 1
        return first

    def measured_frame(self) -> int:
        """The frame whose image is measured; of a lost stretch the first one, where the tracked pose is still near."""
        if self.result.state is TrackState.LOST and self.truth(self.frame) is None:
            return self.onset
        return self.frame

    def truth(self, number: int) -> FloatArray | None:
        """The true pose in a frame, None where it is unknown."""
        session = self.run.session
        if session is None or session.truth is None:
            return None
        return session.truth(self.results[number].frame_id, self.object_id)

    def add_percent(self) -> float:
        """The error of the tracked pose, NaN where the truth is unknown."""
        return PartMetric(self.part).percent(self.result.cam_T_obj, self.truth(self.frame))

    def pose(self, number: int) -> FloatArray:
        """The true pose in a frame, else the tracked one."""
        truth = self.truth(number)
        return self.results[number].cam_T_obj if truth is None else truth

    def evidence(self, number: int) -> EdgeEvidence | None:
        """What a frame shows of the part; None where there is no image."""
        shown = self.frames.get(number)
        return self.observer.measure(shown.image, shown.camera, self.pose(number)) if isinstance(shown, Frame) else None

    def image(self, evidence: EdgeEvidence, before: EdgeEvidence | None, hidden: BoolArray) -> list[Finding | None]:
        """Causes that show in the image: edges that are faint, hidden, changed, outside, or among similar ones."""
        config = self.config
        found = [causes.outside_image(evidence.outside, config)]
        share = float(hidden.mean()) if len(hidden) else 0.0
        # Where nearly all edges are missing it is no occlusion: they are too faint, or the pose is wrong.
        is_hidden = config.hidden_share <= share <= 0.9 and evidence.contrast_of(~hidden) >= config.contrast
        rest = ~hidden if is_hidden else np.ones(len(hidden), bool)
        seen, contrast = evidence.found_share_of(rest), evidence.contrast_of(rest)
        few = causes.few_edges(seen, contrast, config)
        found.append(few)
        if self.is_bad:
            found.append(causes.clutter(evidence.rivals_per_point, evidence.reach_px, config))
        if self.is_bad and is_hidden:
            found.append(causes.occlusion(share, config, self.was_good))
        # The quality is that of the tracked pose: elsewhere it fell because of that, whatever the part looks like.
        elsewhere = self.add_percent() > ELSEWHERE_PERCENT  # False where the truth is unknown
        if self.is_bad and few is None and before is not None and not elsewhere:
            # Hidden edges lower the quality by their share; the rest of the loss is the look of the visible ones.
            usual = weight_of_evidence(self.usual) * float(rest.mean())
            kept = weight_of_evidence(self.results[self.measured_frame()].quality) / max(usual, 1e-6)
            found.append(causes.appearance(seen, before.found_share, kept, config))
        return found

    def start_is_right(self) -> bool:
        """Whether the truth says so."""
        start = self.run.starts.get(self.object_id)
        return start is not None and PartMetric(self.part).percent(start, self.truth(0)) <= ELSEWHERE_PERCENT

    def geometry(self) -> list[Finding | None]:
        """The control points' quad."""
        quad = self.result.control_points
        if not np.isfinite(quad).all():
            return []
        size = extent(quad)
        opening = min(abs(area) for area in corner_areas(quad)) / max(size * size, 1e-9)
        return [causes.degenerate_points(opening, REGION_NAMES[self.result.region], self.config)]

    def region(self) -> Finding | None:
        """Whether the view region changed since the last good frame."""
        around = [result.region for result in self.results[max(self.onset - 1, 0) : self.frame + 1]]
        eye = eye_position(self.result.cam_T_obj) - self.part.box_centre
        scores = np.sort(region_scores(eye, 0.5 * self.part.box_size))
        closeness = float(scores[-2] / max(scores[-1], 1e-9))
        return causes.region_border(closeness, sum(a != b for a, b in pairwise(around)))

    def motion(self) -> Finding | None:
        """The largest innovation since the last good frame, relative to the search range.

        Only of frames before which the part was tracked: a prediction from a weak or lost pose says nothing of motion.
        """
        reach = self.observer.reach_px
        found = []
        for number in range(max(self.onset, 1), self.frame + 1):
            if self.results[number - 1].state is not TrackState.TRACKING:
                continue
            shown, innovation = self.frames.get(number), self.innovation_px(number)
            if isinstance(shown, Frame) and innovation is not None:
                found.append((innovation, reach(shown.camera, self.pose(number - 1))))
        if not found:
            return None
        return causes.fast_motion(*max(found, key=lambda motion: motion[0] / motion[1]), self.config)

    def innovation_px(self, number: int) -> float | None:
        """How far the part was from its predicted position in a frame; None where that cannot be measured."""
        before, after = self.frames.get(number - 1), self.frames.get(number)
        if not (isinstance(before, Frame) and isinstance(after, Frame)):
            return None
        centre, last, truth = self.part.box_centre[None], self.pose(number - 1), self.truth(number)
        predicted = self.results[number].predicted
        expected = after.camera.project(transform(predicted, centre))[0]
        if truth is not None:
            # A symmetry may move the box centre.
            same = closest_truth(predicted, truth, self.part.symmetries)
            return float(np.linalg.norm(after.camera.project(transform(same, centre))[0] - expected))
        start = before.camera.project(transform(last, centre))[0]
        points = self.observer.measure(before.image, before.camera, last).points
        if len(points) < 4 or not np.isfinite(expected - start).all():
            return None
        far_px = self.observer.leap_px(after.camera, last)
        moved = image_motion(before, after, points, expected - start, far_px)
        return None if moved is None else float(np.linalg.norm(start + moved - expected))

    def start(self) -> Finding | None:
        """Wrong unit or intrinsics show in the first frames, where the start pose meets the image."""
        shown, start = self.frames.get(0), self.run.starts.get(self.object_id)
        if not isinstance(shown, Frame) or start is None:
            return None
        centre, camera = self.part.box_centre, shown.camera
        given = float(transform(start, centre)[2])
        # A solver needs a frame or two for a large correction.
        first = float(transform(self.results[min(2, self.frame)].cam_T_obj, centre)[2])
        apparent_px = 2.0 * self.part.radius * camera.fx / max(given, 1e-6)
        return causes.unit_or_camera(camera, given, first, apparent_px, self.config)
