"""The way back: where is a part that was lost?

While a part is lost the detector looks for it, near where it was last seen and, in turns, all over the image and from
any side. Every search is of one frame's image and spread over as many frames as its work takes. What it finds was
there some frames ago, so it is moved to where the part's picture is now, and is a proposal: the tracker solves its
present frame from it, with all that it knows of the part's look, and takes it only if that fits. Where it does not fit
any more the part may have moved on: the next search is around there. While a frame fits nobody searches: the next one
decides.

A part that is back where it was, after it was lost or weak, is believed, and so is one that fits very well. Elsewhere
something else may look like it, above all from a side from which it shows little: a plate's edge on a cable. There,
and wherever what is seen fixes no pose (`uncertainty`), it stays weak, and teaches nothing, until a second look: the
detector searches a frame of the return, and the pose has to win against all that it finds; or fits very well for
some frames.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from acp_lab.cad.part import Part, box_corners
from acp_lab.detection.pose_prior import PosePrior
from acp_lab.detection.work import Errand
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import rotation_angle_deg, transform
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.find import Detection, Finder, are_apart, place_score, scores_in_place
from acp_lab.tracking.magnification import USUAL_MAGNIFICATION, appears_px
from acp_lab.tracking.picture import PictureSearch, take_picture
from acp_lab.tracking.recovery import WayBack
from acp_lab.tracking.search import shifted
from acp_lab.tracking.sought import Sought

PROPOSAL_WORK = 20_000.0
"""Of a frame that is solved from a proposal, see `detection.work`."""
LEAST_SEARCH_WORK = 1_000.0
"""Of a search, though it look at next to nothing: thousands of those would fit into a frame's budget."""
PICTURE = PictureSearch(reach=1.0)
"""Of the part in the frame that was searched: a fast one moves by its own size until the search ends."""
PICTURE_AMONG_OTHERS = PictureSearch(reach=0.3)
"""The same, where others like it are about: farther away is one of those."""


class Search(Errand[tuple[Detection, ...]]):
    """A search, and what it is limited to."""

    def __init__(
        self,
        finder: Finder,
        frame: Frame,
        most: int,
        prior: PosePrior | None,
        aligned: int | None = None,
        rival: FloatArray | None = None,
    ) -> None:
        frame = frame.to_keep()  # as the search goes on in later ones
        super().__init__(finder.search(frame, most, prior, aligned, rival))
        self.frame, self.prior, self.rival = frame, prior, rival


@dataclass(frozen=True)
class Reach:
    """How far from a pose a search looks, see `PosePrior`."""

    within_deg: float
    depth_ratio: float
    around_px: float | None = None

    def of(self, cam_T_obj: FloatArray, size_px: float = USUAL_MAGNIFICATION.above_px) -> PosePrior:
        """Around a pose (4, 4) at which the part appears `size_px` long."""
        around_px = self.around_px
        if around_px is not None:
            # Where it is magnified a margin has more px, which take longer; and a part far away moves by fewer. A
            # large one moves by more, and the detector scans its image at the size of its templates.
            around_px *= USUAL_MAGNIFICATION.times_smaller(size_px) / USUAL_MAGNIFICATION.times(size_px) ** 0.5
        return PosePrior(cam_T_obj, self.within_deg, self.depth_ratio, around_px)


def moved_on(
    part: Part, cam_T_obj: FloatArray, searched: Frame, frame: Frame, search: PictureSearch = PICTURE
) -> list[FloatArray]:
    """A pose (4, 4) that was found in a frame, as poses in a later one, the likelier first.

    It is moved to where the part's picture is now. What passes in front of the part has a picture, too, so both are
    given, unless nothing moved.
    """
    if searched.camera != frame.camera:
        return [cam_T_obj]
    picture = take_picture(searched, box_corners(part), cam_T_obj, search)
    shift_px = None if picture is None else picture.shift_in(frame.image, np.zeros(2), search)
    if shift_px is None or np.linalg.norm(shift_px) < search.least_px:
        return [cam_T_obj]
    return [shifted(cam_T_obj, part.box_centre, frame.camera, shift_px), cam_T_obj]


NEAR, LIKE_LAST, ANY_SIDE = Reach(25.0, 1.12, 80.0), Reach(40.0, 1.3), Reach(180.0, 1.6)
WIDE: tuple[Reach | None, ...] = (LIKE_LAST, ANY_SIDE, LIKE_LAST, ANY_SIDE, LIKE_LAST, None)
"""In their order, again and again; None for everywhere, which takes longest. A search that began while the part was
away is in vain, so the next one of its kind must not be far."""
WIDE_FRAMES, LATE_WIDE_FRAMES = 2, 4
"""Frames that a wide search gets between two searches nearby: a part that is back where it was is found at once. Later
it may well be back elsewhere."""

SURE_QUALITY = 0.85
"""From which on a pose elsewhere is believed without a second look."""
SURE_FRAMES = 5
"""In a row, of such a quality: a part that needed a second look before is believed without the rest of it."""
SECOND_LOOKS = (LIKE_LAST, ANY_SIDE)
"""Around where the part was before; what nothing contradicts in the last one is believed."""
_HYPOTHESES = 8
"""Of a search: where one turns out to be another part like it, the next is tried."""
_SURE_RIVAL = 0.5
"""Score of what contradicts a pose."""


class Verdict(Enum):
    """What a second look says of a pose."""

    OPEN = "open"
    RIGHT = "right"
    WRONG = "wrong"


class Reacquisition:
    """The search of one tracked part; finder: gives the detector, when it is needed."""

    def __init__(self, model: PreparedPart, config: WayBack, finder: Callable[[], Finder]) -> None:
        self._model, self._config, self._finder = model, config, finder
        self.forget()

    def forget(self) -> None:
        """The part is not lost: the next search begins anew."""
        self._near: Search | None = None
        self._wide: Search | None = None
        # Hypotheses with the frames that they are of: those that are proposed next, and those of which some were last.
        self._found: tuple[tuple[Frame, Detection], ...] = ()
        self._rest: tuple[tuple[Frame, Detection], ...] = ()
        self._met_others = False
        self._around: FloatArray | None = None
        self._frames = self._wide_frames = self._wide_searches = 0
        self._prior: PosePrior | None = None
        self._best: Detection | None = None
        self._began = False
        self._second: Search | None = None
        self._looks = self._sure_frames = 0

    @property
    def sought(self) -> Sought | None:
        """Where the last search looked, and the best hypothesis of the one that ended last; None before any."""
        best = self._best
        if not self._began:
            return None
        return Sought.by(self._prior, None if best is None else best.cam_T_obj, 0.0 if best is None else best.score)

    @property
    def budget(self) -> float:
        """Of work per frame."""
        return self._config.budget

    @property
    def _is_late(self) -> bool:
        return self._frames > self._config.late_frames

    def look_around(self, cam_T_obj: FloatArray) -> None:
        """Search next near a pose (4, 4), where the part may have been a moment ago."""
        self._around, self._near, self._found = cam_T_obj, None, ()

    def pass_on(self, frame: Frame, cam_T_obj: FloatArray, last_seen: FloatArray) -> None:
        """What was proposed turned out to be another part, at a pose (4, 4) in a frame: propose what else was found.

        Nearest first to where the part was last seen, (4, 4).
        """
        part = self._model.part
        last = transform(last_seen, part.box_centre)
        others = [one for one in self._rest if are_apart(part, frame.camera, one[1].cam_T_obj, cam_T_obj)]
        others.sort(key=lambda one: np.linalg.norm(transform(one[1].cam_T_obj, part.box_centre) - last))
        self._around, self._near, self._found, self._rest = None, None, tuple(others), ()
        self._met_others = True

    def proposals(self, frame: Frame, last_seen: FloatArray) -> list[FloatArray]:
        """Go on searching in a frame; poses (4, 4) to solve it from, the best first, mostly none.

        last_seen: (4, 4), where the part was.
        """
        part, most = self._model.part, self._config.proposals
        proposed, self._rest = self._found[:most], self._found
        picture = PICTURE_AMONG_OTHERS if self._met_others or self._is_among_others() else PICTURE
        found = [pose for searched, one in proposed for pose in moved_on(part, one.cam_T_obj, searched, frame, picture)]
        self._found, self._second, self._looks = (), None, 0
        if found:
            self.look_around(found[0])
        self._frames += 1
        budget = (self._config.late_budget if self._is_late else self._config.budget) - PROPOSAL_WORK * len(found)
        while budget > 0.0 and not self._found:
            budget = self._go_on(frame, last_seen, budget)
        return found

    def doubts(self, frame: Frame, cam_T_obj: FloatArray, quality: float, last_seen: FloatArray) -> bool:
        """Whether a pose (4, 4) needs a second look: not near the last one (`NEAR`), nor sure."""
        if quality >= SURE_QUALITY:
            return False
        turns = self._model.part.symmetries.transforms()
        turned_deg = min(rotation_angle_deg(cam_T_obj[:3, :3], (last_seen @ turn)[:3, :3]) for turn in turns)
        centres_cam = np.array([transform(pose, self._model.part.box_centre) for pose in (cam_T_obj, last_seen)])
        if turned_deg > NEAR.within_deg or centres_cam[:, 2].min() <= 0.0:
            return True
        here, there = frame.camera.project(centres_cam)
        return bool(np.linalg.norm(here - there) > (NEAR.around_px or np.inf))

    def second_look(self, frame: Frame, cam_T_obj: FloatArray, last_seen: FloatArray, is_sure: bool) -> Verdict:
        """Go on looking whether a pose (4, 4) elsewhere is the part; the better one is proposed if it is not.

        is_sure: whether it would need no second look if it came back now.
        """
        self._sure_frames = self._sure_frames + 1 if is_sure else 0
        if self._sure_frames == SURE_FRAMES:
            self.forget()
            return Verdict.RIGHT
        if self._second is None:
            looks, sure_frames, frames = self._looks, self._sure_frames, self._frames
            self.forget()
            self._looks, self._sure_frames, self._frames = looks, sure_frames, frames
            prior = SECOND_LOOKS[looks].of(last_seen)
            self._second = Search(self._finder(), frame, _HYPOTHESES, prior, rival=cam_T_obj)
        search = self._second
        search.go_on(self._config.budget)
        if not search.is_done:
            return Verdict.OPEN
        best, self._second = next(iter(search.result or ()), None), None
        self._looks += 1
        rival, verdict = search.rival, Verdict.OPEN
        if best is not None and rival is not None and not self._finder().is_same(best.cam_T_obj, (rival,)):
            if best.score >= _SURE_RIVAL and not self._are_two(search.frame, rival, search.result or ()):
                self._best, self._found = best, ((search.frame, best),)
                verdict = Verdict.WRONG
        elif best is not None and best.score >= self._config.least_score:
            verdict = Verdict.RIGHT
        if verdict is Verdict.OPEN and self._looks == len(SECOND_LOOKS):
            verdict = Verdict.RIGHT
        if verdict is not Verdict.OPEN:
            self._looks = 0  # the next doubt is another one
        return verdict

    def _are_two(self, frame: Frame, cam_T_obj: FloatArray, hypotheses: Sequence[Detection]) -> bool:
        """Whether the best of what a search found is one part, and what is in the place of a pose (4, 4) another."""
        part, camera = self._model.part, frame.camera
        if not are_apart(part, camera, hypotheses[0].cam_T_obj, cam_T_obj):
            return False
        return place_score(part, camera, cam_T_obj, hypotheses) >= _SURE_RIVAL

    def _is_among_others(self) -> bool:
        """Whether what was found last is in several places."""
        part, poses = self._model.part, [one.cam_T_obj for _, one in self._rest]
        return any(are_apart(part, self._rest[0][0].camera, poses[0], other) for other in poses[1:])

    def _go_on(self, frame: Frame, last_seen: FloatArray, budget: float) -> float:
        """Spend some of a budget; what is left of it."""
        most = max(self._config.proposals, _HYPOTHESES)
        if self._wide_frames > 0 and self._around is None:
            if self._wide is None:
                reach = WIDE[self._wide_searches % len(WIDE)]
                self._wide_searches += 1
                prior = None if reach is None else reach.of(last_seen)
                self._wide = Search(self._finder(), frame, most, prior, None)
            search, self._wide_frames = self._wide, self._wide_frames - 1
        else:
            if self._near is None:
                around, self._around = self._around, None
                place = last_seen if around is None else around
                near = NEAR.of(place, appears_px(self._model.part, frame.camera, place))
                # Not aligned: the tracker does that in the frame in which it tries them.
                self._near = Search(self._finder(), frame, most, near, 0)
            search = self._near
        budget = min(search.go_on(budget), budget - LEAST_SEARCH_WORK)
        self._prior, self._began = search.prior, True
        if not search.is_done:
            return budget
        hypotheses = search.result or ()
        self._best = next(iter(hypotheses), None)
        least = self._config.least_score_near if search is self._near else self._config.least_score
        likely = scores_in_place(self._model.part, search.frame.camera, hypotheses)
        found = (one for one, score in zip(hypotheses, likely, strict=True) if score >= least)
        self._found = tuple((search.frame, one) for one in found)
        if search is self._near:
            self._near, self._wide_frames = None, LATE_WIDE_FRAMES if self._is_late else WIDE_FRAMES
        else:
            self._wide = None
        # A search without anything to look at, such as for a part too small, costs nothing: not again in this frame.
        return budget if search.worked else 0.0
