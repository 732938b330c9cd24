"""A second look when the fit suddenly gets worse: start also from other poses, and with other weights.

On a patterned background the solver can lock on to wrong edges when the part moves further than expected. The memory
of what each edge looked like then says so: the quality drops. `SecondTries` starts also from the last pose and from a
ring around it; while the part is lost and no `way_back` looks for it, a wide search around its last pose joins
in, less and less often.
`Alternatives`, for methods that see regions too, lets these go first, without the motion prior. Where even these fit
far worse, the part may have moved or turned further than any of them reaches: then a cloud of poses is searched, and a
wide one where that shows nothing that fits well and the frame before did. What fits badly even there is taken where it
stands out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import ClassVar

from acp_lab.cad.part import Part
from acp_lab.errors import TrackingError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.tracking.schedule import Level
from acp_lab.tracking.search import (
    REGIONS_FIRST,
    Cloud,
    Look,
    PoseSolver,
    SearchPlan,
    better,
    is_plausible,
    lies_elsewhere,
    ring,
    search,
    search_around,
    solutions_in_cloud,
)
from acp_lab.tracking.solution import SeenFrame, Solution
from acp_lab.tracking.stopwatch import Stopwatch

RING_PLAN = SearchPlan((Level(14, 4.0), Level(7, 1.5)), 1, (Level(8, 2.0), Level(5, 1.0)))


@dataclass(frozen=True)
class SecondTries:
    """Configuration: where else to start when a frame fits worse than usual.

    Attributes:
        below: share of the running mean quality below which the part is also sought where it was last, and, if that
            is no better, `shift_px` around there.
        turn_deg, finalists: of the wide search while the part is lost, see `search.search_around`.
    """

    kind: ClassVar[str] = "second-tries"
    below: float = 0.8
    shift_px: float = 14.0
    turn_deg: float = 4.0
    finalists: int = 3

    def __post_init__(self) -> None:
        for name in ("below", "shift_px", "turn_deg"):
            if not 0.0 <= getattr(self, name) <= 1000.0:
                raise TrackingError(f"recovery.{name} = {getattr(self, name):g}: give 0 to 1000")
        if not 1 <= self.finalists <= 100:
            raise TrackingError(f"recovery.finalists = {self.finalists}: give 1 to 100")

    def is_content_with(self, first: Solution | None, mean_quality: float, mean_score: float) -> bool:
        """Whether the first try fits well enough, beside running means, that nothing else is tried."""
        return first is not None and first.judgement.quality >= self.below * mean_quality


LAST_LEVEL = (Level(5, 1.0, 600),)


@dataclass(frozen=True)
class Alternatives:
    """Configuration: alternatives to a frame that fits worse than usual, none of them held by the motion prior.

    Attributes:
        below: share of the running mean score below which alternatives are tried.
        slack: how much worse than the first try an alternative may be before its last level.
        gain: how much better it must be in the end.
        innovation_cost: score that a unit of normalised squared innovation costs, up to `most_innovation` units.
        cloud_below: share of the running mean score. Where neither the first try nor an alternative reaches it, a cloud
            around the predicted pose is searched, and the best of that must reach it before its last level; 0 for
            never.
        cloud: its poses.
        wide_below: share of the running mean score. Where the best of the cloud does not reach it, and the frame
            before did, a wide one is searched as well, and only what reaches it there is taken for better: among so
            many poses some fit better than the true one of a covered part. 0 for never.
        wide_cloud: its poses.
        stands_out_above, stands_out_by: shares of the running mean score. What reaches neither of these is taken all
            the same where it is above the first, and above all that was found elsewhere by the second: in a frame
            smeared by motion even the true pose fits far worse than usual, but no other fits nearly as well.
    """

    kind: ClassVar[str] = "alternatives"
    below: float = 0.7
    slack: float = 0.05
    gain: float = 0.03
    innovation_cost: float = 0.003
    most_innovation: float = 100.0
    cloud_below: float = 0.5
    cloud: Cloud = field(default_factory=lambda: Cloud(5.0, 0.3, 60, 6, 4))
    wide_below: float = 0.65
    wide_cloud: Cloud = field(default_factory=lambda: Cloud(15.0, 0.4, 300, 12, 4))
    stands_out_above: float = 0.35
    stands_out_by: float = 0.1

    def __post_init__(self) -> None:
        for name in (
            "below", "slack", "gain", "innovation_cost", "most_innovation", "cloud_below", "wide_below",
            "stands_out_above", "stands_out_by",
        ):  # fmt: skip
            if not 0.0 <= getattr(self, name) < float("inf"):
                raise TrackingError(f"recovery.{name} = {getattr(self, name):g}: give 0 or more")
        self.cloud.check("recovery.cloud.")
        self.wide_cloud.check("recovery.wide_cloud.")

    def is_content_with(self, first: Solution | None, mean_quality: float, mean_score: float) -> bool:
        """Whether the first try fits well enough, beside running means, that nothing else is tried."""
        return first is not None and first.score >= self.below * mean_score


@dataclass(frozen=True)
class WayBack:
    """Configuration: the detector looks for a part that is lost, see `way_back`, and around one that fits poorly.

    Attributes:
        budget: work per frame, see `detection.work`: at most as many microseconds.
        late_frames: frames for which a lost part is looked for with that budget; from then on with late_budget.
        proposals: hypotheses of a search that are tried.
        least_score: that a hypothesis must have for that; least_score_near: of a search nearby, which aligns nothing.
        poor_below, poor_frames: so many frames in a row of a quality below that, and the detector looks around the
            part, though it is not lost, see `second_thoughts`; 0 frames for never.
        remembered_frames: for so many frames it is known what else stood around the part, see `look_alikes`; 0 for
            never.
    """

    kind: ClassVar[str] = "detector"
    budget: float = 25_000.0
    late_frames: int = 15
    late_budget: float = 50_000.0
    proposals: int = 1
    least_score: float = 0.35
    least_score_near: float = 0.2
    poor_below: float = 0.85
    poor_frames: int = 5
    remembered_frames: int = 300

    def __post_init__(self) -> None:
        for name in ("budget", "late_budget"):
            if not 0.0 < getattr(self, name) < float("inf"):
                raise TrackingError(f"way_back.{name} = {getattr(self, name):g}: give a number above 0")
        if not 1 <= self.proposals <= 100:
            raise TrackingError(f"way_back.proposals = {self.proposals}: give 1 to 100")
        if self.late_frames < 0:
            raise TrackingError(f"way_back.late_frames = {self.late_frames}: give 0, for at once, or more")
        for name in ("poor_frames", "remembered_frames"):
            if getattr(self, name) < 0:
                raise TrackingError(f"way_back.{name} = {getattr(self, name)}: give 0, for never, or more")
        for name in ("least_score", "least_score_near", "poor_below"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise TrackingError(f"way_back.{name} = {getattr(self, name):g}: give 0 to 1")


@dataclass(frozen=True, eq=False)
class Situation:
    """What a second try knows of the track so far.

    Attributes:
        predicted, last: (4, 4) the predicted and the last pose; moves: whether they differ.
        mean_quality, mean_score: running means.
        last_score: of the frame before.
        is_lost: whether the part is; time_to_search: whether a wide search is due then.
        innovation: of a pose (4, 4), squared, normalised, per degree of freedom.
    """

    predicted: FloatArray
    last: FloatArray
    moves: bool
    mean_quality: float
    mean_score: float
    last_score: float
    is_lost: bool
    time_to_search: bool
    innovation: Callable[[FloatArray], float]


def recover(
    solver: PoseSolver,
    first: Solution | None,
    look: Look,
    situation: Situation,
    config: SecondTries | Alternatives,
    clock: Stopwatch,
) -> Solution | None:
    """The first try, or a better one; first: what the prediction led to, None where it led nowhere."""
    if config.is_content_with(first, situation.mean_quality, situation.mean_score):
        return first
    if isinstance(config, SecondTries):
        return _second_tries(solver, first, look, situation, config, clock)
    return _alternatives(solver, first, look, situation, config, clock)


def _second_tries(
    solver: PoseSolver,
    first: Solution | None,
    look: Look,
    situation: Situation,
    config: SecondTries,
    clock: Stopwatch,
) -> Solution | None:
    floor, last = config.below * situation.mean_quality, situation.last

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
        best = better(best, plausible(search(solver, seen, starts, RING_PLAN, lambda s: s.score)))
    if situation.time_to_search:
        best = better(best, plausible(search_around(solver, seen, last, config.turn_deg, config.finalists)))
    return best


def _alternatives(
    solver: PoseSolver,
    first: Solution | None,
    look: Look,
    situation: Situation,
    config: Alternatives,
    clock: Stopwatch,
) -> Solution | None:
    found = list(_other_tries(solver, look, situation, clock))
    tries = [max(found, key=lambda one: one[1].score)] if found else []
    reached = max([first.score if first else 0.0, *(solution.score for _, solution in tries)])
    scattered = _in_cloud(solver, reached, look, situation, config, clock)
    for seen, promising in tries if scattered is None else [scattered, *tries]:
        refined = _refined(solver, seen, promising, first, situation, config, clock)
        if refined is not None:
            return refined
    return first


def _refined(
    solver: PoseSolver,
    seen: SeenFrame,
    promising: Solution,
    first: Solution | None,
    situation: Situation,
    config: Alternatives,
    clock: Stopwatch,
) -> Solution | None:
    """A promising solution after its last level; None where it is not plausible, or not better than the first try."""
    if first is not None and promising.score <= first.score - config.slack:
        return None
    refined = solver.solve(seen, seen.view.at_pose(promising.cam_T_obj), clock, LAST_LEVEL)
    if refined is None or not is_plausible(refined.cam_T_obj, situation.last, solver.part):
        return None
    innovation = min(situation.innovation(refined.cam_T_obj), config.most_innovation)
    if first is not None and refined.score - config.innovation_cost * innovation <= first.score + config.gain:
        return None
    return refined


def _in_cloud(
    solver: PoseSolver,
    reached: float,
    look: Look,
    situation: Situation,
    config: Alternatives,
    clock: Stopwatch,
) -> tuple[SeenFrame, Solution] | None:
    """The best of a cloud around the predicted pose, or of a wide one; None where it is not due, or nothing fits.

    reached: the best score so far.
    """
    least = config.cloud_below * situation.mean_score
    if least <= 0.0 or reached >= least or (situation.is_lost and not situation.time_to_search):
        return None
    seen = look(situation.predicted)
    if seen is None:
        return None
    clock.lap()
    found = solutions_in_cloud(solver, seen, situation.predicted, config.cloud)
    best = _reaching(least, found)
    well = config.wide_below * situation.mean_score
    if well > 0.0 and not situation.is_lost and _reaching(well, found) is None:
        # What is not found at the leap is covered, or the detector looks for it soon.
        if situation.last_score >= well:
            found += solutions_in_cloud(solver, seen, situation.predicted, config.wide_cloud)
            found.sort(key=lambda solution: -solution.score)
        best = _reaching(well, found) or best or _standing_out(found, reached, situation, config, solver.part)
    clock.search_s += clock.lap()
    return None if best is None else (seen, best)


def _reaching(least: float, found: list[Solution]) -> Solution | None:
    """The best of what was found; None where it fits too badly for a part in sight."""
    return found[0] if found and found[0].score >= least else None


def _standing_out(
    found: list[Solution], reached: float, situation: Situation, config: Alternatives, part: Part
) -> Solution | None:
    """The best of what was found, where it fits better by far than all else does, see `Alternatives.stands_out_by`."""
    best = found[0] if found else None
    if best is None or best.score < config.stands_out_above * situation.mean_score:
        return None
    elsewhere = (one.score for one in found if lies_elsewhere(one.cam_T_obj, best.cam_T_obj, part))
    others = max(reached, next(elsewhere, reached))
    return best if best.score > others + config.stands_out_by * situation.mean_score else None


def _other_tries(
    solver: PoseSolver, look: Look, situation: Situation, clock: Stopwatch
) -> Iterator[tuple[SeenFrame, Solution]]:
    """Regions first, from the predicted pose and from the last one, where that is another."""
    for pose in (situation.predicted, situation.last) if situation.moves else (situation.predicted,):
        seen = look(pose)
        if seen is None:
            continue
        solution = solver.solve(seen, seen.view.at_pose(pose), clock, REGIONS_FIRST)
        if solution is not None:
            yield seen, solution
