"""A second look when the fit suddenly gets worse: start also from poses beside the expected one.

On a patterned background the solver can lock on to wrong edges when the part moves further than expected. The
memory of what
each edge looked like then says so: the quality drops. Coarse solutions from a ring of shifted poses are compared by
quality, and the best is refined. While the part is lost, a wide search around its last pose joins in, less and less
often.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

from acp_lab.geometry.arrays import FloatArray
from acp_lab.tracking.schedule import Level
from acp_lab.tracking.search import PoseSolver, SearchPlan, better, is_plausible, ring, search, search_around
from acp_lab.tracking.solution import SeenFrame, Solution
from acp_lab.tracking.stopwatch import Stopwatch

RING_PLAN = SearchPlan((Level(14, 4.0), Level(7, 1.5)), 1, (Level(8, 2.0), Level(5, 1.0)))


@dataclass(frozen=True)
class SecondTries:
    """Configuration: where else to start when a frame fits worse than usual.

    Attributes:
        below: share of the running mean quality below which the part is also sought where it was last, and, if that
            is no better, `shift_px` around there.
        turn_deg, finalists: of the wide search while the part is lost, see `start.TrustedStart`.
    """

    kind: ClassVar[str] = "second-tries"
    below: float = 0.8
    shift_px: float = 14.0
    turn_deg: float = 4.0
    finalists: int = 3


@dataclass(frozen=True, eq=False)
class Situation:
    """What a second try knows of the track so far.

    Attributes:
        last: (4, 4) the last pose; moves: whether the first try began elsewhere.
        mean_quality: running mean; time_to_search: whether a wide search is due.
    """

    last: FloatArray
    moves: bool
    mean_quality: float
    time_to_search: bool


def recover(
    solver: PoseSolver,
    first: Solution | None,
    look: Callable[[FloatArray], SeenFrame | None],
    situation: Situation,
    config: SecondTries,
    clock: Stopwatch,
) -> Solution | None:
    """The first try, or a better one.

    Args:
        first: what the prediction led to, None where it led nowhere.
        look: gives the frame around a pose (4, 4).
    """
    floor, last = config.below * situation.mean_quality, situation.last
    if first is not None and first.judgement.quality >= floor:
        return first

    def plausible(solution: Solution | None) -> Solution | None:
        return solution if solution and is_plausible(solution.cam_T_obj, last, solver.part) else None

    seen = look(last)
    if seen is None:
        return first
    best, view = first, seen.view
    if situation.moves:  # else the first try began there
        best = better(best, plausible(solver.solve(seen, view.at_pose(last), clock)))
    if best is None or best.judgement.quality < floor:
        starts = [view.at_pose(pose) for pose in ring(last, solver.part.box_centre, view.camera, config.shift_px)]
        best = better(best, plausible(search(solver, seen, starts, RING_PLAN, lambda s: s.judgement.quality)))
    if situation.time_to_search:
        best = better(best, plausible(search_around(solver, seen, last, config.turn_deg, config.finalists)))
    return best
