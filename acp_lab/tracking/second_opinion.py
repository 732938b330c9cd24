"""A second opinion on the first frame: does the detector find the part elsewhere?

From a start pose that is far off, the search may end at a pose that looks like the right one, and goes on looking like
it for as long as the part is tracked. The detector needs no pose: it searches the image around the start in its own
way, and judges what it finds and the pose in question by its own evidence. Where it clearly prefers another one, the
frame is solved from there, and that is taken where the tracker, too, holds it for the likelier one. A pose near the
start has the start's word for it: it takes more to contradict that. And where the detector finds the part in the
place in question, too, in whatever pose, what it finds elsewhere is another such part: the start says which is meant.
(Not in the paper, whose starts are the truth with a disturbance of untold size.)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from acp_lab.detection.pose_prior import PosePrior
from acp_lab.geometry.arrays import FloatArray
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.find import Finder, are_apart, place_score, scores_in_place
from acp_lab.tracking.learning.knowledge import Off
from acp_lab.tracking.search import Look, PoseSolver
from acp_lab.tracking.solution import Solution
from acp_lab.tracking.start import LOOK_LEVEL, Contradiction, SecondOpinion, TrustedStart
from acp_lab.tracking.stopwatch import Stopwatch

# Of the detector, that differ: the pose in question is among them, unless it is next to impossible.
_HYPOTHESES = 8


@dataclass(frozen=True, eq=False)
class Question:
    """Is this the part?

    Attributes:
        frame, look: the first frame, and how it is looked at around a pose.
        start, found: (4, 4) mm, the given pose, and the one in question.
    """

    frame: Frame
    look: Look
    start: FloatArray
    found: FloatArray


def second_opinion(
    question: Question,
    solver: PoseSolver,
    finder: Finder,
    config: TrustedStart,
    confidence: Callable[[Solution], float],
    clock: Stopwatch,
) -> FloatArray | None:
    """The pose (4, 4) mm where the part is instead; None where nothing speaks for another one than that in question.

    config: of the first frame; nobody is asked where its second opinion is off. confidence: in [0, 1], how likely the
    tracker holds a solution to be right.
    """
    opinion = config.second_opinion
    if isinstance(opinion, Off):
        return None
    clock.lap()
    is_near = config.cloud.reaches(question.start, question.found, solver.part)
    elsewhere = _contradiction(question, finder, opinion, opinion.near if is_near else opinion.far)
    clock.search_s += clock.lap()
    seen = None if elsewhere is None else question.look(elsewhere)
    if elsewhere is None or seen is None:
        return None
    solved = solver.solve(seen, seen.view.at_pose(elsewhere), clock)
    if solved is None:
        return None

    def confidence_at(cam_T_obj: FloatArray) -> float:
        there = question.look(cam_T_obj)
        looked = None if there is None else solver.look_at(there, there.view.at_pose(cam_T_obj), LOOK_LEVEL, clock)
        return 0.0 if looked is None else confidence(looked)

    return solved.cam_T_obj if confidence_at(solved.cam_T_obj) > confidence_at(question.found) else None


def _contradiction(
    question: Question, finder: Finder, config: SecondOpinion, needed: Contradiction
) -> FloatArray | None:
    """The pose (4, 4) of the best hypothesis around the start, where it is another one and clearly likelier."""
    part, camera = finder.model.part, question.frame.camera
    around = PosePrior(question.start, config.within_deg, config.depth_ratio, config.around_px)
    found = finder.find(question.frame, _HYPOTHESES, around, rival=question.found)
    scores = [one.score for one in found]
    if place_score(part, camera, question.found, found) >= config.apart_below:
        # It is in that place, and may be in another pose there.
        in_place = zip(found, scores_in_place(part, camera, found), strict=True)
        scores = [0.0 if are_apart(part, camera, o.cam_T_obj, question.found) else score for o, score in in_place]
    own, best, likely = 0.0, None, 0.0
    for one, score in zip(found, scores, strict=True):
        if finder.is_same(one.cam_T_obj, (question.found,)):
            own = max(own, score)
        elif best is None or score > likely:
            best, likely = one, score
    return None if best is None or likely < max(needed.score, needed.times * own) else best.cam_T_obj
