"""A second look when the fit suddenly gets worse: when it comes, from where, and which pose it gives."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest

from acp_lab.cad.part import Part
from acp_lab.errors import TrackingError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import transform
from acp_lab.geometry.pose_step import move_pose
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.frame_view import Estimate, View
from acp_lab.tracking.learning.knowledge import Off
from acp_lab.tracking.method import ACP, Method
from acp_lab.tracking.recovery import LAST_LEVEL, Alternatives, SecondTries, Situation, recover
from acp_lab.tracking.schedule import Level
from acp_lab.tracking.search import REGIONS_FIRST, WIDE_LEVELS, Cloud
from acp_lab.tracking.solution import SeenFrame, Solution
from acp_lab.tracking.stopwatch import Stopwatch
from acp_lab.tracking.tracker import Tracker
from tests.made_parts import looking_at
from tests.tracking.rendered import CAMERA, MadeSequence, add_percent, draw
from tests.tracking.views import view_at

CONFIG = SecondTries(below=0.8, shift_px=14.0, turn_deg=4.0, finalists=2)


@dataclass
class Said:
    """A judgement of which the quality and the score are all that is asked."""

    quality: float

    @property
    def score(self) -> float:
        return self.quality


@dataclass
class Scripted:
    """Leaves estimates where they are; from the last pose, from beside it and from turned poses it fits as told."""

    part: Part
    last: FloatArray
    at_last: float = 0.0
    beside: float = 0.0
    turned: float = 0.0
    jumps: bool = False
    tried: list[str] = field(default_factory=list)

    def kind(self, start: Estimate) -> str:
        pose = start.cam_T_obj
        if np.abs(pose - self.last).max() < 1e-9:
            return "last"
        return "beside" if np.abs(pose[:3, :3] - self.last[:3, :3]).max() < 1e-9 else "turned"

    def solve(self, seen: SeenFrame, start: Estimate, clock: Any, levels: tuple[Level, ...] | None = None) -> Solution:
        kind = "turned" if levels == WIDE_LEVELS else self.kind(start)
        self.tried.append(kind)
        found = {"last": self.at_last, "beside": self.beside, "turned": self.turned}[kind]
        if self.jumps:
            away = move_pose(start.cam_T_obj, self.part.box_centre, np.array([0.0, 0, 0, 0, 0, 3 * self.part.radius]))
            start = start.view.at_pose(away)
        return Solution(start, (Said(found),), 0.0, None)  # type: ignore[arg-type]

    def look_at(self, seen: SeenFrame, at: Estimate, level: Level, clock: Any) -> Solution | None:
        raise AssertionError("not asked for")

    def agreement(self, seen: SeenFrame, at: Estimate, level: Level) -> float:
        return 0.5


@pytest.fixture
def last(part: Part) -> FloatArray:
    return looking_at(part, np.array([0.8, 0.6, 1.0]), 330.0, 0.3)


@pytest.fixture
def view(part: Part, last: FloatArray) -> View:
    return view_at(part, last)


def first_try(view: View, quality: float) -> Solution:
    aside = move_pose(view.prior, view.part.box_centre, np.array([0.01, 0, 0, 1.0, 0, 0]))
    return Solution(view.at_pose(aside), (Said(quality),), 0.0, None)  # type: ignore[arg-type]


def recovered(
    solver: Scripted, view: View, first: Solution | None, moves: bool = True, search: bool = False, sees: bool = True
) -> Solution | None:
    situation = Situation(view.prior, solver.last, moves, 0.5, 0.5, 0.5, search, search, lambda _: 0.0)

    def look(pose: FloatArray) -> SeenFrame | None:
        assert pose is solver.last
        return SeenFrame(view, ()) if sees else None  # type: ignore[arg-type]

    return recover(solver, first, look, situation, CONFIG, Stopwatch())


def test_a_first_try_that_fits_as_usual_is_taken(part: Part, view: View, last: FloatArray) -> None:
    solver, first = Scripted(part, last, at_last=1.0), first_try(view, 0.8 * 0.5)
    assert recovered(solver, view, first, search=True) is first
    assert solver.tried == []


def test_a_worse_one_is_compared_with_a_start_from_the_last_pose(part: Part, view: View, last: FloatArray) -> None:
    solver = Scripted(part, last, at_last=0.45)
    found = recovered(solver, view, first_try(view, 0.39))
    assert found is not None
    assert found.quality == 0.45
    assert solver.tried == ["last"], "good enough: no ring"
    # Without a known motion the first try began there.
    solver = Scripted(part, last, at_last=0.45)
    recovered(solver, view, first_try(view, 0.39), moves=False)
    assert "last" not in solver.tried


def test_a_ring_of_starts_joins_in_where_that_is_no_better(part: Part, view: View, last: FloatArray) -> None:
    solver, first = Scripted(part, last, at_last=0.1, beside=0.45), first_try(view, 0.3)
    found = recovered(solver, view, first)
    assert found is not None
    assert found.quality == 0.45
    assert solver.tried == ["last"] + ["beside"] * 9  # eight coarse ones and the best of them, refined
    shown = CAMERA.project(transform(found.cam_T_obj, part.box_centre[None]))[0]
    middle = CAMERA.project(transform(last, part.box_centre[None]))[0]
    assert np.linalg.norm(shown - middle) == pytest.approx(14.0, abs=0.01)
    # The first try stays where nothing is better.
    assert recovered(Scripted(part, last), view, first) is first


def test_a_wide_search_joins_in_when_it_is_due(part: Part, view: View, last: FloatArray) -> None:
    for due in (False, True):
        solver = Scripted(part, last, turned=0.6, beside=0.2)
        found = recovered(solver, view, None, search=due)
        assert found is not None
        assert (solver.tried.count("turned") >= 15) == due
        assert due or "turned" not in solver.tried


def test_what_no_part_can_do_is_no_find(part: Part, view: View, last: FloatArray) -> None:
    solver = Scripted(part, last, at_last=0.9, beside=0.9, turned=0.9, jumps=True)
    assert recovered(solver, view, None, search=True) is None
    first = first_try(view, 0.1)
    assert recovered(solver, view, first, search=True) is first


def test_where_the_last_pose_is_not_in_view_the_first_try_stays(part: Part, view: View, last: FloatArray) -> None:
    solver, first = Scripted(part, last, at_last=1.0), first_try(view, 0.1)
    assert recovered(solver, view, first, sees=False) is first
    assert recovered(solver, view, None, sees=False) is None


def percent_off_after_a_jump(
    method: Method, step: FloatArray, part: Part, model: PreparedPart, sequence: MadeSequence
) -> float:
    """ADD in % of the diameter in the fifth frame, before which the part jumps by a step (6,) (rad, mm)."""
    frames = [frame for frame in sequence.frames(4) if isinstance(frame, Frame)]
    jumped = move_pose(sequence.truth(6, 1), part.box_centre, step)  # type: ignore[arg-type]
    tracker = Tracker(model, method)
    tracker.start(frames[0], sequence.first_pose)
    for frame in frames[1:]:
        tracker.track(frame)
    result = tracker.track(Frame(8, draw([(part, jumped)], 4), CAMERA))
    return add_percent(part, result.cam_T_obj, jumped)


def test_a_jump_is_caught_only_with_second_tries(part: Part, model: PreparedPart, sequence: MadeSequence) -> None:
    step = np.array([0.03, 0.0, 0.02, -16.0, 12.0, 0.0])
    assert percent_off_after_a_jump(ACP, step, part, model, sequence) < 2.0
    assert percent_off_after_a_jump(replace(ACP, recovery=Off()), step, part, model, sequence) > 5.0


# ---- alternatives --------------------------------------------------------------------------------------------

PATIENT = Alternatives(below=0.8, slack=0.05, gain=0.03, innovation_cost=0.01, most_innovation=10.0, cloud_below=0.0)
SEARCHING = replace(PATIENT, cloud_below=0.5, cloud=Cloud(5.0, 0.3, 20, 4, 1), wide_below=0.0)
# Poses of the first cloud only turn, so that a pose tells which cloud it is of.
SEARCHING_WIDE = replace(
    SEARCHING, cloud=Cloud(5.0, 0.0, 20, 4, 1), wide_below=0.7, wide_cloud=Cloud(15.0, 0.5, 20, 4, 1)
)


def rightmost(cloud: Cloud, predicted: FloatArray, part: Part) -> FloatArray:
    """Of a cloud's poses around a predicted one."""
    return max(cloud.around(predicted, part), key=lambda pose: transform(pose, part.box_centre)[0])


@dataclass
class Compared:
    """Leaves estimates where they are; scores are told by the pose and the levels of each try."""

    part: Part
    predicted: FloatArray
    scores: dict[str, float]
    refined: float = 0.0
    innovation: float = 0.0
    jumps: bool = False
    in_cloud: float = 0.0
    in_wide_cloud: float | None = None
    elsewhere_in_wide_cloud: float | None = None
    leads_away: bool = False
    farthest: FloatArray | None = None
    tried: list[str] = field(default_factory=list)

    def solve(
        self, seen: SeenFrame, start: Estimate, clock: Any, levels: tuple[Level, ...] | None = None
    ) -> Solution | None:
        assert seen.view.prior_information is None, "no alternative is held by the motion prior"
        if levels is LAST_LEVEL:
            self.tried.append("refined")
            score = self.refined
            if self.jumps or start.cam_T_obj is self.farthest:
                away = np.array([0.0, 0, 0, 0, 0, 3 * self.part.radius])
                start = start.view.at_pose(move_pose(start.cam_T_obj, self.part.box_centre, away))
        elif levels is not REGIONS_FIRST:
            self.tried.append("cloud")
            middles = [transform(pose, self.part.box_centre) for pose in (start.cam_T_obj, self.predicted)]
            is_wide = self.in_wide_cloud is not None and not np.allclose(*middles)
            score = self.in_wide_cloud if self.in_wide_cloud is not None and is_wide else self.in_cloud
            self.tried[-1] = "wide cloud" if is_wide else "cloud"
            if is_wide and self.elsewhere_in_wide_cloud is not None and not self.is_rightmost(start.cam_T_obj):
                score = self.elsewhere_in_wide_cloud
            if self.leads_away:
                self.farthest = start.cam_T_obj
        else:
            pose = "predicted" if start.cam_T_obj is self.predicted else "last"
            self.tried.append(pose)
            if pose not in self.scores:
                return None
            score = self.scores[pose]
        return Solution(start, (Said(score),), 0.0, None)  # type: ignore[arg-type]

    def look_at(self, seen: SeenFrame, at: Estimate, level: Level, clock: Any) -> Solution | None:
        raise AssertionError("not asked for")

    def afresh(self, seen: SeenFrame) -> SeenFrame:
        return seen

    def is_rightmost(self, pose: FloatArray) -> bool:
        return np.array_equal(pose, rightmost(SEARCHING_WIDE.wide_cloud, self.predicted, self.part))

    def agreement(self, seen: SeenFrame, at: Estimate, level: Level) -> float:
        """The farther to the right the better."""
        assert seen.view.prior is self.predicted, "the cloud is around the prediction"
        return float(transform(at.cam_T_obj, self.part.box_centre)[0])


def compared(
    solver: Compared,
    view: View,
    first: Solution | None,
    config: Alternatives = PATIENT,
    last_score: float = 1.0,
    lost: bool = False,
    due: bool = False,
    sees: bool = True,
    mean_score: float = 1.0,
    moves: bool = True,
) -> Solution | None:
    situation = Situation(
        solver.predicted,
        view.prior,
        moves,
        0.0,
        mean_score=mean_score,
        last_score=last_score,
        is_lost=lost,
        time_to_search=due,
        innovation=lambda _: solver.innovation,
    )
    return recover(
        solver,
        first,
        lambda pose: SeenFrame(replace(view, prior=pose), ()) if sees else None,  # type: ignore[arg-type]
        situation,
        config,
        Stopwatch(),
    )


@pytest.fixture
def predicted(view: View) -> FloatArray:
    return move_pose(view.prior, view.part.box_centre, np.array([0.0, 0.01, 0, 1.0, 0, 0]))


ALL_TRIES = ["predicted", "last"]


def test_no_alternative_is_tried_while_the_score_is_as_usual(part: Part, view: View, predicted: FloatArray) -> None:
    for score, tries in ((0.8, 0), (0.79, 3)):
        solver = Compared(part, predicted, dict.fromkeys(ALL_TRIES, 0.9), refined=0.9)
        first = first_try(view, score)
        assert (compared(solver, view, first) is first) == (tries == 0)
        assert len(solver.tried) == tries


def test_the_best_alternative_is_refined(part: Part, view: View, predicted: FloatArray) -> None:
    for best in ALL_TRIES:
        solver = Compared(part, predicted, {**dict.fromkeys(ALL_TRIES, 0.5), best: 0.6}, refined=0.9)
        found = compared(solver, view, first_try(view, 0.5))
        assert found is not None
        assert found.score == 0.9
        assert solver.tried == [*ALL_TRIES, "refined"]
        expected = predicted if best == "predicted" else view.prior
        np.testing.assert_array_equal(found.cam_T_obj, expected)


def test_a_part_that_rests_is_not_sought_twice_at_one_place(part: Part, view: View, predicted: FloatArray) -> None:
    solver = Compared(part, predicted, dict.fromkeys(ALL_TRIES, 0.6), refined=0.9)
    assert compared(solver, view, first_try(view, 0.5), moves=False) is not None
    assert solver.tried == ["predicted", "refined"]


@pytest.mark.parametrize("values", [{"below": -3.0}, {"shift_px": float("nan")}, {"turn_deg": -1.0}, {"finalists": 0}])
def test_second_tries_that_make_no_sense_are_refused(values: dict[str, float]) -> None:
    name, value = next(iter(values.items()))
    with pytest.raises(TrackingError, match=re.escape(f"recovery.{name} = {value:g}: give ")):
        SecondTries(**values)  # type: ignore[arg-type]


def test_an_alternative_much_worse_than_the_first_try_is_not_refined(
    part: Part, view: View, predicted: FloatArray
) -> None:
    for score, refined in ((0.449, False), (0.451, True)):
        solver, first = Compared(part, predicted, {"last": score}, refined=0.9), first_try(view, 0.5)
        assert (compared(solver, view, first) is first) != refined
        assert ("refined" in solver.tried) == refined


@pytest.mark.parametrize(("innovation", "needed"), [(0.0, 0.53), (5.0, 0.58), (10.0, 0.63), (1000.0, 0.63)], ids=str)
def test_an_alternative_must_be_better_by_more_the_less_it_was_expected(
    part: Part, view: View, predicted: FloatArray, innovation: float, needed: float
) -> None:
    for refined in (needed - 1e-3, needed + 1e-3):
        solver = Compared(part, predicted, {"last": 0.5}, refined=refined, innovation=innovation)
        first = first_try(view, 0.5)
        assert (compared(solver, view, first) is not first) == (refined > needed)


def test_no_place_far_from_the_expected_one_is_taken_for_a_part_that_is_half_hidden(
    part: Part, view: View, predicted: FloatArray
) -> None:
    """What is left of it looks like a smaller part: scores as on `metal_hard` 3, where the place was right."""
    first = first_try(view, 0.320)
    for innovation, is_taken in ((60.4, False), (5.0, True)):
        solver = Compared(part, predicted, {"predicted": 0.44}, refined=0.447, innovation=innovation)
        assert (compared(solver, view, first, Alternatives(cloud_below=0.0)) is not first) == is_taken


def test_without_a_first_try_any_plausible_alternative_will_do(part: Part, view: View, predicted: FloatArray) -> None:
    found = compared(Compared(part, predicted, {"last": 0.1}, refined=0.1, innovation=99.0), view, None)
    assert found is not None
    assert found.score == 0.1
    assert compared(Compared(part, predicted, {}), view, None) is None
    first = first_try(view, 0.1)
    assert compared(Compared(part, predicted, {}), view, first) is first
    jumping = Compared(part, predicted, {"last": 0.9}, refined=0.9, jumps=True)
    assert compared(jumping, view, first) is first
    assert compared(jumping, view, None) is None


def test_a_cloud_is_searched_where_nothing_fits_half_as_well_as_usual(
    part: Part, view: View, predicted: FloatArray
) -> None:
    for best, searched in ((0.49, True), (0.5, False)):
        for scores, first_score in (({"last": best}, 0.46), ({"last": 0.46}, best)):
            solver = Compared(part, predicted, scores, refined=0.9, in_cloud=0.6)
            found = compared(solver, view, first_try(view, first_score), SEARCHING)
            assert ("cloud" in solver.tried) == searched
            assert found is not None
            assert found.score == 0.9
            assert np.array_equal(found.cam_T_obj, rightmost(SEARCHING.cloud, predicted, part)) == searched
    without_first = Compared(part, predicted, {}, refined=0.5, in_cloud=0.5)
    assert compared(without_first, view, None, SEARCHING) is not None
    assert without_first.tried.count("cloud") == 2 * SEARCHING.cloud.solved + SEARCHING.cloud.finalists


def test_a_place_in_the_cloud_must_be_better_like_any_other(part: Part, view: View, predicted: FloatArray) -> None:
    """And it must reach what nothing else did: some place may fit better than the right one of a covered part."""
    first = first_try(view, 0.4)
    for in_cloud, refined, is_taken in ((0.49, 0.9, False), (0.5, 0.42, False), (0.5, 0.44, True)):
        solver = Compared(part, predicted, {}, refined=refined, in_cloud=in_cloud)
        assert (compared(solver, view, first, SEARCHING) is not first) == is_taken


def test_a_wide_cloud_is_searched_where_the_first_shows_nothing_that_fits_well(
    part: Part, view: View, predicted: FloatArray
) -> None:
    first = first_try(view, 0.3)
    for in_cloud, in_wide, tried, taken in (
        (0.7, 0.9, "cloud", "cloud"),
        (0.69, 0.9, "wide cloud", "wide cloud"),
        (0.69, 0.69, "wide cloud", "cloud"),
        (0.49, 0.7, "wide cloud", "wide cloud"),
        (0.49, 0.69, "wide cloud", None),
    ):
        solver = Compared(part, predicted, {}, refined=0.9, in_cloud=in_cloud, in_wide_cloud=in_wide)
        found = compared(solver, view, first, SEARCHING_WIDE)
        assert ("wide cloud" in solver.tried) == (tried == "wide cloud")
        assert found is not None
        clouds = {"cloud": SEARCHING_WIDE.cloud, "wide cloud": SEARCHING_WIDE.wide_cloud}
        of_cloud = {name: rightmost(cloud, predicted, part) for name, cloud in clouds.items()}
        assert {name for name, pose in of_cloud.items() if np.array_equal(pose, found.cam_T_obj)} == (
            set() if taken is None else {taken}
        )


def test_what_fits_better_by_far_than_all_else_is_taken_though_it_fits_badly(
    part: Part, view: View, predicted: FloatArray
) -> None:
    """In a smeared frame even the true pose does."""
    for first_score, in_wide, elsewhere, lost, is_taken in (
        (0.2, 0.36, 0.25, False, True),
        (0.2, 0.34, 0.2, False, False),  # what fits so badly may be anything
        (0.2, 0.36, 0.27, False, False),  # another place fits nearly as well
        (0.27, 0.36, 0.2, False, False),  # and so does the expected one
        (0.2, 0.36, 0.2, True, False),
    ):
        solver = Compared(
            part, predicted, {}, refined=0.9, in_cloud=0.1, in_wide_cloud=in_wide, elsewhere_in_wide_cloud=elsewhere
        )
        first = first_try(view, first_score)
        found = compared(solver, view, first, SEARCHING_WIDE, lost=lost, due=lost)
        assert found is not None
        assert (found is not first) == is_taken
        assert solver.is_rightmost(found.cam_T_obj) == is_taken


def test_no_wide_cloud_is_searched_for_a_part_that_is_lost(part: Part, view: View, predicted: FloatArray) -> None:
    for lost, searched in ((False, True), (True, False)):
        solver = Compared(part, predicted, {}, refined=0.9, in_cloud=0.4, in_wide_cloud=0.9)
        compared(solver, view, first_try(view, 0.3), SEARCHING_WIDE, lost=lost, due=lost)
        assert "cloud" in solver.tried
        assert ("wide cloud" in solver.tried) == searched


def test_a_wide_cloud_is_searched_only_after_a_frame_that_fitted_well(
    part: Part, view: View, predicted: FloatArray
) -> None:
    """A part that stays half hidden would take long in frame after frame."""
    for last_score, searched in ((0.7, True), (0.69, False)):
        solver = Compared(part, predicted, {}, refined=0.9, in_cloud=0.1, in_wide_cloud=0.36)
        compared(solver, view, first_try(view, 0.2), SEARCHING_WIDE, last_score=last_score)
        assert "cloud" in solver.tried
        assert ("wide cloud" in solver.tried) == searched
        # What stands out is taken from the first cloud as well.
        solver = Compared(part, predicted, {}, refined=0.9, in_cloud=0.36, in_wide_cloud=0.1)
        first = first_try(view, 0.2)
        found = compared(solver, view, first, SEARCHING_WIDE, last_score=last_score)
        assert found is not first


def test_where_the_cloud_s_place_is_not_taken_the_best_alternative_has_its_chance(
    part: Part, view: View, predicted: FloatArray
) -> None:
    first = first_try(view, 0.3)
    for refined, is_taken in ((0.32, False), (0.34, True)):
        solver = Compared(part, predicted, {"last": 0.4}, refined=refined, in_cloud=0.6, leads_away=True)
        found = compared(solver, view, first, SEARCHING)
        assert solver.tried[-2:] == ["refined", "refined"]
        assert (found is not first) == is_taken
        assert not is_taken or (found is not None and found.cam_T_obj is view.prior)


def test_no_cloud_is_searched_where_it_would_be_for_nothing(part: Part, view: View, predicted: FloatArray) -> None:
    def searched(**situation: Any) -> bool:
        solver = Compared(part, predicted, {}, refined=0.9, in_cloud=0.9)
        compared(solver, view, first_try(view, situation.pop("score", 0.3)), **situation)
        return "cloud" in solver.tried

    assert searched(config=SEARCHING)
    assert not searched(config=SEARCHING, sees=False)
    # A part that stays lost is searched less and less often.
    assert not searched(config=SEARCHING, lost=True)
    assert searched(config=SEARCHING, lost=True, due=True)
    # Scores may be below 0.
    assert not searched(config=PATIENT, score=-0.3)
    assert not searched(config=SEARCHING, score=-0.3, mean_score=-0.1)


@pytest.mark.parametrize("kind", ["cloud", "wide_cloud"])
@pytest.mark.parametrize(
    "cloud", [{"turn_deg": -1.0}, {"shift_share": float("nan")}, {"poses": 0}, {"solved": 0}, {"finalists": 10**6}]
)
def test_numbers_that_make_no_cloud_are_refused(kind: str, cloud: dict[str, float]) -> None:
    name, value = next(iter(cloud.items()))
    with pytest.raises(TrackingError, match=re.escape(f"recovery.{kind}.{name} = {value:g}: give ")):
        Alternatives(**{kind: replace(Alternatives().cloud, **cloud)})  # type: ignore[arg-type]


def test_a_turn_and_a_leap_at_once_are_found_in_a_cloud(
    part: Part, model: PreparedPart, sequence: MadeSequence
) -> None:
    step = np.array([0.0, 0.25, 0.0, -20.0, 16.0, 0.0])
    searching, not_searching = (replace(ACP, sight=Off(), recovery=Alternatives(cloud_below=k)) for k in (0.5, 0.0))
    assert percent_off_after_a_jump(searching, step, part, model, sequence) < 2.0
    assert percent_off_after_a_jump(not_searching, step, part, model, sequence) > 5.0


def test_a_part_that_leapt_farther_is_found_in_the_wide_cloud(
    part: Part, model: PreparedPart, sequence: MadeSequence
) -> None:
    step = np.array([0.0, -0.4, 0.0, -50.0, -30.0, 40.0])
    plain = replace(ACP, sight=Off(), magnification=Off())
    wide, not_wide = (replace(plain, recovery=Alternatives(wide_below=k)) for k in (0.65, 0.0))
    assert percent_off_after_a_jump(wide, step, part, model, sequence) < 5.0
    assert percent_off_after_a_jump(not_wide, step, part, model, sequence) > 20.0
