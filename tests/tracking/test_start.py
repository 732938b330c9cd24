"""The first frame: exact starts are trusted and teach the offsets, others are not and are corrected."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from acp_lab.cad.part import Part
from acp_lab.errors import TrackingError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import disturb_pose
from acp_lab.geometry.pose_step import centre_position
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.frame_solver import FrameSolver
from acp_lab.tracking.learning.contour_offsets import OffsetConfig
from acp_lab.tracking.learning.knowledge import Off
from acp_lab.tracking.search import Look
from acp_lab.tracking.start import TrustedStart, begin, is_trusted
from acp_lab.tracking.stopwatch import Stopwatch
from acp_lab.tracking.tracker import Tracker
from tests.made_parts import bracket, looking_at
from tests.tracking.rendered import AS_DRAWN, CAMERA, add_percent, draw, poses, prepared

INSET_MM = 0.2
CONFIG = TrustedStart()
NOT_ALONE = TrustedStart(agreement_alone=float("inf"))
WAYS = {"above": (0.8, 0.6, 1.0), "below": (-0.5, 0.4, -0.9)}


def first_frame(part: Part, pose: FloatArray, inset_mm: float = 0.0) -> Frame:
    """The part, or one whose outlines all lie a little further in, at a pose."""
    shown = bracket(shift=(-400.0, -300.0, -500.0), inset_mm=inset_mm)
    return Frame(0, draw([(shown, pose)]), CAMERA)


def look_at(solver: FrameSolver, frame: Frame) -> Look:
    """Anywhere in a frame."""
    return lambda pose: solver.look(frame.image, frame.camera, pose, solver.choose_region(pose))


@pytest.fixture(params=WAYS.values(), ids=WAYS.keys())
def truth(request: pytest.FixtureRequest, part: Part) -> FloatArray:
    return looking_at(part, np.array(request.param), 330.0, 0.3)


@pytest.fixture
def solver(model: PreparedPart) -> FrameSolver:
    return FrameSolver(model, AS_DRAWN)


@pytest.mark.parametrize("inset_mm", [0.0, INSET_MM], ids=["as in the CAD", "inset by 0.2 mm"])
def test_an_exact_start_is_trusted_and_kept(
    part: Part, model: PreparedPart, truth: FloatArray, inset_mm: float
) -> None:
    tracker = Tracker(model, AS_DRAWN)
    result = tracker.start(first_frame(part, truth, inset_mm), truth)
    assert tracker.start_was_trusted
    np.testing.assert_array_equal(result.cam_T_obj, truth)
    assert result.quality > 0.6


@pytest.mark.parametrize(("angle_deg", "shift_mm"), [(2.0, 2.0), (6.0, 6.0), (15.0, 12.0)])
def test_a_disturbed_start_is_not_trusted_and_corrected(
    part: Part, model: PreparedPart, truth: FloatArray, angle_deg: float, shift_mm: float
) -> None:
    frame = first_frame(part, truth)
    for seed in range(2):
        start = disturb_pose(truth, part.box_centre, angle_deg, shift_mm, np.random.default_rng(seed))
        tracker = Tracker(model, AS_DRAWN)
        result = tracker.start(frame, start)
        assert not tracker.start_was_trusted
        assert add_percent(part, result.cam_T_obj, truth) < 3.0


@pytest.mark.parametrize("seed", range(4))
def test_a_start_that_the_frame_agrees_with_well_enough_is_weighed(part: Part, truth: FloatArray, seed: int) -> None:
    """A degree off it tells which edges are the part's; that they lie where it says would be learnt wrongly."""
    frame = first_frame(part, truth, INSET_MM)
    start = disturb_pose(truth, part.box_centre, 1.0, 1.0, np.random.default_rng(seed))
    tracker = Tracker(prepared(part, 0.25), AS_DRAWN)
    result = tracker.start(frame, start)
    assert tracker.start_was_trusted
    assert add_percent(part, result.cam_T_obj, truth) < 0.65 * add_percent(part, start, truth)


def test_a_start_is_not_trusted_because_the_solver_finds_nothing_better(
    part: Part, model: PreparedPart, solver: FrameSolver
) -> None:
    """From far away the solver may end as far away; a cloud of poses around the start shows better ones."""
    truth = looking_at(part, np.array(WAYS["above"]), 330.0, 0.3)
    frame, start = first_frame(part, truth), disturb_pose(truth, part.box_centre, 12.0, 12.0, np.random.default_rng(31))
    seen = solver.look(frame.image, CAMERA, start, solver.choose_region(start))
    assert seen is not None
    solved = solver.solve(seen, seen.view.at_pose(start), Stopwatch())
    assert solved is not None
    assert add_percent(part, solved.cam_T_obj, truth) > 10.0
    assert is_trusted(solver, seen, solved, CONFIG)
    started = begin(solver, look_at(solver, frame), seen, CONFIG, Stopwatch())
    assert started is not None
    assert not started.trusted
    assert add_percent(part, started.solution.cam_T_obj, truth) < 2.5
    # Where a start may be surpassed by anything, it is kept as before.
    kept = begin(solver, look_at(solver, frame), seen, replace(CONFIG, surpassed=0.0), Stopwatch())
    assert kept is not None
    assert kept.trusted


@pytest.mark.parametrize(
    "setting",
    [
        {"surpassed": 1.1}, {"clouds": 0}, {"poses": 0}, {"solved": 0}, {"shift_share": -0.1}, {"finalists": 0},
        {"turn_deg": -1.0},
    ],
)
def test_settings_of_the_cloud_are_checked(setting: dict[str, float]) -> None:
    with pytest.raises(TrackingError, match=f"start.{next(iter(setting))} = "):
        replace(CONFIG, **setting)  # type: ignore[arg-type]


def test_offsets_of_a_trusted_start_keep_the_part_at_its_depth(part: Part, model: PreparedPart) -> None:
    """An outline 0.2 mm further in looks like a part 4% farther away, unless the first frame has told."""
    truth = poses(part, looking_at(part, np.array(WAYS["above"]), 330.0, 0.3), 6)
    inset = bracket(shift=(-400.0, -300.0, -500.0), inset_mm=INSET_MM)
    images = [draw([(inset, pose)], seed) for seed, pose in enumerate(truth)]
    tracker = Tracker(model, AS_DRAWN)
    tracker.start(Frame(0, images[0], CAMERA), truth[0])
    for index in range(1, 6):
        result = tracker.track(Frame(index, images[index], CAMERA))
        assert add_percent(part, result.cam_T_obj, truth[index]) < 1.0
    ids = np.arange(len(model.edges))
    offsets = tracker.solver.knowledge.offsets
    assert offsets is not None
    learnt = offsets.expect(ids, np.ones(len(ids), bool), model.edges.normals_obj.sum(1)).offsets_mm
    # Both faces of an edge lie further in, which moves it by up to 1.4 times as much.
    assert -1.8 * INSET_MM < np.median(learnt) < -0.8 * INSET_MM


def test_the_prior_stands_in_where_the_start_is_not_trusted(part: Part, model: PreparedPart, truth: FloatArray) -> None:
    frame = first_frame(part, truth, INSET_MM)
    start = disturb_pose(truth, part.box_centre, 2.0, 2.0, np.random.default_rng(0))
    unaware = Tracker(model, AS_DRAWN).start(frame, start)
    aware = Tracker(prepared(part, INSET_MM / OffsetConfig().break_share), AS_DRAWN).start(frame, start)
    off = [add_percent(part, result.cam_T_obj, truth) for result in (unaware, aware)]
    assert off[0] > 3.0
    assert off[1] < 2.5
    assert off[1] < 0.6 * off[0]


@pytest.mark.parametrize(
    ("farther", "ratio", "trusted"),
    [(0.015, 0.92, True), (0.015, 0.88, False), (0.03, 0.98, True), (0.03, 0.95, False), (0.045, 1.0, False)],
)
def test_equal_agreement_lets_the_solved_pose_lie_further_away(
    part: Part,
    model: PreparedPart,
    monkeypatch: pytest.MonkeyPatch,
    farther: float,
    ratio: float,
    trusted: bool,
) -> None:
    pose = looking_at(part, np.array(WAYS["above"]), 330.0, 0.3)
    solver, frame = FrameSolver(model, AS_DRAWN), first_frame(part, pose)
    away = pose.copy()
    # Along the line of sight: the part appears smaller by that share.
    away[:3, 3] += farther * centre_position(pose, part.box_centre)
    seen = solver.look(frame.image, CAMERA, pose, 4)
    assert seen is not None
    solved = solver.solve(seen, seen.view.at_pose(pose), Stopwatch())
    assert solved is not None
    agreements = iter((0.6 * ratio, 0.6))
    monkeypatch.setattr(solver, "agreement", lambda *_: next(agreements))
    moved = replace(solved, estimate=seen.view.at_pose(away))
    assert is_trusted(solver, seen, moved, NOT_ALONE) is trusted


@pytest.mark.parametrize(("ratio", "trusted"), [(0.66, True), (0.64, False)])
@pytest.mark.parametrize("farther", [0.015, 0.045, 0.2])
def test_agreement_alone_trusts_a_start_however_far_the_solved_pose(
    part: Part, model: PreparedPart, monkeypatch: pytest.MonkeyPatch, farther: float, ratio: float, trusted: bool
) -> None:
    pose = looking_at(part, np.array(WAYS["above"]), 330.0, 0.3)
    solver, frame = FrameSolver(model, AS_DRAWN), first_frame(part, pose)
    away = pose.copy()
    away[:3, 3] += farther * centre_position(pose, part.box_centre)
    seen = solver.look(frame.image, CAMERA, pose, 4)
    assert seen is not None
    solved = solver.solve(seen, seen.view.at_pose(pose), Stopwatch())
    assert solved is not None
    moved = replace(solved, estimate=seen.view.at_pose(away))
    for config, expected in ((TrustedStart(agreement_alone=0.65), trusted), (NOT_ALONE, False)):
        agreements = iter((0.6 * ratio, 0.6))
        monkeypatch.setattr(solver, "agreement", lambda *_, said=agreements: next(said))
        assert is_trusted(solver, seen, moved, config) is expected


def test_a_method_without_a_first_look_solves_from_the_given_pose(
    part: Part, model: PreparedPart, truth: FloatArray
) -> None:
    """It neither keeps the pose as it is nor searches around it."""
    frame = first_frame(part, truth)
    start = disturb_pose(truth, part.box_centre, 2.0, 2.0, np.random.default_rng(0))
    tracker = Tracker(model, replace(AS_DRAWN, start=Off()))
    for given in (truth, start):
        result = tracker.start(frame, given)
        assert not tracker.start_was_trusted
        np.testing.assert_array_equal(result.predicted, given)
        assert 3 < result.iterations <= 9  # one solution on three levels
        assert 0.0 < add_percent(part, result.cam_T_obj, truth) < 2.5
