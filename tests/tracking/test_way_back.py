"""A part that is lost is looked for with a budget, found again, and believed when two frames say so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from acp_lab.detection.view_templates import make_views
from acp_lab.detection.work import Steps
from acp_lab.errors import TrackingError
from acp_lab.geometry.arrays import ByteImage, FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.assessment import Assessment
from acp_lab.tracking.find import Detection, LateFinder
from acp_lab.tracking.learning.knowledge import Off
from acp_lab.tracking.method import ACP
from acp_lab.tracking.recovery import WayBack
from acp_lab.tracking.result import TrackState
from acp_lab.tracking.tracker import Tracker
from acp_lab.tracking.way_back import (
    LATE_WIDE_FRAMES,
    LIKE_LAST,
    NEAR,
    PROPOSAL_WORK,
    SECOND_LOOKS,
    SURE_QUALITY,
    WIDE_FRAMES,
    Reacquisition,
    Verdict,
)
from tests.made_parts import bracket, looking_at
from tests.tracking.rendered import add_percent, draw, poses, prepared

LARGE = Camera(width=320, height=256, fx=420.0, fy=425.0, cx=159.5, cy=127.5)
ANYWHERE = np.eye(4)


@pytest.mark.parametrize(
    "values",
    [
        {"budget": 0.0},
        {"late_budget": float("nan")},
        {"late_frames": -1},
        {"proposals": 0},
        {"least_score": 1.5},
        {"least_score_near": -0.1},
    ],
)
def test_nonsense_is_refused(values: dict[str, float]) -> None:
    with pytest.raises(TrackingError, match="way_back"):
        WayBack(**values)  # type: ignore[arg-type]


# ---- in what order it searches ---------------------------------------------------------------------------------


class Searched:
    """Stands for a finder: searches of a told length, whose results are told; remembers what was asked."""

    def __init__(self, slices: int, score: float) -> None:
        self.slices, self.score = slices, score
        self.asked: list[float | None] = []
        self.pose: FloatArray | None = None

    def is_same(self, cam_T_obj: FloatArray, others: tuple[FloatArray, ...]) -> bool:
        return any(np.allclose(cam_T_obj, other) for other in others)

    def search(
        self, frame: Frame, top: int, prior: object, aligned_most: int | None = None, rival: FloatArray | None = None
    ) -> Steps[tuple[Detection, ...]]:
        self.asked.append(None if prior is None else prior.within_deg)  # type: ignore[attr-defined]
        for _ in range(self.slices):
            yield 1000.0
        pose = np.eye(4)
        pose[0, 3] = frame.index
        if self.pose is not None:
            pose = self.pose
        return (Detection(pose, self.score, np.array([0.0, 0.0, 1.0])),)


def searching(slices: int, score: float, budget: float, late_frames: int = 1000) -> tuple[Reacquisition, Searched]:
    part = bracket(shift=(0.0, 0.0, 0.0))
    finder = Searched(slices, score)
    config = WayBack(budget=budget, late_frames=late_frames, late_budget=2.0 * budget, proposals=1)
    way_back = Reacquisition(prepared(part), config, lambda: finder)  # type: ignore[arg-type]
    return way_back, finder


def frame(index: int) -> Frame:
    return Frame(index, np.zeros((4, 4, 3), np.uint8), Camera(4, 4, 4.0, 4.0, 1.5, 1.5))


def test_searches_nearby_and_wide_ones_take_turns() -> None:
    """A search nearby takes ten frames here, a wide one is interrupted after its share."""
    way_back, finder = searching(slices=95, score=0.0, budget=10_000.0)
    for index in range(60):
        assert way_back.proposals(frame(index), ANYWHERE) == []
    near = [index for index, asked in enumerate(finder.asked) if asked == NEAR.within_deg]
    wide = [asked for asked in finder.asked if asked != NEAR.within_deg]
    # 60 frames: turns of 10 nearby and 2 wide, the sixth has just begun; a wide search needs ten frames.
    assert len(near) == 60 // (10 + WIDE_FRAMES) + 1
    assert len(wide) == 1


def test_a_part_that_is_away_for_long_is_searched_for_with_more_work_and_that_farther_away() -> None:
    """From the fourth frame on a search nearby takes five frames instead of ten, and a wide one has four goes."""
    way_back, finder = searching(slices=95, score=0.0, budget=10_000.0, late_frames=3)
    begun: list[int] = []
    for index in range(22):
        way_back.proposals(frame(index), ANYWHERE)
        begun += [index] * (finder.asked.count(NEAR.within_deg) - len(begun))
    assert LATE_WIDE_FRAMES == 4
    # 30 of 95 slices in three frames, the rest in four; then a wide search has four goes, the first in the last of
    # these. It ends in the second turn, and what the frame has left goes to the next wide one.
    assert begun == [0, 10, 17]


def test_a_wide_search_that_was_in_vain_comes_again_before_the_slowest_one() -> None:
    way_back, finder = searching(slices=1, score=0.0, budget=3_000.0)
    for index in range(40):
        way_back.proposals(frame(index), ANYWHERE)
    wide = [asked for asked in finder.asked if asked != NEAR.within_deg]
    assert wide[:6] == [40.0, 180.0, 40.0, 180.0, 40.0, None]
    assert wide[6:8] == wide[:2]


def test_every_reach_has_its_turn() -> None:
    way_back, finder = searching(slices=1, score=0.0, budget=3_000.0)
    for index in range(40):
        way_back.proposals(frame(index), ANYWHERE)
    assert {25.0, 40.0, 180.0, None} == set(finder.asked)


def test_a_search_nearby_looks_less_far_around_a_part_that_is_magnified_and_farther_around_a_large_one() -> None:
    assert [NEAR.of(ANYWHERE, size_px).around_px for size_px in (420.0, 840.0)] == [160.0, 320.0]
    margins = [NEAR.of(ANYWHERE, size_px).around_px for size_px in (300.0, 130.0, 90.0, 50.0)]
    assert NEAR.of(ANYWHERE).around_px == NEAR.around_px
    assert margins[0] == margins[1] == NEAR.around_px
    # In px of the magnified image it is more all the same.
    assert margins[2:] == pytest.approx([80.0 / 2**0.5, 80.0 / 4**0.5])
    assert LIKE_LAST.of(ANYWHERE, 50.0).around_px is None


def test_work_per_frame_is_bounded() -> None:
    way_back, finder = searching(slices=1000, score=0.0, budget=7_000.0)
    steps = 0

    def counted(frame: Frame, top: int, prior: object, *_: object) -> Steps[tuple[Detection, ...]]:
        nonlocal steps
        while True:
            steps += 1
            yield 1000.0

    finder.search = counted  # type: ignore[method-assign, assignment]
    for index in range(5):
        way_back.proposals(frame(index), ANYWHERE)
    assert steps == 35


def test_what_was_found_is_proposed_in_the_next_frame_and_searched_around() -> None:
    way_back, finder = searching(slices=8, score=0.9, budget=PROPOSAL_WORK + 5_000.0)
    assert way_back.proposals(frame(0), ANYWHERE) == []
    (pose,) = way_back.proposals(frame(1), ANYWHERE)
    assert pose[0, 3] == 0.0  # of the frame that was searched
    assert finder.asked == [25.0, 25.0]
    assert way_back._around is None  # in use


def test_what_was_found_is_proposed_where_its_picture_is_now() -> None:
    """A fast part is elsewhere when the search of a frame ends; pictures of another camera are not compared."""
    part = bracket(shift=(0.0, 0.0, 0.0))
    pose = looking_at(part, np.array([0.8, 0.6, 1.0]), 330.0, 0.3)
    moved = pose.copy()
    moved[:2, 3] += 18.0, -12.0
    images = [draw([(part, at)], k, LARGE) for k, at in enumerate((pose, moved))]
    for camera, expected in ((LARGE, [moved, pose]), (replace(LARGE, fx=421.0), [pose])):
        way_back, finder = searching(slices=8, score=0.9, budget=PROPOSAL_WORK + 5_000.0)
        finder.pose = pose
        assert way_back.proposals(Frame(0, images[0], LARGE), pose) == []
        proposed = way_back.proposals(Frame(1, images[1], camera), pose)
        assert len(proposed) == len(expected)
        for one, there in zip(proposed, expected, strict=True):
            assert np.linalg.norm(one[:3, 3] - there[:3, 3]) < 3.0
            assert np.allclose(one[:3, :3], pose[:3, :3])


def test_where_one_is_another_part_what_else_was_found_is_proposed_nearest_first() -> None:
    way_back, finder = searching(slices=8, score=0.9, budget=PROPOSAL_WORK + 5_000.0)
    places = {400.0: 0.35, -90.0: 0.25, 60.0: 0.2, -300.0: 0.1}

    def several(*_: object) -> Steps[tuple[Detection, ...]]:
        yield 8_000.0
        poses = [np.eye(4) for _ in places]
        for pose, x in zip(poses, places, strict=True):
            pose[:3, 3] = x, 0.0, 400.0
        ahead = np.array([0.0, 0.0, 1.0])
        return tuple(Detection(pose, score, ahead) for pose, score in zip(poses, places.values(), strict=True))

    finder.search = several  # type: ignore[method-assign, assignment]
    last = np.eye(4)
    last[2, 3] = 400.0
    assert way_back.proposals(frame(0), last) == []
    proposed = [way_back.proposals(frame(1), last)]
    for index in range(2, 6):
        rejected = proposed[-1][0] if proposed[-1] else last
        way_back.pass_on(Frame(index, np.zeros((256, 320, 3), np.uint8), LARGE), rejected, last)
        proposed.append(way_back.proposals(frame(index), last))
    assert [[pose[0, 3] for pose in poses] for poses in proposed[:4]] == [[400.0], [60.0], [-90.0], [-300.0]]
    # Then the next search decides.
    later = [pose[0, 3] for index in range(6, 12) for pose in way_back.proposals(frame(index), last)]
    assert later[0] == 400.0


def test_among_others_a_part_is_sought_nearby_in_the_next_picture() -> None:
    """Farther away another one looks the same."""
    part = bracket(shift=(0.0, 0.0, 0.0))
    pose = looking_at(part, np.array([0.8, 0.6, 1.0]), 330.0, 0.3)
    moved = pose.copy()
    moved[0, 3] += 60.0
    images = [draw([(part, at)], k, LARGE) for k, at in enumerate((pose, moved))]
    for is_among_others in (False, True):
        way_back, finder = searching(slices=8, score=0.9, budget=PROPOSAL_WORK + 5_000.0)
        finder.pose = pose
        way_back.proposals(Frame(0, images[0], LARGE), pose)
        if is_among_others:
            way_back._met_others = True
        proposed = way_back.proposals(Frame(1, images[1], LARGE), pose)
        assert any(np.linalg.norm(one[:3, 3] - moved[:3, 3]) < 5.0 for one in proposed) is not is_among_others
        assert np.allclose(proposed[-1], pose)


def test_poor_hypotheses_are_not_proposed() -> None:
    way_back, _ = searching(slices=3, score=WayBack().least_score_near - 0.01, budget=50_000.0)
    assert [way_back.proposals(frame(index), ANYWHERE) for index in range(5)] == [[]] * 5


def test_a_part_too_small_to_be_looked_for_costs_no_time() -> None:
    """No level of the pyramid would show it: searches end at once, and must not be begun again and again."""
    way_back, finder = searching(slices=0, score=0.0, budget=10_000.0)
    for index in range(3):
        assert way_back.proposals(frame(index), ANYWHERE) == []
    assert 1 <= len(finder.asked) <= 6
    small = Camera(64, 48, 30.0, 30.0, 31.5, 23.5)
    part = bracket(shift=(0.0, 0.0, 0.0))
    far = looking_at(part, np.array([0.8, 0.6, 1.0]), 2000.0, 0.3)
    lost = Reacquisition(prepared(part), WayBack(), LateFinder(prepared(part)))
    assert lost.proposals(Frame(0, np.zeros((48, 64, 3), np.uint8), small), far) == []


# ---- a second look ---------------------------------------------------------------------------------------------


def test_what_is_back_where_it_was_or_fits_very_well_needs_no_second_look() -> None:
    part = bracket(shift=(0.0, 0.0, 0.0))
    way_back = Reacquisition(prepared(part), WayBack(), LateFinder(prepared(part)))
    last = looking_at(part, np.array([0.8, 0.6, 1.0]), 330.0, 0.3)
    at = Frame(0, np.zeros((LARGE.height, LARGE.width, 3), np.uint8), LARGE)
    beside, turned = last.copy(), looking_at(part, np.array([0.8, 0.6, 1.0]), 330.0, 0.9)
    beside[0, 3] += 90.0 * 330.0 / LARGE.fx
    near = last.copy()
    near[0, 3] += 60.0 * 330.0 / LARGE.fx
    for pose, quality, expected in (
        (last, 0.6, False),
        (near, 0.6, False),
        (beside, 0.6, True),
        (beside, SURE_QUALITY, False),
        (turned, 0.6, True),
    ):
        assert way_back.doubts(at, pose, quality, last) is expected


@pytest.mark.parametrize(
    ("same", "score", "expected"),
    [
        (True, 0.9, [Verdict.RIGHT]),
        (True, 0.2, [Verdict.OPEN, Verdict.RIGHT]),  # nothing beats it, from any side
        (False, 0.9, [Verdict.WRONG]),
        (False, 0.3, [Verdict.OPEN, Verdict.RIGHT]),
    ],
)
def test_the_pose_has_to_win_against_what_the_detector_finds(same: bool, score: float, expected: list[Verdict]) -> None:
    way_back, finder = searching(slices=25, score=score, budget=10_000.0)
    finder.pose = np.eye(4)
    finder.pose[0, 3] = 0.0 if same else 50.0
    verdicts = [way_back.second_look(frame(index), ANYWHERE, ANYWHERE, False) for index in range(3 * len(expected))]
    assert [one for one in verdicts if one is not Verdict.OPEN] == [expected[-1]]
    assert verdicts.index(expected[-1]) == 3 * len(expected) - 1  # three frames for each search
    if expected[-1] is Verdict.WRONG:
        proposed = way_back.proposals(frame(9), ANYWHERE)
        assert [pose[0, 3] for pose in proposed] == [50.0]


def test_another_part_elsewhere_does_not_contradict_a_pose_where_the_detector_finds_one_too() -> None:
    here, there = np.eye(4), np.eye(4)
    here[2, 3] = there[2, 3] = 400.0
    there[0, 3] = 150.0
    for scores, expected in (((0.9, 0.09), Verdict.RIGHT), ((0.9, 0.01), Verdict.WRONG)):
        way_back, finder = searching(slices=1, score=0.9, budget=10_000.0)
        ahead = np.array([0.0, 0.0, 1.0])
        found = tuple(Detection(pose, score, ahead) for pose, score in zip((there, here), scores, strict=True))

        def both(*_: object, found: tuple[Detection, ...] = found, **__: object) -> Steps[tuple[Detection, ...]]:
            yield 1000.0
            return found

        finder.search = both  # type: ignore[method-assign, assignment]
        verdicts = [way_back.second_look(frame(index), here, here, False) for index in range(2)]
        assert expected in verdicts
        assert (Verdict.WRONG in verdicts) is (expected is Verdict.WRONG)


@pytest.mark.parametrize(("score", "looks"), [(0.9, 1), (0.2, 2)], ids=["at the first look", "at the last"])
def test_a_part_that_was_believed_may_be_doubted_again(score: float, looks: int) -> None:
    way_back, finder = searching(slices=5, score=score, budget=10_000.0)
    finder.pose = np.eye(4)
    for _ in range(3):
        finder.asked.clear()
        verdicts = [way_back.second_look(frame(index), ANYWHERE, ANYWHERE, False) for index in range(looks)]
        assert verdicts == [Verdict.OPEN] * (looks - 1) + [Verdict.RIGHT]
        assert finder.asked == [look.within_deg for look in SECOND_LOOKS[:looks]]


def test_a_part_that_fits_very_well_for_some_frames_needs_no_second_look() -> None:
    way_back, finder = searching(slices=1000, score=0.9, budget=10_000.0)
    finder.pose = np.eye(4)
    for _ in range(2):
        sure = [True, True, False, True, True, True, True, True]
        verdicts = [
            way_back.second_look(frame(index), ANYWHERE, ANYWHERE, is_sure) for index, is_sure in enumerate(sure)
        ]
        assert verdicts == [Verdict.OPEN] * 7 + [Verdict.RIGHT]


def test_a_doubtful_return_teaches_nothing_and_is_lost_again_when_it_is_wrong(
    far_away: tuple[PreparedPart, list[ByteImage], list[FloatArray]], monkeypatch: pytest.MonkeyPatch
) -> None:
    model, images, truth = far_away
    answers = iter([Verdict.OPEN] * 3 + [Verdict.WRONG])
    learnt: list[int] = []
    monkeypatch.setattr(Reacquisition, "doubts", lambda *_: True)
    monkeypatch.setattr(Reacquisition, "second_look", lambda *_: next(answers))
    monkeypatch.setattr(Tracker, "_learn", lambda self, frame, *_: learnt.append(frame.index))
    tracker = Tracker(model)
    tracker.start(Frame(0, images[0], LARGE), truth[0])
    results = [tracker.track(Frame(k, images[k], LARGE)) for k in range(1, 6)]
    results += [tracker.track(Frame(k, images[7], LARGE)) for k in range(6, 9)]
    seen, before = tracker._whereabouts.last_seen, len(learnt)
    results += [tracker.track(Frame(k, images[5], LARGE)) for k in range(9, 14)]
    states = [result.state for result in results[7:]]
    assert states == [TrackState.LOST] * 2 + [TrackState.WEAK] * 3 + [TrackState.LOST]
    assert "elsewhere" in results[-1].note
    assert np.array_equal(tracker._whereabouts.last_seen, seen)
    assert len(learnt) == before


def test_a_part_that_was_weak_and_turns_up_elsewhere_is_doubted(
    far_away: tuple[PreparedPart, list[ByteImage], list[FloatArray]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Half hidden it may have slid on to something else without ever being lost."""
    model, images, truth = far_away
    qualities = iter([0.9, 0.9, 0.4, 0.4, 0.7, 0.7, 0.7])
    asked: list[int] = []
    places: list[FloatArray] = []
    answers = iter([Verdict.OPEN, Verdict.RIGHT])

    def doubts(_: Reacquisition, frame: Frame, pose: FloatArray, quality: float, last_seen: FloatArray) -> bool:
        asked.append(frame.index)
        places.append(last_seen)
        return len(asked) == 1

    monkeypatch.setattr(Assessment, "quality", lambda *_: next(qualities))
    monkeypatch.setattr(Reacquisition, "doubts", doubts)
    monkeypatch.setattr(Reacquisition, "second_look", lambda *_: next(answers))
    tracker = Tracker(model)
    results = [tracker.start(Frame(0, images[0], LARGE), truth[0])]
    results += [tracker.track(Frame(k, images[0], LARGE)) for k in range(1, 7)]
    tracking, weak = TrackState.TRACKING, TrackState.WEAK
    assert [result.state for result in results] == [tracking] * 2 + [weak] * 4 + [tracking]
    assert asked == [4, 6]
    assert np.array_equal(places[0], results[1].cam_T_obj)  # where it was tracked last
    assert np.array_equal(places[1], results[5].cam_T_obj)  # believed, so it is not looked at again


def test_a_part_that_was_weak_and_whose_pose_nothing_fixes_is_doubted(
    far_away: tuple[PreparedPart, list[ByteImage], list[FloatArray]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A cable beside the part may fit well, with all that is asked of where it lies; it fixes no pose."""
    model, images, truth = far_away
    qualities = iter([0.9, 0.9, 0.4, 0.7, 0.7, 0.7])
    answers, looks = iter([Verdict.OPEN, Verdict.RIGHT]), list[int]()

    def second_look(_: Reacquisition, frame: Frame, *__: object) -> Verdict:
        looks.append(frame.index)
        return next(answers)

    monkeypatch.setattr(Assessment, "quality", lambda *_: next(qualities))
    monkeypatch.setattr(Assessment, "exactness", lambda *_: 0.3)
    monkeypatch.setattr(Reacquisition, "doubts", lambda *_: False)
    monkeypatch.setattr(Reacquisition, "second_look", second_look)
    tracker = Tracker(model)
    results = [tracker.start(Frame(0, images[0], LARGE), truth[0])]
    results += [tracker.track(Frame(k, images[0], LARGE)) for k in range(1, 6)]
    tracking, weak = TrackState.TRACKING, TrackState.WEAK
    # An inexact pose of a part that is tracked anyway changes nothing.
    assert [result.state for result in results[:2]] == [tracking] * 2
    # Weak until the detector finds it there, too.
    assert [result.state for result in results[2:]] == [weak] * 3 + [tracking]
    assert looks == [3, 4]


# ---- in a tracker ----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def far_away() -> tuple[PreparedPart, list[ByteImage], list[FloatArray]]:
    """A part that moves, is gone for four frames, and is elsewhere from frame 10 on."""
    part = bracket(shift=(0.0, 0.0, 0.0))
    start = looking_at(part, np.array([0.8, 0.6, 1.0]), 330.0, 0.3)
    truth = poses(part, start, 6)
    elsewhere = start.copy()
    elsewhere[0, 3] += 55.0
    elsewhere[1, 3] -= 30.0
    truth += [truth[-1]] * 4 + [elsewhere] * 25
    images = [draw([] if 6 <= k < 10 else [(part, pose)], k, LARGE) for k, pose in enumerate(truth)]
    model = prepared(part)
    return replace(model, views=make_views(part, model.best_generator())), images, truth


def test_a_part_that_comes_back_elsewhere_is_found(
    far_away: tuple[PreparedPart, list[ByteImage], list[FloatArray]],
) -> None:
    model, images, truth = far_away
    results = {}
    for name, method in {"with": ACP, "without": replace(ACP, way_back=Off())}.items():
        tracker = Tracker(model, method)
        results[name] = [tracker.start(Frame(0, images[0], LARGE), truth[0])]
        results[name] += [tracker.track(Frame(k, image, LARGE)) for k, image in enumerate(images[1:], 1)]
    found = results["with"]
    assert [result.state for result in found[:6]] == [TrackState.TRACKING] * 6
    assert {result.state for result in found[8:10]} == {TrackState.LOST}
    assert found[-1].state is TrackState.TRACKING
    assert add_percent(model.part, found[-1].cam_T_obj, truth[-1]) < 2.0
    # A lost frame tells where was searched; others have nothing to tell.
    lost = [result for result in found if result.state is TrackState.LOST]
    assert lost[0].sought is None  # nobody has searched yet
    assert all(result.sought is not None for result in lost[1:])
    assert all(result.sought is None for result in found if result.state is not TrackState.LOST)
    assert found[8].sought is not None
    assert found[8].sought.near is not None
    assert add_percent(model.part, found[8].sought.near, truth[5]) < 2.0
    hypotheses = [result.sought.found for result in found[10:] if result.sought is not None]
    assert any(pose is not None and add_percent(model.part, pose, truth[-1]) < 10.0 for pose in hypotheses)
    # Never believed in the first frame that fits.
    first = next(k for k in range(10, 35) if found[k].state is not TrackState.LOST)
    assert found[first - 1].quality > ACP.states.found_above
    wrong = [k for k in range(10, 35) if found[k].state is TrackState.TRACKING
             and add_percent(model.part, found[k].cam_T_obj, truth[k]) > 30.0]  # fmt: skip
    assert wrong == []
    assert results["without"][-1].state is TrackState.LOST


def test_nothing_is_learnt_and_nothing_followed_while_lost(
    far_away: tuple[PreparedPart, list[ByteImage], list[FloatArray]],
) -> None:
    model, images, truth = far_away
    tracker = Tracker(model)
    tracker.start(Frame(0, images[0], LARGE), truth[0])
    for k in range(1, 6):
        tracker.track(Frame(k, images[k], LARGE))
    noise = np.random.default_rng(0)
    for k in range(6, 16):
        clutter = noise.integers(0, 255, images[0].shape).astype(np.uint8)
        tracker.track(Frame(k, clutter, LARGE))
    assert add_percent(model.part, tracker.last, truth[5]) < 5.0
    back = [tracker.track(Frame(k, images[5], LARGE)) for k in range(16, 20)]
    assert back[-1].state is TrackState.TRACKING
    assert add_percent(model.part, back[-1].cam_T_obj, truth[5]) < 2.0


def test_a_leap_back_is_no_velocity(far_away: tuple[PreparedPart, list[ByteImage], list[FloatArray]]) -> None:
    """A part that is found again a little beside where it was does not go on by that much in the next frame."""
    model, images, truth = far_away
    tracker = Tracker(model)
    tracker.start(Frame(0, images[0], LARGE), truth[0])
    empty = images[7]
    for k in range(1, 6):
        tracker.track(Frame(k, empty, LARGE))
    beside = truth[0].copy()
    beside[0, 3] += 7.0
    back = tracker.track(Frame(6, draw([(model.part, beside)], 6, LARGE), LARGE))
    assert back.state is TrackState.LOST  # it takes two frames
    assert back.quality > ACP.states.found_above
    assert add_percent(model.part, back.cam_T_obj, beside) < 2.0
    assert add_percent(model.part, tracker.predicted, back.cam_T_obj) < 1.0


def test_a_part_that_is_back_is_looked_for_by_its_new_picture(
    far_away: tuple[PreparedPart, list[ByteImage], list[FloatArray]],
) -> None:
    """Nothing is known of how fast it is; a picture of before it was lost would be of another place and side."""
    model, images, truth = far_away
    tracker = Tracker(model)
    tracker.start(Frame(0, images[0], LARGE), truth[0])
    for k in range(1, 6):
        tracker.track(Frame(k, images[7], LARGE))
    beside = truth[0].copy()
    beside[0, 3] += 7.0
    back = tracker.track(Frame(6, draw([(model.part, beside)], 6, LARGE), LARGE))
    assert back.state is TrackState.LOST  # it takes two frames
    pictures = tracker._pursuit.picture_memory
    assert pictures is not None
    assert pictures.kept is not None
    _, pose, _ = pictures.kept
    assert add_percent(model.part, pose, beside) < 2.0


def test_weak_poses_do_not_move_where_it_was_last_seen(
    far_away: tuple[PreparedPart, list[ByteImage], list[FloatArray]],
) -> None:
    """They may be of something else, which must not be what the search goes around."""
    model, images, truth = far_away
    doubtful = replace(ACP, states=replace(ACP.states, weak_below=2.0, tracking_above=2.0))
    for method, expected in ((ACP, truth[5]), (doubtful, truth[0])):
        tracker = Tracker(model, method)
        tracker.start(Frame(0, images[0], LARGE), truth[0])
        for k in range(1, 6):
            tracker.track(Frame(k, images[k], LARGE))
        for k in range(6, 10):
            lost = tracker.track(Frame(k, images[k], LARGE))
        assert lost.state is TrackState.LOST
        assert add_percent(model.part, tracker.last, expected) < 2.0


def test_searches_that_cost_next_to_nothing_do_not_fill_a_frame_by_the_thousand() -> None:
    """A part that hardly shows in a small image is looked for in no time, again and again."""
    way_back, finder = searching(slices=1, score=0.0, budget=25_000.0)

    def hardly_anything(frame: Frame, top: int, prior: object, *_: object) -> Steps[tuple[Detection, ...]]:
        finder.asked.append(0.0)
        yield 0.5
        return ()

    finder.search = hardly_anything  # type: ignore[method-assign, assignment]
    way_back.proposals(frame(0), ANYWHERE)
    assert 1 <= len(finder.asked) <= 25
