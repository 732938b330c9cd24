"""Poses around a pose: what the first frame, recovery and snap share.

A search solves the frame from several starts with few, wide levels, refines the best of them, and says which one
the frame likes best.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from acp_lab.cad.part import Part
from acp_lab.errors import TrackingError
from acp_lab.geometry.arrays import FloatArray, plain
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import transform
from acp_lab.geometry.pose_kernels import step_between
from acp_lab.geometry.pose_step import move_pose, pose_step_between
from acp_lab.tracking.frame_view import Estimate
from acp_lab.tracking.schedule import Level
from acp_lab.tracking.solution import SeenFrame, Solution
from acp_lab.tracking.stopwatch import Stopwatch

WIDE_LEVELS = (Level(20, 8.0), Level(16, 5.0), Level(10, 2.5), Level(6, 1.2))
"""From some degrees and some ten px off."""
AGREEMENT_LEVEL = Level(6, 1.2)
"""For comparing poses with each other."""
LOOK_AROUND = Level(12, 5.0, 150)
"""For choosing among poses of which none is near: wide, and with few samples."""
REGIONS_FIRST = (Level(20, 8.0, 250, 0.01), Level(14, 5.0, 250, 0.02), Level(8, 2.0, 400, 0.1))
"""With edges that hardly count at first, from where regions see the part."""
CLOUD_LEVELS = WIDE_LEVELS[1:]
"""From poses that are not so far off, as those of a cloud or of the detector."""
_FINE_LEVELS = (Level(8, 2.0, 400), Level(5, 1.0, 600))
# Standard deviations from the middle of a cloud to its rim: the rms distance of its poses, over all six directions.
_RIM = 2.45
_RING = 8
# No part turns more from one frame to the next; nor does it move by its own size.
_LARGEST_TURN_DEG = 45.0
# Of the radius: poses that move points of the part by more are of different places.
_ELSEWHERE = 0.2


class PoseSolver(Protocol):
    """What a search needs of the frame solver; see `frame_solver.FrameSolver`."""

    part: Part
    edge_break_mm: float

    def solve(
        self, seen: SeenFrame, start: Estimate, clock: Stopwatch, levels: tuple[Level, ...] | None = None
    ) -> Solution | None:
        """argmin e from an estimate."""
        ...

    def settle(self, seen: SeenFrame, solution: Solution, clock: Stopwatch) -> Solution:
        """A solution of a first frame, once it is known what the part's edges have in common."""
        ...

    def afresh(self, seen: SeenFrame) -> SeenFrame:
        """The same frame, for a search that leaves the other as it is."""
        ...

    def look_at(self, seen: SeenFrame, at: Estimate, level: Level, clock: Stopwatch) -> Solution | None:
        """What the frame says of an estimate as it is."""
        ...

    def agreement(self, seen: SeenFrame, at: Estimate, level: Level) -> float:
        """In [0, 1]: how well the frame agrees with an estimate."""
        ...

    def explained(self, seen: SeenFrame, at: Estimate) -> int:
        """How many of the image's edge pixels the part's edges at an estimate explain."""
        ...


Look = Callable[[FloatArray], SeenFrame | None]
"""Gives the frame around a pose (4, 4)."""
Ranking = Callable[[PoseSolver, SeenFrame, Estimate, Level], float]
"""How good an estimate is beside others of one frame, and how closely it is looked at."""


def one_way(solver: PoseSolver, seen: SeenFrame, at: Estimate, level: Level) -> float:
    """How well the frame agrees with an estimate: does the image have an edge where the part has one?"""
    return solver.agreement(seen, at, level)


def both_ways(solver: PoseSolver, seen: SeenFrame, at: Estimate, level: Level) -> float:
    """Agreement both ways, in px: does the part also have an edge where the image has one? See `explained_edges`.

    What the part's edges find in the image is a precision, what they explain of its edges a recall, but for a factor
    that all poses share; their product wants both. (Not in the paper, whose loss goes one way.)
    """
    # Where the image has no edges at all, one way has to do.
    return solver.agreement(seen, at, level) * (1 + solver.explained(seen, at))


@dataclass(frozen=True)
class Cloud:
    """Poses scattered around a pose, and how many of them are followed up.

    Attributes:
        turn_deg: standard deviation of the turn about each axis.
        shift_share: of the shift along each axis, as a share of the part's radius.
        poses: in the cloud; solved: of these, from how many the solver runs; finalists: of its results, how many are
            refined.
    """

    turn_deg: float
    shift_share: float
    poses: int
    solved: int
    finalists: int

    def check(self, prefix: str) -> None:
        """Raises TrackingError for numbers that make no cloud; prefix: what its settings are called by."""
        for name, least, most in (
            ("turn_deg", 0, 180), ("shift_share", 0, 1), ("poses", 1, 10_000), ("solved", 1, 10_000),
            ("finalists", 1, 10_000),
        ):  # fmt: skip
            if not least <= getattr(self, name) <= most:
                raise TrackingError(f"{prefix}{name} = {getattr(self, name):g}: give {least} to {most}")

    @property
    def wider(self) -> Cloud:
        """Twice as many poses, scattered twice as wide."""
        return replace(self, turn_deg=2.0 * self.turn_deg, shift_share=2.0 * self.shift_share, poses=2 * self.poses)

    def reaches(self, cam_T_obj: FloatArray, found: FloatArray, part: Part) -> bool:
        """Whether a pose (4, 4) lies well within the cloud around another: not at its rim, or outside."""
        step = pose_step_between(cam_T_obj, found, part.box_centre)
        spreads = np.repeat([math.radians(self.turn_deg), self.shift_share * part.radius], 3)
        # A cloud that does not spread in some direction reaches as far there as what is found was moved by the solver.
        return float(np.linalg.norm(step[spreads > 0.0] / spreads[spreads > 0.0])) < _RIM

    def around(self, cam_T_obj: FloatArray, part: Part) -> list[FloatArray]:
        """The pose (4, 4) itself, then the scattered ones; always the same."""
        rng = np.random.default_rng(0)
        turns = rng.normal(0.0, np.radians(self.turn_deg), (self.poses, 3))
        shifts = rng.normal(0.0, self.shift_share * part.radius, (self.poses, 3))
        steps = np.concatenate([turns, shifts], axis=1)
        return [cam_T_obj, *(move_pose(cam_T_obj, part.box_centre, step) for step in steps)]


@dataclass(frozen=True)
class SearchPlan:
    """How a search goes.

    Attributes:
        levels: of the first solutions.
        finalists: how many of these are refined.
        last_levels: of the refinement; None for the method's own.
    """

    levels: tuple[Level, ...]
    finalists: int
    last_levels: tuple[Level, ...] | None = None


def search(
    solver: PoseSolver,
    seen: SeenFrame,
    starts: Iterable[Estimate],
    plan: SearchPlan,
    score: Callable[[Solution], float],
) -> Solution | None:
    """The refined solution with the highest score; None when no start sees the part."""
    clock = Stopwatch()
    solved = _ranked((solver.solve(seen, start, clock, plan.levels) for start in starts), score)
    finals = (solver.solve(seen, first.estimate, clock, plan.last_levels) for first in solved[: plan.finalists])
    refined = _ranked(finals, score)
    return next(iter(refined or solved), None)


def search_around(
    solver: PoseSolver, seen: SeenFrame, cam_T_obj: FloatArray, turn_deg: float, finalists: int
) -> Solution | None:
    """The best solution from a pose (4, 4) and 14 poses turned about axes and diagonals, by agreement."""
    steps = np.concatenate([_turns(np.radians(turn_deg)), np.zeros((15, 3))], 1)
    starts = [seen.view.at_pose(move_pose(cam_T_obj, solver.part.box_centre, step)) for step in steps]
    plan = SearchPlan(WIDE_LEVELS, finalists)
    return search(
        solver, seen, starts, plan, lambda solution: solver.agreement(seen, _as_pose(solution), AGREEMENT_LEVEL)
    )


def search_cloud(
    solver: PoseSolver, seen: SeenFrame, cam_T_obj: FloatArray, cloud: Cloud, ranking: Ranking
) -> Solution | None:
    """The best solution from a cloud around a pose (4, 4), by a ranking; None when none of its poses sees the part.

    A wide level moves a pose that is nearly right to edges that are not its own. So only those of the cloud that the
    frame agrees with best are solved, without the widest level, and what was found is refined by fine levels alone.
    The frame is looked at afresh: how far lines across the outline are free is asked once, and not at poses of a cloud.
    """
    seen = solver.afresh(seen)
    plan = SearchPlan(CLOUD_LEVELS, cloud.finalists, _FINE_LEVELS)
    poses = cloud.around(cam_T_obj, solver.part)
    return search_among(solver, seen, poses, seen.view.at_pose, cloud.solved, plan, ranking)


def solutions_in_cloud(solver: PoseSolver, seen: SeenFrame, cam_T_obj: FloatArray, cloud: Cloud) -> list[Solution]:
    """What a cloud around a pose (4, 4) leads to, by score, the best first; empty where nothing is solved.

    Like `search_cloud`, for a part whose look is known: which pose is right, its score says far more surely than its
    agreement, but only once a pose is near. So all that were solved are refined, and of these the finalists once more,
    with regions first, which lead on from farther off than fine levels do.
    """
    seen, clock = solver.afresh(seen), Stopwatch()
    starts = _most_agreeable(solver, seen, cloud.around(cam_T_obj, solver.part), seen.view.at_pose, cloud.solved)

    def solved(estimates: Iterable[Estimate], levels: tuple[Level, ...]) -> list[Solution]:
        return _ranked((solver.solve(seen, at, clock, levels) for at in estimates), lambda found: found.score)

    wide = solved(starts, CLOUD_LEVELS)
    fine = solved((found.estimate for found in wide), _FINE_LEVELS)
    again = solved((found.estimate for found in fine[: cloud.finalists]), (*REGIONS_FIRST, *_FINE_LEVELS))
    return sorted([*fine, *again], key=lambda found: -found.score)


def search_on(
    solver: PoseSolver, look: Look, seen: SeenFrame, cloud: Cloud, clouds: int, ranking: Ranking
) -> tuple[SeenFrame, Solution] | None:
    """The best solution from a cloud around the prior of a frame's view, or from at most `clouds` clouds on from there.

    A pose that is found at the rim of what was searched is rarely the right one. Then a wider cloud is searched around
    the same prior, and, as long as what that finds is at its rim, another around that. With the frame around the place
    where it was found; None when no pose of the first cloud leads to one that is plausible there.
    """
    prior = middle = seen.view.prior
    found = search_cloud(solver, seen, prior, cloud, ranking)
    if found is None or not is_plausible(found.cam_T_obj, prior, solver.part):
        return None
    searched, wider = cloud, cloud.wider
    for number in range(1, clouds):
        if searched.reaches(middle, found.cam_T_obj, solver.part):
            break
        place = prior if number == 1 else found.cam_T_obj
        around_place = look(place)
        farther = None if around_place is None else search_cloud(solver, around_place, place, wider, ranking)
        there = None
        if farther is not None and is_plausible(farther.cam_T_obj, place, solver.part):
            there = look(farther.cam_T_obj)
        if farther is not None and there is not None and _is_better(solver, there, farther, found, ranking):
            seen, searched, middle, found = there, wider, place, farther
        elif number > 1:
            break
    return seen, found


def _is_better(solver: PoseSolver, seen: SeenFrame, one: Solution, other: Solution, ranking: Ranking) -> bool:
    """Whether a solution of a frame ranks higher than another."""
    rank_of_one, rank_of_other = (
        ranking(solver, seen, seen.view.at_pose(solution.cam_T_obj), AGREEMENT_LEVEL) for solution in (one, other)
    )
    return rank_of_one > rank_of_other


def search_among(
    solver: PoseSolver,
    seen: SeenFrame,
    poses: Iterable[FloatArray],
    at_pose: Callable[[FloatArray], Estimate],
    solved: int,
    plan: SearchPlan,
    ranking: Ranking,
    look: Level = LOOK_AROUND,
    judge: Level = AGREEMENT_LEVEL,
) -> Solution | None:
    """The best solution from poses (4, 4); None when none of them sees the part.

    at_pose: the estimate of a pose. solved: from how many the solver runs, those that the frame agrees with best.
    look: how closely poses are looked at; ranking, judge: what solutions are compared by, and how closely.
    """
    starts = _most_agreeable(solver, seen, poses, at_pose, solved, look)
    return search(
        solver, seen, starts, plan, lambda solution: ranking(solver, seen, at_pose(solution.cam_T_obj), judge)
    )


def ring(cam_T_obj: FloatArray, centre_obj: FloatArray, camera: Camera, shift_px: float) -> tuple[FloatArray, ...]:
    """Poses (4, 4) whose part appears `shift_px` away from that of `cam_T_obj`, in a ring of eight directions."""
    angles = 2.0 * np.pi * np.arange(_RING) / _RING
    return tuple(shifted(cam_T_obj, centre_obj, camera, shift_px * np.array([np.cos(a), np.sin(a)])) for a in angles)


def shifted(cam_T_obj: FloatArray, centre_obj: FloatArray, camera: Camera, shift_px: FloatArray) -> FloatArray:
    """The pose (4, 4) whose part appears `shift_px` (2,) away from that of `cam_T_obj`, at its distance."""
    across = shift_px * transform(cam_T_obj, centre_obj)[2] / (camera.fx, camera.fy)
    return move_pose(cam_T_obj, centre_obj, np.array([0.0, 0.0, 0.0, *across, 0.0]))


def is_plausible(cam_T_obj: FloatArray, last: FloatArray, part: Part) -> bool:
    """Whether a pose (4, 4) can follow the last one at all; a diverged solution never can."""
    step = np.empty(6)
    step_between(plain(last), plain(cam_T_obj), plain(part.box_centre), step)
    turn, shift = math.hypot(*step[:3]), math.hypot(*step[3:])
    return math.degrees(turn) < _LARGEST_TURN_DEG and shift < 2.0 * part.radius


def lies_elsewhere(cam_T_obj: FloatArray, other: FloatArray, part: Part) -> bool:
    """Whether two poses (4, 4) are farther apart than two solutions of one place are."""
    step = pose_step_between(cam_T_obj, other, part.box_centre)
    return float(np.linalg.norm(step[:3])) * part.radius + float(np.linalg.norm(step[3:])) > _ELSEWHERE * part.radius


def better(first: Solution | None, second: Solution | None) -> Solution | None:
    """The one with the higher score; of equals the first."""
    if first is None or second is None:
        return first or second
    return second if second.score > first.score else first


def _most_agreeable(
    solver: PoseSolver,
    seen: SeenFrame,
    poses: Iterable[FloatArray],
    at_pose: Callable[[FloatArray], Estimate],
    count: int,
    look: Level = LOOK_AROUND,
) -> list[Estimate]:
    """The estimates of those poses (4, 4) that the frame agrees with best, the best first."""
    estimates = sorted(map(at_pose, poses), key=lambda at: -solver.agreement(seen, at, look))
    return estimates[:count]


def _ranked(solutions: Iterable[Solution | None], score: Callable[[Solution], float]) -> list[Solution]:
    """Those that exist, the best first."""
    return sorted((solution for solution in solutions if solution is not None), key=lambda s: -score(s))


def _as_pose(solution: Solution) -> Estimate:
    return solution.estimate.view.at_pose(solution.cam_T_obj)


def _turns(angle_rad: float) -> FloatArray:
    """(15, 3) rotation vectors: none, about both senses of the three axes, about the four diagonals."""
    grid = np.array([[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)], np.float64)
    count = np.abs(grid).sum(1)
    axes = grid[(count == 1) | (count == 3)]
    return np.concatenate([np.zeros((1, 3)), angle_rad * axes / np.linalg.norm(axes, axis=1, keepdims=True)])
