"""Poses around a pose: which are tried, which one wins, and which ones cannot be."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest

from acp_lab.cad.part import Part
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import disturb_pose, rotation_angle_deg, transform
from acp_lab.geometry.pose_step import centre_position, move_pose, pose_step_between
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.frame_solver import FrameSolver
from acp_lab.tracking.frame_view import Estimate
from acp_lab.tracking.recovery import RING_PLAN
from acp_lab.tracking.schedule import Level
from acp_lab.tracking.search import (
    Cloud,
    SearchPlan,
    better,
    both_ways,
    is_plausible,
    lies_elsewhere,
    one_way,
    ring,
    search,
    search_around,
    search_cloud,
    search_on,
    solutions_in_cloud,
)
from acp_lab.tracking.solution import SeenFrame, Solution
from acp_lab.tracking.targets.regions import RegionTarget
from tests.made_parts import looking_at
from tests.tracking.rendered import AS_DRAWN, CAMERA, MadeSequence, add_percent
from tests.tracking.views import view_at

REGION = 4


@pytest.fixture
def truth(sequence: MadeSequence) -> FloatArray:
    return sequence.first_pose


@pytest.fixture
def solver(model: PreparedPart) -> FrameSolver:
    return FrameSolver(model, AS_DRAWN)


@pytest.fixture
def seen(solver: FrameSolver, sequence: MadeSequence, truth: FloatArray) -> SeenFrame:
    (frame,) = sequence.frames(1)
    assert isinstance(frame, Frame)
    found = solver.look(frame.image, CAMERA, truth, REGION)
    assert found is not None
    return found


# ---- poses ---------------------------------------------------------------------------------------------------


def test_shifted_poses_appear_beside_in_all_directions(part: Part, truth: FloatArray) -> None:
    camera = Camera(640, 512, 600.0, 620.0, 319.5, 250.25)
    shifted = ring(truth, part.box_centre, camera, 14.0)
    assert len(shifted) == 8
    centre = camera.project(centre_position(truth, part.box_centre)[None])[0]
    moved = np.array([camera.project(centre_position(pose, part.box_centre)[None])[0] for pose in shifted]) - centre
    np.testing.assert_allclose(np.hypot(*moved.T), 14.0, atol=1e-6)
    np.testing.assert_allclose(moved.sum(0), 0.0, atol=1e-6)
    for pose in shifted:
        np.testing.assert_allclose(pose[:3, :3], truth[:3, :3])


@pytest.mark.parametrize(
    ("turn_deg", "shift_in_radii", "plausible"),
    [(44.0, 0.0, True), (46.0, 0.0, False), (0.0, 1.95, True), (0.0, 2.05, False), (30.0, 1.0, True)],
)
def test_no_part_turns_or_moves_further_between_frames(
    part: Part, truth: FloatArray, turn_deg: float, shift_in_radii: float, plausible: bool
) -> None:
    step = np.array([0.0, np.radians(turn_deg), 0.0, 0.0, 0.0, shift_in_radii * part.radius])
    assert is_plausible(move_pose(truth, part.box_centre, step), truth, part) is plausible


# ---- which one wins ------------------------------------------------------------------------------------------


def test_from_several_starts_the_best_wins(part: Part, solver: FrameSolver, seen: SeenFrame, truth: FloatArray) -> None:
    far = disturb_pose(truth, part.box_centre, 0.0, 28.0, np.random.default_rng(2))
    view = seen.view
    starts = [view.at_pose(pose) for pose in (far, *ring(far, part.box_centre, CAMERA, 20.0), truth)]
    found = search(solver, seen, starts, RING_PLAN, quality)
    assert found is not None
    assert add_percent(part, found.cam_T_obj, truth) < 1.5
    assert search(solver, seen, [], RING_PLAN, quality) is None
    behind = move_pose(truth, part.box_centre, np.array([0.0, 0, 0, 0, 0, -900.0]))
    assert search(solver, seen, [view.at_pose(behind)], RING_PLAN, quality) is None


def quality(solution: Solution) -> float:
    return solution.judgement.quality


@pytest.mark.parametrize("seed", range(2))
def test_a_search_around_comes_back_from_some_degrees(
    part: Part, solver: FrameSolver, seen: SeenFrame, truth: FloatArray, seed: int
) -> None:
    start = disturb_pose(truth, part.box_centre, 8.0, 5.0, np.random.default_rng(seed))
    found = search_around(solver, seen, start, 4.0, 3)
    assert found is not None
    assert add_percent(part, found.cam_T_obj, truth) < 1.5


CLOUD = Cloud(4.5, 0.06, 120, 12, 3)


@pytest.mark.parametrize("seed", range(2))
def test_a_search_in_a_cloud_comes_back_from_some_degrees(
    part: Part, solver: FrameSolver, seen: SeenFrame, truth: FloatArray, seed: int
) -> None:
    start = disturb_pose(truth, part.box_centre, 8.0, 5.0, np.random.default_rng(seed))
    found = search_cloud(solver, seen, start, CLOUD, one_way)
    assert found is not None
    assert add_percent(part, found.cam_T_obj, truth) < 1.5
    again = search_cloud(solver, seen, start, CLOUD, one_way)
    assert again is not None
    np.testing.assert_array_equal(found.cam_T_obj, again.cam_T_obj)


def test_a_search_in_a_cloud_leaves_the_frame_as_it_was(
    part: Part, solver: FrameSolver, seen: SeenFrame, truth: FloatArray
) -> None:
    """What regions keep of the first pose that asks for a line is not asked for by poses that are off."""
    regions = next(target for target in seen.targets if isinstance(target, RegionTarget))
    search_cloud(solver, seen, truth, CLOUD, one_way)
    assert np.isnan(regions.free.mm).all()
    search_around(solver, seen, truth, 4.0, 3)  # which has no frame of its own
    assert not np.isnan(regions.free.mm).all()


def test_a_cloud_scatters_as_wide_as_it_says(part: Part, truth: FloatArray) -> None:
    first, *others = Cloud(4.5, 0.06, 2000, 12, 3).around(truth, part)
    np.testing.assert_array_equal(first, truth)
    steps = np.array([pose_step_between(truth, pose, part.box_centre) for pose in others])
    # A standard deviation of 2000 numbers is known to 1.6%.
    np.testing.assert_allclose(np.degrees(steps[:, :3]).std(0), 4.5, rtol=0.07)
    np.testing.assert_allclose(steps[:, 3:].std(0), 0.06 * part.radius, rtol=0.07)


def test_of_a_cloud_the_most_agreeable_are_solved_and_the_best_of_these_refined(
    part: Part, seen: SeenFrame, truth: FloatArray
) -> None:
    solver = Noted(part)
    found = search_cloud(solver, seen, truth, CLOUD, one_way)
    assert found is not None
    across = sorted((pose[0, 3] for pose in CLOUD.around(truth, part)), reverse=True)
    solved = [(at.cam_T_obj[0, 3], [level.reach_px for level in levels]) for at, levels in solver.solved]
    assert solved == [*((x, [16, 10, 6]) for x in across[:12]), *((x, [8, 5]) for x in across[:3])]
    assert found.cam_T_obj[0, 3] == across[0]
    assert len(solver.agreed) == 121 + 12 + 3


def test_of_what_a_cloud_leads_to_a_pose_that_leaves_image_edges_over_does_not_win_both_ways(
    part: Part, seen: SeenFrame, truth: FloatArray
) -> None:
    """It agrees best with the pose farthest across, which explains nothing of the image; one way that one wins."""
    across = sorted((pose[0, 3] for pose in CLOUD.around(truth, part)), reverse=True)[: CLOUD.solved]
    solver = Explains(part, {x: 100 * place for place, x in enumerate(across)})
    winners = [search_cloud(solver, seen, truth, CLOUD, ranking) for ranking in (one_way, both_ways)]
    assert [winner.cam_T_obj[0, 3] for winner in winners if winner is not None] == [across[0], across[-1]]


def test_all_that_a_cloud_leads_to_is_refined_and_the_best_once_more(
    part: Part, seen: SeenFrame, truth: FloatArray
) -> None:
    solver = Noted(part)
    found = solutions_in_cloud(solver, seen, truth, CLOUD)
    across = sorted((pose[0, 3] for pose in CLOUD.around(truth, part)), reverse=True)
    solved = [(at.cam_T_obj[0, 3], [level.reach_px for level in levels]) for at, levels in solver.solved]
    assert [levels for _, levels in solved] == [[16, 10, 6]] * 12 + [[8, 5]] * 12 + [[20, 14, 8, 8, 5]] * 3
    assert {x for x, _ in solved} == set(across[:12])
    assert len(found) == 12 + 3


@pytest.mark.parametrize("seed", range(2))
def test_of_what_a_cloud_leads_to_the_first_fits_best(
    part: Part, solver: FrameSolver, seen: SeenFrame, truth: FloatArray, seed: int
) -> None:
    start = disturb_pose(truth, part.box_centre, 8.0, 5.0, np.random.default_rng(seed))
    regions = next(target for target in seen.targets if isinstance(target, RegionTarget))
    found = solutions_in_cloud(solver, seen, start, CLOUD)
    assert np.isnan(regions.free.mm).all(), "the frame is left as it was"
    assert add_percent(part, found[0].cam_T_obj, truth) < 1.5
    scores = [solution.score for solution in found]
    assert scores == sorted(scores, reverse=True)


def test_poses_lie_elsewhere_from_a_fifth_of_the_radius_on(part: Part, truth: FloatArray) -> None:
    for step in np.eye(6):
        scale = 1.0 if step[3:].any() else part.radius
        for share, elsewhere in ((0.19, False), (0.21, True)):
            other = move_pose(truth, part.box_centre, share * part.radius / scale * step)
            assert lies_elsewhere(truth, other, part) == elsewhere
            assert lies_elsewhere(other, truth, part) == elsewhere


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_search_goes_on_from_the_rim_of_a_cloud(
    part: Part, solver: FrameSolver, sequence: MadeSequence, truth: FloatArray, seed: int
) -> None:
    (frame,) = sequence.frames(1)
    assert isinstance(frame, Frame)

    def look(pose: FloatArray) -> SeenFrame | None:
        return solver.look(frame.image, CAMERA, pose, REGION)

    start = disturb_pose(truth, part.box_centre, 20.0, 16.0, np.random.default_rng(seed))
    seen = look(start)
    assert seen is not None
    missed = search_cloud(solver, seen, start, CLOUD, one_way)
    assert missed is not None
    assert add_percent(part, missed.cam_T_obj, truth) > 10.0
    found = search_on(solver, look, seen, CLOUD, 6, one_way)
    assert found is not None
    around, solution = found
    assert add_percent(part, solution.cam_T_obj, truth) < 1.5
    np.testing.assert_allclose(around.view.prior, solution.cam_T_obj)


def test_a_search_goes_on_as_long_as_it_may(part: Part, seen: SeenFrame, truth: FloatArray) -> None:
    """Where farther across is always better, each cloud's best lies at its rim."""
    looked = list[FloatArray]()

    def look(pose: FloatArray) -> SeenFrame:
        looked.append(pose)
        return SeenFrame(replace(seen.view, prior=pose), seen.targets)

    across = []
    for clouds in (1, 2, 3, 4):
        looked.clear()
        found = search_on(Noted(part), look, seen, CLOUD, clouds, one_way)
        assert found is not None
        across.append(found[1].cam_T_obj[0, 3] - truth[0, 3])
        # Around the start twice, then around what was found; each time the frame is looked at there, too.
        places, results = looked[::2], looked[1::2]
        assert len(looked) == 2 * (clouds - 1)
        for place, expected in zip(places, [truth, *results], strict=False):
            np.testing.assert_array_equal(place, expected)
    assert across == sorted(set(across))
    # A part that is seen nowhere else stays where the first cloud found it.
    alone = search_on(Noted(part), lambda pose: None, seen, CLOUD, 4, one_way)
    assert alone is not None
    assert alone[0] is seen
    assert alone[1].cam_T_obj[0, 3] - truth[0, 3] == across[0]


def test_what_cannot_follow_is_not_found(part: Part, seen: SeenFrame, truth: FloatArray) -> None:
    """Far away a part is a few pixels, which agree with anything."""
    far = move_pose(truth, part.box_centre, np.array([0.0, 0.0, 0.0, 0.0, 0.0, 50.0 * part.radius]))
    assert search_on(Leaps(part, far), lambda pose: seen, seen, CLOUD, 6, one_way) is None


def test_a_pose_within_a_cloud_ends_the_search(part: Part, seen: SeenFrame, truth: FloatArray) -> None:
    def look(pose: FloatArray) -> SeenFrame:
        raise AssertionError("not asked for")

    found = search_on(Likes(part, truth), look, seen, CLOUD, 6, one_way)
    assert found is not None
    np.testing.assert_array_equal(found[1].cam_T_obj, truth)


@pytest.mark.parametrize(
    ("turn_deg", "shift_in_radii", "within"),
    [(0, 0, True), (10.5, 0, True), (11.5, 0, False), (0, 0.14, True), (0, 0.155, False), (8.5, 0.12, False)],
)
def test_the_rim_of_a_cloud_is_two_and_a_half_standard_deviations_away(
    part: Part, truth: FloatArray, turn_deg: float, shift_in_radii: float, within: bool
) -> None:
    step = np.array([0.0, np.radians(turn_deg), 0.0, 0.0, 0.0, shift_in_radii * part.radius])
    pose = move_pose(truth, part.box_centre, step)
    assert CLOUD.reaches(truth, pose, part) is within
    assert CLOUD.wider.reaches(truth, pose, part)
    only_turns = replace(CLOUD, shift_share=0.0)
    assert only_turns.reaches(truth, pose, part) is (turn_deg < 11.0)


@dataclass
class Said:
    """A judgement of which the quality and the score are all that is asked."""

    quality: float

    @property
    def score(self) -> float:
        return self.quality


@dataclass
class Noted:
    """A solver that leaves estimates where they are, and notes what it was asked; quality goes by the x of a pose."""

    part: Part
    solved: list[tuple[Estimate, Any]] = field(default_factory=list)
    agreed: list[Estimate] = field(default_factory=list)
    blind: bool = False

    def solve(self, seen: SeenFrame, start: Estimate, clock: Any, levels: Any = None) -> Solution | None:
        self.solved.append((start, levels))
        if self.blind and levels is None:
            return None
        return Solution(start, (Said(start.cam_T_obj[0, 3]),), 0.0, None)  # type: ignore[arg-type]

    def afresh(self, seen: SeenFrame) -> SeenFrame:
        return seen

    def look_at(self, seen: SeenFrame, at: Estimate, level: Level, clock: Any) -> Solution | None:
        raise AssertionError("not asked for")

    def agreement(self, seen: SeenFrame, at: Estimate, level: Level) -> float:
        self.agreed.append(at)
        return float(at.cam_T_obj[0, 3])

    def explained(self, seen: SeenFrame, at: Estimate) -> int:
        raise AssertionError("not asked for")


class Leaps(Noted):
    """Ends at one pose, from anywhere."""

    def __init__(self, part: Part, pose: FloatArray) -> None:
        super().__init__(part)
        self.pose = pose

    def solve(self, seen: SeenFrame, start: Estimate, clock: Any, levels: Any = None) -> Solution | None:
        return super().solve(seen, start.view.at_pose(self.pose), clock, levels)


class Explains(Noted):
    """Explains so many image edges by the x of a pose."""

    def __init__(self, part: Part, by_x: dict[float, int]) -> None:
        super().__init__(part)
        self.by_x = by_x

    def explained(self, seen: SeenFrame, at: Estimate) -> int:
        return self.by_x[at.cam_T_obj[0, 3]]


class Likes(Noted):
    """Agrees most with one pose."""

    def __init__(self, part: Part, pose: FloatArray) -> None:
        super().__init__(part)
        self.pose = pose

    def agreement(self, seen: SeenFrame, at: Estimate, level: Level) -> float:
        return -float(np.abs(at.cam_T_obj - self.pose).sum())


def test_finalists_are_refined_on_their_own_levels(part: Part, seen: SeenFrame) -> None:
    view, base = view_at(part, looking_at(part, np.array([0.1, 0.1, 1.0]), 330.0)), np.eye(4)
    starts = []
    for x in (3.0, 5.0, 1.0, 4.0):
        pose = base.copy()
        pose[0, 3] = x
        starts.append(view.at_pose(pose))
    first, last = (Level(9, 3.0),), (Level(5, 1.0),)
    solver = Noted(part)
    found = search(solver, seen, starts, SearchPlan(first, 2, last), quality)
    assert found is not None
    assert found.cam_T_obj[0, 3] == 5.0
    assert [(at.cam_T_obj[0, 3], levels) for at, levels in solver.solved] == [
        *((x, first) for x in (3.0, 5.0, 1.0, 4.0)),
        (5.0, last),
        (4.0, last),
    ]
    # Where no finalist can be refined, the best first solution stays.
    blind = Noted(part, blind=True)
    found = search(blind, seen, starts, SearchPlan(first, 2), quality)
    assert found is not None
    assert found.cam_T_obj[0, 3] == 5.0


def test_a_search_around_turns_about_axes_and_diagonals(part: Part, seen: SeenFrame, truth: FloatArray) -> None:
    solver = Noted(part)
    search_around(solver, seen, truth, 4.0, 3)
    starts = [at.cam_T_obj for at, levels in solver.solved if levels is not None]
    assert len(starts) == 15
    np.testing.assert_allclose(starts[0], truth, atol=1e-9)
    turns = [pose[:3, :3] @ truth[:3, :3].T for pose in starts[1:]]
    np.testing.assert_allclose([rotation_angle_deg(turn, np.eye(3)) for turn in turns], 4.0, atol=1e-6)
    np.testing.assert_allclose(sum(turn - turn.T for turn in turns), 0.0, atol=1e-9)  # as many each way
    for pose in starts:
        np.testing.assert_allclose(transform(pose, part.box_centre), transform(truth, part.box_centre), atol=1e-9)
    assert len(solver.solved) == 15 + 3  # finalists
    assert len(solver.agreed) == 15 + 3


def test_the_better_of_two() -> None:
    def of(value: float) -> Solution:
        return Solution(None, (Said(value),), 0.0, None)  # type: ignore[arg-type]

    low, high, same = of(0.3), of(0.5), of(0.5)
    assert better(low, high) is better(high, low) is high
    assert better(high, same) is high
    assert better(None, low) is better(low, None) is low
    assert better(None, None) is None
