"""Find: the part in one frame, without a pose to start from.

The detector says where the part may be; here its best candidates are aligned as a tracker's first frame is
(`alignment`), and the image is asked again what it says of the poses that come out.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from acp_lab.cad.part import Part, box_corners
from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.detection.config import DetectionConfig
from acp_lab.detection.detector import Candidate, Detector, Look, judging
from acp_lab.detection.edge_maps import RESIZE_WORK
from acp_lab.detection.pose_prior import PosePrior
from acp_lab.detection.work import Steps, finish
from acp_lab.errors import ParameterError, check_kind
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import transform
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame, check_frame
from acp_lab.tracking.alignment import aligning
from acp_lab.tracking.magnification import USUAL_MAGNIFICATION, MagnifyingGlass, appears_px

ACCEPTED = 0.8
"""From this score on a hypothesis counts as found. On frames of the tuning parts more than 97% of these are right,
where several parts are alike fewer (docs/detection.md)."""
ALIGNED, ALIGNED_NEAR = 12, 4
PLACES, ALIGNED_EACH = 24, 3
"""Of a search for each of several parts: places that are looked at, and candidates that are aligned in each."""
MOST_EACH = 20
"""Of these, so many are told."""
_RIVALS = 8
_MOST_PIXELS = 2_500_000
"""Of a magnified image that is searched."""
_MARGIN_PX = 40.0
"""Around where the part may be in a magnified image: what stands beside it tells, too."""
_SAME_SHARE = 0.1
"""Of the diameter: poses whose points are no further apart are one hypothesis."""
_APART_SHARE = 0.25
_APART_WIDTH = 0.5
"""Of the diameter, and of the width: centres farther from each other, across the line of sight, are of two parts."""


@dataclass(frozen=True, eq=False)
class Detection:
    """A hypothesis of where the part is.

    cam_T_obj: (4, 4) mm. score: in [0, 1], how likely the pose is right. view_obj: (3,) unit, from the part's
    centre to the camera, object frame. is_accepted: the score is at least ACCEPTED.
    """

    cam_T_obj: FloatArray
    score: float
    view_obj: FloatArray

    @property
    def is_accepted(self) -> bool:
        """Whether this can be taken for found."""
        return self.score >= ACCEPTED


@dataclass(frozen=True, eq=False)
class _Looked:
    """What the detector made of one image of a frame.

    look: candidates and a witness. farthest_mm: up to which distance the part was looked for. times: that the frame is
    magnified.
    """

    look: Look
    farthest_mm: float
    times: int

    def in_frame(self, candidate: Candidate) -> Candidate:
        """A candidate, as long as it appears in the frame: a magnified part tells no more than it did."""
        if self.times == 1:
            return candidate
        evidence = candidate.evidence
        return replace(candidate, evidence=replace(evidence, size_px=evidence.size_px / self.times))


class Finder:
    """Finds one prepared part in frames.

    Where it would appear small the image is magnified: specks are taken out of it whatever they are part of, and
    candidates are compared at one size.
    """

    def __init__(self, model: PreparedPart, config: DetectionConfig | None = None) -> None:
        """PreparationError when the part has neither templates nor visibility networks."""
        check_kind(model, PreparedPart, "model", "acp.PreparedPart.load('parts/bracket'), or what acp.prepare returned")
        self.model = model
        self.detector = Detector(model.part, model.best_generator(), config, model.views)
        vertices = model.part.vertices
        self._points_obj = vertices[:: max(1, len(vertices) // 200)]
        self._turns = model.part.symmetries.transforms()

    def prepare(self) -> None:
        """Make the templates now instead of at the first frame."""
        self.detector.prepare()

    def find(
        self, frame: Frame, top: int = 3, prior: PosePrior | None = None, rival: FloatArray | None = None
    ) -> tuple[Detection, ...]:
        """Up to `top` hypotheses that differ, the best first; () when nothing resembles the part.

        prior: looks near a pose only. rival: (4, 4) a pose that competes with what is found, as it is.
        """
        check_frame(frame)
        _check_most(top, "top")
        return finish(self.search(frame, top, prior, rival=rival))

    def search(
        self,
        frame: Frame,
        top: int = 3,
        prior: PosePrior | None = None,
        aligned_most: int | None = None,
        rival: FloatArray | None = None,
    ) -> Steps[tuple[Detection, ...]]:
        """`find`, in slices.

        aligned_most: of the candidates, how many are aligned; 0 for who aligns them in the end.
        rival: (4, 4) a pose that competes with them as it is.
        """
        if aligned_most is None:
            aligned_most = ALIGNED if prior is None else ALIGNED_NEAR
        looks = yield from (self._looks(frame) if prior is None else self._looks_near(frame, prior))
        found = _best_first(looks)
        # A candidate has no key but itself; `found` keeps each alive.
        seen_in, aligned = {id(candidate): one for candidate, one in found}, list[Candidate]()
        for candidate in self._distinct((candidate for candidate, _ in found), aligned_most or _RIVALS):
            if aligned_most > 0:
                # Only what comes of that counts: where its own search ended any candidate, right or wrong, looks good.
                aligned += yield from self._aligned(frame, candidate, seen_in[id(candidate)])
            else:
                aligned.append(candidate)
        if rival is not None:
            one = self._look_of(rival, looks)
            judged = yield from judging(one.look.witness, rival)
            aligned += map(one.in_frame, judged)
        best = self._distinct(sorted(aligned, key=lambda c: -c.evidence.log_odds), max(top, _RIVALS))
        return tuple(
            Detection(c.cam_T_obj, score, self._view_obj(c.cam_T_obj))
            for c, score in zip(best[:top], shared_scores(best), strict=False)
        )

    def find_each(self, frame: Frame, most: int = MOST_EACH) -> tuple[Detection, ...]:
        """Up to `most` hypotheses, the best first, each in another place: of parts that are alike, as in a tray.

        The score is how likely a pose is right if there may be others like it elsewhere. ParameterError for a `most`
        below 1.
        """
        _check_most(most, "most")
        check_frame(frame)
        return finish(self._search_each(frame, most))

    def _search_each(self, frame: Frame, most: int) -> Steps[tuple[Detection, ...]]:
        looks = yield from self._looks(frame)
        part, camera = self.model.part, frame.camera
        places = list[list[Candidate]]()
        aligned = list[Candidate]()
        for candidate, one in _best_first(looks):
            pose = candidate.cam_T_obj
            here = next((place for place in places if not are_apart(part, camera, place[0].cam_T_obj, pose)), None)
            if here is None and len(places) < PLACES:
                places.append(here := [])
            if here is None or len(here) == ALIGNED_EACH or self.is_same(pose, (c.cam_T_obj for c in here)):
                continue
            here.append(candidate)
            aligned += yield from self._aligned(frame, candidate, one)
        by_evidence = sorted(aligned, key=lambda candidate: -candidate.evidence.log_odds)
        distinct = self._distinct(by_evidence, len(by_evidence))
        odds, poses = np.exp([c.evidence.log_odds for c in distinct]), [c.cam_T_obj for c in distinct]
        scored = sorted(zip(_in_place(part, camera, poses, odds), poses, strict=True), key=lambda pair: -pair[0])
        found = list[Detection]()
        for score, pose in scored:
            if len(found) == most:
                break
            # Both ways, as the width that counts is the second one's.
            pairs = (pair for one in found for pair in ((one.cam_T_obj, pose), (pose, one.cam_T_obj)))
            if all(are_apart(part, camera, *pair) for pair in pairs):
                found.append(Detection(pose, score, self._view_obj(pose)))
        return tuple(found)

    def _aligned(self, frame: Frame, candidate: Candidate, one: _Looked) -> Steps[list[Candidate]]:
        """What becomes of a candidate of a look when it is aligned; empty where it leads nowhere."""
        pose = yield from aligning(self.model, frame, candidate.cam_T_obj)
        if pose is None:
            return []
        judged = yield from judging(one.look.witness, pose)
        return [one.in_frame(candidate) for candidate in judged]

    def _looks_near(self, frame: Frame, prior: PosePrior) -> Steps[list[_Looked]]:
        """The one image that a search near a pose is of."""
        size_px = appears_px(self.model.part, frame.camera, prior.cam_T_obj)
        # For the part at the rim of where it may be.
        room_px = prior.depth_ratio * size_px
        reach_px = (np.inf if prior.around_px is None else prior.around_px) + 1.5 * room_px
        times = min(USUAL_MAGNIFICATION.times(size_px), _most_times(frame.camera, reach_px))
        box = None
        if prior.around_px is not None and times > 1:
            camera = MagnifyingGlass.of(times).camera(frame.camera)
            magnified = replace(prior, around_px=times * prior.around_px)
            window = self.detector.window(camera, magnified)
            if window is None:
                times = 1  # beyond the border, or nearly so: all of the image is searched
            else:
                room, prior = int(times * room_px + _MARGIN_PX), magnified
                box = window[0] - room, window[1] - room, window[2] + room, window[3] + room
        image = yield from _magnifying(frame, MagnifyingGlass.of(times), box)
        look = yield from self.detector.search(image.image, image.camera, prior)
        return [_Looked(look, np.inf, times)]

    def _looks(self, frame: Frame) -> Steps[list[_Looked]]:
        """The images of a search everywhere: the frame, and magnified twice and so on for a part farther away."""
        depths = self.detector.depths(frame.camera)
        limit_mm = self.model.part.diameter * frame.camera.fx / USUAL_MAGNIFICATION.below_px
        most = min(USUAL_MAGNIFICATION.most, _most_times(frame.camera))
        looks = list[_Looked]()
        times, near = 1, 0.0
        while times <= most:
            far = times * limit_mm if 2 * times <= most else np.inf
            levels = depths[(depths > near) & (depths <= far)]
            if len(levels):
                image = yield from _magnifying(frame, MagnifyingGlass.of(times))
                share = len(levels) / len(depths)
                look = yield from self.detector.search(image.image, image.camera, depths=levels, share=share)
                looks.append(_Looked(look, far, times))
            times, near = 2 * times, far
        return looks

    def _look_of(self, cam_T_obj: FloatArray, looks: Sequence[_Looked]) -> _Looked:
        """That in which a pose (4, 4) is looked for."""
        depth = transform(cam_T_obj, self.model.part.box_centre)[2]
        return next((one for one in looks if depth <= one.farthest_mm), looks[-1])

    def _view_obj(self, cam_T_obj: FloatArray) -> FloatArray:
        eye: FloatArray = eye_position(cam_T_obj) - self.model.part.box_centre
        return eye / max(float(np.linalg.norm(eye)), 1e-9)

    def is_same(self, cam_T_obj: FloatArray, others: Iterable[FloatArray]) -> bool:
        """Whether a pose (4, 4) is nearly the same as one of others, a symmetric part's equal poses included."""
        alike = np.stack([transform(cam_T_obj @ turn, self._points_obj) for turn in self._turns])
        limit = _SAME_SHARE * self.model.part.diameter
        places = (transform(other, self._points_obj) for other in others)
        return any(np.linalg.norm(alike - place, axis=2).mean(1).min() <= limit for place in places)

    def _distinct(self, candidates: Iterable[Candidate], most: int) -> list[Candidate]:
        """The best of those that are nearly the same."""
        kept = list[Candidate]()
        for candidate in candidates:
            if len(kept) == most:
                break
            if not self.is_same(candidate.cam_T_obj, (one.cam_T_obj for one in kept)):
                kept.append(candidate)
        return kept


def are_apart(part: Part, camera: Camera, cam_T_obj: FloatArray, other: FloatArray) -> bool:
    """Whether two poses (4, 4) are of two parts: in an image their centres are too far from each other for one.

    That is a quarter of the diameter, or half of how wide the part appears in that direction where that is less.
    """
    centres = np.array([transform(pose, part.box_centre) for pose in (cam_T_obj, other)])
    corners = transform(other, box_corners(part))
    if min(centres[:, 2].min(), corners[:, 2].min()) <= 0.0:
        return False
    here, there = camera.project(centres)
    shift = here - there
    apart_px = float(np.linalg.norm(shift))
    if apart_px == 0.0:
        return False
    width_px = float(np.ptp(camera.project(corners) @ (shift / apart_px)))
    quarter_px = _APART_SHARE * part.diameter * camera.fx / centres[:, 2].min()
    return bool(apart_px > min(quarter_px, _APART_WIDTH * width_px))


def scores_in_place(part: Part, camera: Camera, hypotheses: Sequence[Detection]) -> list[float]:
    """In [0, 1] each: how likely it is right if there may be others like it elsewhere; of all that a search found."""
    return _in_place(part, camera, [one.cam_T_obj for one in hypotheses], _odds(hypotheses))


def _in_place(part: Part, camera: Camera, poses: Sequence[FloatArray], odds: FloatArray) -> list[float]:
    """In [0, 1] each: how likely poses (4, 4) are right, by their odds (n,), if only those in one place compete."""
    rivals = [[not are_apart(part, camera, one, other) for other in poses] for one in poses]
    return [float(own / (1.0 + odds[here].sum())) for own, here in zip(odds, rivals, strict=True)]


def place_score(part: Part, camera: Camera, cam_T_obj: FloatArray, hypotheses: Sequence[Detection]) -> float:
    """In [0, 1]: how likely the part, or one like it, is in the place of a pose (4, 4); by all that a search found."""
    here = [not are_apart(part, camera, one.cam_T_obj, cam_T_obj) for one in hypotheses]
    odds = float(_odds(hypotheses)[here].sum())
    return odds / (1.0 + odds)


def _odds(hypotheses: Sequence[Detection]) -> FloatArray:
    """(n,) of each of all that a search found, against that there is none; see `shared_scores`."""
    scores = np.array([one.score for one in hypotheses])
    return np.asarray(scores / max(1.0 - float(scores.sum()), 1e-9))


class LateFinder:
    """The finder of a part, made when it is first asked for: some ten milliseconds, if views are stored."""

    def __init__(self, model: PreparedPart) -> None:
        self._model = model
        self._finder: Finder | None = None

    def __call__(self) -> Finder:
        """Ready to search; PreparationError when the part has neither templates nor visibility networks."""
        if self._finder is None:
            self._finder = Finder(self._model)
            self._finder.prepare()
        return self._finder


def _check_most(count: int, name: str) -> None:
    if not (isinstance(count, int) and count >= 1):
        raise ParameterError(f"{name} = {count!r}: give how many hypotheses at most, 1 or more")


def _best_first(looks: Iterable[_Looked]) -> list[tuple[Candidate, _Looked]]:
    """All candidates, as they appear in the frame, and where each was seen."""
    found = [(one.in_frame(candidate), one) for one in looks for candidate in one.look.candidates]
    return sorted(found, key=lambda pair: -pair[0].score)


def _most_times(camera: Camera, reach_px: float = np.inf) -> int:
    """How many times an image, or so much of it around a place, may be magnified: time and memory stay bounded."""
    pixels = min(camera.width, 2.0 * reach_px) * min(camera.height, 2.0 * reach_px)
    return max(1, int(np.sqrt(_MOST_PIXELS / pixels)))


def _magnifying(frame: Frame, glass: MagnifyingGlass, box: tuple[int, int, int, int] | None = None) -> Steps[Frame]:
    """A frame through a glass, inside a box px of what it shows, in slices."""
    magnified = glass.frame(frame, box)
    if glass.times > 1:
        x0, y0, x1, y1 = box or (0, 0, magnified.camera.width, magnified.camera.height)
        yield RESIZE_WORK * 3.0 * (x1 - x0) * (y1 - y0)
    return magnified


def shared_scores(candidates: Sequence[Candidate]) -> list[float]:
    """In [0, 1] each: the probability that this one is right and none of the others.

    The part is in one place only. Where two poses fit about equally, as with a part that looks nearly the same from
    the other side, neither is sure, however well it fits.
    """
    odds = np.exp([candidate.evidence.log_odds for candidate in candidates])
    return [float(one) for one in odds / (1.0 + odds.sum())]


def detect(
    model: PreparedPart, frame: Frame, top: int = 3, config: DetectionConfig | None = None
) -> tuple[Detection, ...]:
    """Where is the part in a frame? Up to `top` hypotheses, the best first; () when nothing resembles it.

    For several frames make one `Finder`: it keeps its templates. A tracker that starts there is told so,
    `tracker.start(frame, detection.cam_T_obj, found=True)`.

    Raises:
        PreparationError: the part has neither templates nor visibility networks.
        ParameterError: top is below 1, or frame is none.
    """
    return Finder(model, config).find(frame, top)


def detect_each(
    model: PreparedPart, frame: Frame, most: int = MOST_EACH, config: DetectionConfig | None = None
) -> tuple[Detection, ...]:
    """Where are parts that are alike, as in a tray? Up to `most` hypotheses, each in another place, the best first.

    Of those that are accepted (`Detection.is_accepted`) each can be taken for found. As `detect` else.

    Raises:
        PreparationError: the part has neither templates nor visibility networks.
        ParameterError: most is below 1, or frame is none.
    """
    return Finder(model, config).find_each(frame, most)
