"""The first frame: is the start pose exact enough to learn from, and if not, where is the part?

A start pose is trusted when the frame agrees with it nearly as well as with the pose that the solver would rather
have, and the two lie within a pixel or so: then the difference is the edges' own offset, not an error of the pose,
and the offsets can be measured. They may lie somewhat further apart where the frame agrees with both equally: what
the image cannot tell, whoever gave the pose can. And nothing in a cloud of poses around it, or in the wider ones
that are searched from there (`search.search_on`), may agree clearly better: from a poor start the solver can end as far
from the part as it began. Otherwise the best of those clouds wins, compared both ways (`search.both_ways`), and its
pose is weighed against the given one (`weighed_start`), as it is where the frame agrees with both well, but they lie
apart: half a degree off, a start is good enough to tell which edges are the part's, not where they lie.

A start that was found in the frame itself, by the detector or by snap, says no more than the frame does: the solver
agrees with it however far off its distance is, and offsets measured there would keep the error. So it is never trusted,
nor weighed: the best of the clouds counts.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from acp_lab.errors import TrackingError
from acp_lab.geometry.pose import transform
from acp_lab.tracking.learning.knowledge import Off
from acp_lab.tracking.schedule import EVERY_SAMPLE, Level
from acp_lab.tracking.search import AGREEMENT_LEVEL, Cloud, Look, PoseSolver, Ranking, both_ways, one_way, search_on
from acp_lab.tracking.solution import SeenFrame, Solution
from acp_lab.tracking.stopwatch import Stopwatch
from acp_lab.tracking.weighed_start import weighed_start


@dataclass(frozen=True)
class Contradiction:
    """What contradicts a pose: a hypothesis with that score, so many times that of the pose."""

    score: float
    times: float


@dataclass(frozen=True)
class SecondOpinion:
    """Configuration: where a start is not trusted the detector is asked, too, see `second_opinion`.

    Not of parts whose views are not stored (prepared by an earlier version): a first frame would have to wait for them.

    Attributes:
        within_deg, depth_ratio, around_px: how far from the start pose it looks, see `PosePrior`.
        near, far: what contradicts a pose found as near the start as a search around it reaches; one found beyond.
        apart_below: what is in another place contradicts only where the part is less likely than that in the place in
            question; above 1, it always does.
    """

    kind: ClassVar[str] = "detector"
    within_deg: float = 40.0
    depth_ratio: float = 1.15
    around_px: float = 120.0
    near: Contradiction = Contradiction(0.3, 20.0)
    far: Contradiction = Contradiction(0.15, 3.0)
    apart_below: float = 0.5

    def __post_init__(self) -> None:
        checks = (
            ("within_deg", 0.0 < self.within_deg <= 180.0, self.within_deg, "degrees above 0, at most 180"),
            ("depth_ratio", 1.0 <= self.depth_ratio <= 100.0, self.depth_ratio, "1 to 100"),
            ("around_px", 0.0 <= self.around_px <= 1e4, self.around_px, "px from 0 to 10000"),
            ("near.score", 0.0 <= self.near.score <= 1.0, self.near.score, "0 to 1"),
            ("near.times", 1.0 <= self.near.times <= 1e6, self.near.times, "1 to 1e6"),
            ("far.score", 0.0 <= self.far.score <= 1.0, self.far.score, "0 to 1"),
            ("apart_below", 0.0 <= self.apart_below <= 2.0, self.apart_below, "0 to 1, or 2 for always"),
            ("far.times", 1.0 <= self.far.times <= 1e6, self.far.times, "1 to 1e6"),
        )
        for name, good, value, wanted in checks:
            if not good:
                raise TrackingError(f"start.second_opinion.{name} = {value:g}: give {wanted}")


@dataclass(frozen=True)
class TrustedStart:
    """Configuration: trust an exact start pose and learn from it, search around another one.

    Attributes:
        agreement: least ratio of the frame's agreement with the start pose to that with the solved pose.
        equal_agreement: ratio from which on the limits below are `EQUAL_SLACK` times as wide. Starts from truth had
            0.99 (median of 33 sequences), those 1 degree and 1 mm off 0.70.
        largest_shift_px: rms motion of the edge points along their normals between the two poses, without its scale
        part.
        largest_scale: relative change of apparent size between the two poses.
        turn_deg, finalists: of the cloud of poses around the start, see `search.Cloud`.
        agreement_alone: ratio from which on the start is trusted, however far the two poses lie apart, but weighed;
            infinite for none.
        bias_in_breaks: how far edges lie beside where they are expected, in edge breaks of the part; by it a start that
            is not exact is weighed against what was found, see `weighed_start`; 0 for never.
        measures: whether offsets are measured also at a pose that is no trusted start.
        shift_share, poses, solved: of the cloud, see `search.Cloud`.
        clouds: how many are searched at most, wider ones where what was found lies at the rim, see `search.search_on`.
        both_ways: whether what is found in clouds is compared by agreement both ways, see `search.both_ways`.
        surpassed: share of the best agreement in the clouds below which a start is not trusted.
        second_opinion: of a start that is not trusted.
    """

    kind: ClassVar[str] = "trusted"
    agreement: float = 0.9
    equal_agreement: float = 0.97
    largest_shift_px: float = 0.85
    largest_scale: float = 0.025
    turn_deg: float = 4.5
    finalists: int = 3
    agreement_alone: float = 0.8
    bias_in_breaks: float = 0.5
    measures: bool = False
    shift_share: float = 0.06
    poses: int = 120
    solved: int = 12
    clouds: int = 6
    both_ways: bool = True
    surpassed: float = 0.7
    second_opinion: SecondOpinion | Off = field(default_factory=SecondOpinion)

    def __post_init__(self) -> None:
        for name in ("largest_shift_px", "largest_scale"):
            if not 1e-6 <= getattr(self, name) <= 1e6:
                raise TrackingError(f"start.{name} = {getattr(self, name):g}: give more than 0")
        if not 0.0 <= self.bias_in_breaks <= 100.0:
            raise TrackingError(f"start.bias_in_breaks = {self.bias_in_breaks:g}: give 0 to 100")
        if not 0.0 <= self.surpassed <= 1.0:
            raise TrackingError(f"start.surpassed = {self.surpassed:g}: give 0 to 1")
        if not 1 <= self.clouds <= 100:
            raise TrackingError(f"start.clouds = {self.clouds:g}: give 1 to 100")
        self.cloud.check("start.")

    @property
    def cloud(self) -> Cloud:
        """Where the part is searched."""
        return Cloud(self.turn_deg, self.shift_share, self.poses, self.solved, self.finalists)

    @property
    def ranking(self) -> Ranking:
        """What the poses found there are compared by."""
        return both_ways if self.both_ways else one_way


EQUAL_SLACK = 1.4
_NEVER = float("inf")
# For judging and for learning: near their expected places.
LOOK_LEVEL = Level(6, 1.0, EVERY_SAMPLE)


@dataclass(frozen=True, eq=False)
class Started:
    """The solution of the first frame.

    seen: the frame around it. trusted: its pose is the given one, or near it. measures: offsets of edges can be
    measured at it. note: what is said of it.
    """

    seen: SeenFrame
    solution: Solution
    trusted: bool
    measures: bool
    note: str = ""


def begin(
    solver: PoseSolver, look: Look, seen: SeenFrame, config: TrustedStart, clock: Stopwatch, found_there: bool = False
) -> Started | None:
    """The first frame, from its view's prior; None where the part is not seen there.

    look: at other places of it. found_there: whether the prior was found in this frame.
    """
    view = seen.view
    solved = solver.solve(seen, view.at_pose(view.prior), clock)
    if solved is None:
        return None
    solved = solver.settle(seen, solved, clock)
    there, found = search_on(solver, look, seen, config.cloud, config.clouds, config.ranking) or (seen, None)
    found = solved if found is None else solver.settle(there, found, clock)
    ratio = _agreement_ratio(solver, seen, there, found)
    trusted = not found_there and is_trusted(solver, seen, solved, config) and ratio >= config.surpassed
    pose = view.prior if trusted else found.cam_T_obj
    there = seen if trusted else there
    is_exact = trusted and is_trusted(solver, seen, solved, replace(config, agreement_alone=_NEVER))
    matches, bias_mm = found.judgement.matches, config.bias_in_breaks * solver.edge_break_mm
    if not (is_exact or found_there) and bias_mm and matches is not None:
        ratio = min(ratio, _agreement_ratio(solver, seen, seen, solved))
        # A frame agrees with a start that is far off by chance; that says nothing of how far.
        pose = weighed_start(view, found.cam_T_obj, matches, bias_mm, ratio if there is seen else None)
    # Where the search left the image, stay with what the given pose led to.
    looked = solver.look_at(there, there.view.at_pose(pose), LOOK_LEVEL, clock)
    if looked is None:
        there, looked = seen, solved
    if not trusted:
        looked = replace(looked, steps=found.steps, iterations=found.iterations)
    return Started(there, looked, trusted, trusted or config.measures)


def _agreement_ratio(solver: PoseSolver, seen: SeenFrame, there: SeenFrame, best: Solution) -> float:
    """How well the frame agrees with the prior of its view, as a share of how well with a solution found in another."""
    at_start, at_best = (
        solver.agreement(frame, frame.view.at_pose(pose), AGREEMENT_LEVEL)
        for frame, pose in ((seen, seen.view.prior), (there, best.cam_T_obj))
    )
    return at_start / max(at_best, 1e-9)


def is_trusted(solver: PoseSolver, seen: SeenFrame, solved: Solution, config: TrustedStart) -> bool:
    """Whether the prior of a frame's view is exact but for the offsets of the edges themselves."""
    view, matches = seen.view, solved.judgement.matches
    if matches is None:
        return False
    before, after = (
        view.camera.project(transform(pose, matches.points_obj)) for pose in (view.prior, solved.cam_T_obj)
    )
    arms, shift = before - before.mean(0), after - before
    # Biased edges mostly change the apparent size; a wrong pose also shifts and shears.
    scale = float((arms * shift).sum() / max(float((arms * arms).sum()), 1e-9))
    # Along the normals: sliding along the edges, such as a round part's roll, is no error that they could show.
    rest_px = float(np.sqrt((((shift - scale * arms) * matches.normals).sum(1) ** 2).mean()))
    away = max(rest_px / config.largest_shift_px, abs(scale) / config.largest_scale)
    if away >= EQUAL_SLACK and config.agreement_alone == _NEVER:
        return False
    at_start, at_solved = (
        solver.agreement(seen, view.at_pose(pose), AGREEMENT_LEVEL) for pose in (view.prior, solved.cam_T_obj)
    )
    needed = config.agreement if away < 1.0 else config.equal_agreement if away < EQUAL_SLACK else _NEVER
    return at_start > 0.0 and at_start >= min(needed, config.agreement_alone) * at_solved
