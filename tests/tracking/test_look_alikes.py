"""Another part like the tracked one, which was there before, is not taken for it."""

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
from acp_lab.tracking.find import Detection, are_apart, place_score, scores_in_place
from acp_lab.tracking.look_alikes import SOLVE_WORK, LookAlikes, Seen
from acp_lab.tracking.method import ACP
from acp_lab.tracking.recovery import WayBack
from acp_lab.tracking.result import TrackResult, TrackState
from acp_lab.tracking.second_thoughts import SecondThoughts
from acp_lab.tracking.stopwatch import Stopwatch
from acp_lab.tracking.tracker import Tracker
from acp_lab.tracking.way_back import SURE_FRAMES, SURE_QUALITY
from tests.made_parts import box, bracket, looking_at
from tests.tracking.rendered import add_percent, draw, prepared

LARGE = Camera(width=320, height=256, fx=420.0, fy=425.0, cx=159.5, cy=127.5)
PART = bracket(shift=(0.0, 0.0, 0.0))
HERE = looking_at(PART, np.array([0.8, 0.6, 1.0]), 330.0, 0.3)
IMAGE = np.zeros((LARGE.height, LARGE.width, 3), np.uint8)
ENOUGH = 1e9


def beside(diameters: float, pose: FloatArray = HERE) -> FloatArray:
    """A pose (4, 4) so far to the right of another."""
    moved = pose.copy()
    moved[0, 3] += diameters * PART.diameter
    return moved


def frame(index: int, camera: Camera = LARGE) -> Frame:
    return Frame(index, IMAGE, camera)


class Found:
    """Stands for a finder that finds parts at told poses, by a search of a told length."""

    def __init__(self, *poses: FloatArray, slices: int = 3) -> None:
        self.poses, self.slices, self.searches = poses, slices, 0

    def search(self, _: Frame, most: int, *__: object) -> Steps[tuple[Detection, ...]]:
        self.searches += 1
        for _slice in range(self.slices):
            yield 1000.0
        return tuple(Detection(pose, 0.9 / len(self.poses), np.array([0.0, 0.0, 1.0])) for pose in self.poses[:most])


def showing(*, before: tuple[FloatArray, ...], now: tuple[FloatArray, ...]) -> Seen:
    """What solving shows: the nearest of the parts that are there, if one is within half a diameter."""

    def seen(at: Frame, pose: FloatArray) -> FloatArray | None:
        there = before if at.index < 100 else now
        near = [one for one in there if np.linalg.norm(one[:3, 3] - pose[:3, 3]) < 0.5 * PART.diameter]
        return min(near, key=lambda one: float(np.linalg.norm(one[:3, 3] - pose[:3, 3])), default=None)

    return seen


def watching(finder: Found, remembered_frames: int = 300) -> LookAlikes:
    """Look-alikes that have seen the part where it is `HERE`, in the frame before the hundredth."""
    alike = LookAlikes(PART, remembered_frames, lambda: finder)  # type: ignore[arg-type, return-value]
    for index in range(100 - SURE_FRAMES, 100):
        alike.next_frame()
        alike.take_in(frame(index), HERE, SURE_QUALITY)
    alike.next_frame()
    return alike


FAR, FARTHER = beside(1.0), beside(2.0)


@pytest.mark.parametrize(
    ("back_at", "before", "now", "found", "expected"),
    [
        (FAR, (HERE, FAR), (FAR,), (), True),
        (FAR, (HERE,), (FAR,), (), False),  # nothing was there: the part has moved
        (beside(0.1), (HERE, beside(0.1)), (beside(0.1),), (), False),  # no room for two
        (FARTHER, (HERE, beside(1.4)), (FARTHER,), (beside(1.4),), True),  # a camera went on, and the search finds it
        (FARTHER, (HERE, beside(1.4)), (FARTHER,), (), False),  # nobody says that something was there
        (FAR, (HERE, beside(1.3)), (FAR, beside(1.4)), (), False),  # what was there is still there, beside this
        (FAR, (HERE, beside(2.2)), (FAR,), (beside(2.2),), False),  # nearer to where the part was
    ],
    ids=["was there", "was not", "in its place", "went on", "not found", "is still there", "nearer to the part"],
)
def test_what_was_there_before_is_another_part(
    back_at: FloatArray,
    before: tuple[FloatArray, ...],
    now: tuple[FloatArray, ...],
    found: tuple[FloatArray, ...],
    expected: bool,
) -> None:
    finder = Found(*found)
    alike, seen = watching(finder), showing(before=before, now=now)
    assert alike.ask(frame(100), back_at, seen, ENOUGH) is expected
    searches = finder.searches
    assert alike.is_one(frame(100), back_at, seen) is expected
    assert finder.searches == (searches if expected else 2 * searches)  # what was there is known again


def test_who_asks_waits_until_the_search_has_ended() -> None:
    """However fast it moves meanwhile."""
    for step in (0.0, 0.3):
        finder = Found(beside(1.4), slices=10)
        alike, seen = watching(finder), showing(before=(HERE, beside(1.4)), now=(FARTHER,))
        answers: list[bool | None] = []
        while not answers or answers[-1] is None:
            answers.append(alike.ask(frame(100), beside(2.0 + step * len(answers)), seen, 4_000.0))
            alike.next_frame()
        assert answers[-1] is True
        assert 10 * 1000.0 / 4_000.0 < len(answers) <= 1 + (10 * 1000.0 + 3 * SOLVE_WORK) / 4_000.0
        assert finder.searches == 1


def test_a_question_has_an_end() -> None:
    alike, seen = watching(Found(beside(1.4), slices=10_000)), showing(before=(HERE, beside(1.4)), now=(FARTHER,))
    answers = []
    for _ in range(12):
        answers.append(alike.ask(frame(100), FARTHER, seen, 4_000.0))
        alike.next_frame()
    assert answers == [None] * 10 + [False] * 2


def test_another_part_is_known_again_for_a_while_without_a_search() -> None:
    finder = Found(beside(1.4))
    alike, seen = watching(finder), showing(before=(HERE, beside(1.4)), now=(FARTHER,))
    assert alike.ask(frame(100), FARTHER, seen, ENOUGH) is True
    for k in range(1, 40):
        alike.next_frame()
        assert alike.ask(frame(100 + k), beside(2.0 + 0.01 * k), seen, ENOUGH) is True
        assert finder.searches == (1 if k <= 30 else 2)


def test_a_wrong_answer_is_mended_when_more_is_seen() -> None:
    """The part is back beside another one that is covered, so it seems to be that."""
    alike = watching(Found())
    assert alike.ask(frame(100), FAR, showing(before=(HERE, beside(1.3)), now=(FAR,)), ENOUGH) is True
    both = showing(before=(HERE, beside(1.3)), now=(FAR, beside(1.4)))
    answers = []
    for k in range(40):
        alike.next_frame()
        answers.append(alike.ask(frame(101 + k), FAR, both, ENOUGH))
    assert answers == [True] * 30 + [False] * 10


def test_what_was_cleared_is_asked_about_once_as_long_as_it_is_followed() -> None:
    finder = Found()
    alike, seen = watching(finder), showing(before=(HERE,), now=(FAR,))
    for k in range(10):  # as it moves on
        assert alike.ask(frame(100 + k), beside(1.0 + 0.1 * k), seen, ENOUGH) is False
        alike.next_frame()
    assert finder.searches == 1
    alike.next_frame()  # in which nobody asked
    alike.ask(frame(120), beside(1.9), seen, ENOUGH)
    assert finder.searches == 2


def test_an_open_question_is_dropped_when_nothing_fits() -> None:
    finder = Found(slices=10)
    alike, seen = watching(finder), showing(before=(HERE,), now=(FAR,))
    assert alike.ask(frame(100), FAR, seen, 4_000.0) is None
    for _ in range(50):
        alike.next_frame()
    there = showing(before=(HERE, FAR), now=(FAR,))
    assert alike.ask(frame(150), FAR, there, ENOUGH) is True


@pytest.mark.parametrize("remembered_frames", [1, 40])
def test_after_a_while_nobody_knows_what_was_there(remembered_frames: int) -> None:
    alike, seen = watching(Found(), remembered_frames), showing(before=(HERE, FAR), now=(FAR,))
    for k in range(50):
        assert alike.is_one(frame(100 + k), FAR, seen) is (1 + k <= remembered_frames)
        alike.next_frame()


def test_only_a_part_that_is_surely_there_tells_what_else_is() -> None:
    seen, good, poor = showing(before=(HERE, FAR), now=(FAR,)), SURE_QUALITY, SURE_QUALITY - 0.01
    for qualities, knows in (
        ([good] * (SURE_FRAMES - 1), False),
        ([good] * (SURE_FRAMES - 1) + [poor] + [good] * (SURE_FRAMES - 1), False),
        ([good] * (SURE_FRAMES - 1) + [None] + [good], False),  # in between it was lost
        ([good] * SURE_FRAMES, True),
    ):
        alike = LookAlikes(PART, 300, Found)  # type: ignore[arg-type, return-value]
        for index, quality in enumerate(qualities):
            alike.next_frame()
            if quality is None:
                alike.doubt()
            else:
                alike.take_in(frame(index), HERE, quality)
        assert alike.is_one(frame(100), FAR, seen) is knows
        alike.forget()
        assert alike.is_one(frame(100), FAR, seen) is False


def test_frames_of_another_camera_are_not_compared() -> None:
    alike, seen = watching(Found()), showing(before=(HERE, FAR), now=(FAR,))
    assert alike.ask(frame(100, replace(LARGE, fx=421.0)), FAR, seen, ENOUGH) is False
    alike.next_frame()
    assert alike.ask(frame(101), FAR, seen, ENOUGH) is True


def test_large_frames_are_kept_less_often_and_as_copies() -> None:
    camera = Camera(2000, 1000, 2000.0, 2000.0, 999.5, 499.5)
    alike = LookAlikes(PART, 300, Found)  # type: ignore[arg-type, return-value]
    kept, image = [], np.zeros((1000, 2000, 3), np.uint8)
    for index in range(45):
        alike.next_frame()
        image[:] = index
        alike.take_in(Frame(index, image, camera), HERE, 1.0)
        if alike._kept is not None and (not kept or alike._kept[0].index != kept[-1]):
            kept.append(alike._kept[0].index)
    assert kept == [19, 39]
    assert alike._kept is not None
    assert (alike._kept[0].image == 39).all()


# ---- scores ----------------------------------------------------------------------------------------------------


def test_two_parts_are_apart_across_the_line_of_sight_only() -> None:
    nearer = HERE.copy()
    nearer[:3, 3] *= 0.7
    assert not are_apart(PART, LARGE, nearer, HERE)
    assert not are_apart(PART, LARGE, beside(0.2), HERE)
    assert are_apart(PART, LARGE, beside(0.3), HERE)
    behind = HERE.copy()
    behind[2, 3] *= -1.0
    assert not are_apart(PART, LARGE, behind, FARTHER)
    assert not are_apart(PART, LARGE, HERE, HERE)


def test_slim_parts_may_be_nearer_to_each_other_across_than_along() -> None:
    rod = box((100.0, 12.0, 12.0))
    pose = np.eye(4)
    pose[2, 3] = 400.0
    for direction, width, factor in ((0, 100.0, 0.25 * rod.diameter / 100.0), (1, 12.0, 0.5)):
        for share, expected in ((0.8, False), (1.3, True)):
            other = pose.copy()
            other[direction, 3] = share * factor * width
            assert are_apart(rod, LARGE, other, pose) is expected


def test_the_part_is_in_a_place_in_whatever_pose() -> None:
    def told(*scores: tuple[FloatArray, float]) -> list[Detection]:
        return [Detection(pose, score, np.zeros(3)) for pose, score in scores]

    found = told((FAR, 0.6), (HERE, 0.2), (beside(0.05), 0.1))
    assert place_score(PART, LARGE, HERE, found) == pytest.approx(3.0 / 4.0)
    assert place_score(PART, LARGE, FAR, found) == pytest.approx(6.0 / 7.0)
    assert place_score(PART, LARGE, FARTHER, found) == 0.0


def test_parts_in_different_places_do_not_compete() -> None:
    def hypotheses(odds: list[float], poses: list[FloatArray]) -> list[Detection]:
        shared = np.array(odds) / (1.0 + sum(odds))
        return [Detection(pose, float(one), np.zeros(3)) for pose, one in zip(poses, shared, strict=True)]

    one = scores_in_place(PART, LARGE, hypotheses([9.0, 4.0], [HERE, FAR]))
    assert one == pytest.approx([0.9, 0.8])
    both = scores_in_place(PART, LARGE, hypotheses([9.0, 4.0, 1.0], [HERE, FAR, beside(0.1)]))
    assert both == pytest.approx([9.0 / 11.0, 0.8, 1.0 / 11.0])
    assert scores_in_place(PART, LARGE, []) == []


# ---- in a tracker ----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def model() -> PreparedPart:
    plain = prepared(PART)
    return replace(plain, views=make_views(PART, plain.best_generator()))


LEFT, RIGHT = beside(-0.55), beside(0.62)


def images_of(covered: int, after: int) -> tuple[list[ByteImage], list[FloatArray]]:
    """Two parts like each other: one that is tracked, moves a little, and is covered for a while; one that rests."""
    truth = [beside(0.002 * k, LEFT) for k in range(12 + covered + after)]
    images = []
    for k, pose in enumerate(truth):
        is_covered = 12 <= k < 12 + covered
        images.append(draw([(PART, RIGHT)] + ([] if is_covered else [(PART, pose)]), k, LARGE))
    return images, truth


def test_a_hidden_part_is_not_found_in_another_one_like_it(model: PreparedPart) -> None:
    images, truth = images_of(covered=20, after=12)
    wrong = {}
    for name, remembered_frames in (("remembers", 300), ("does not", 0)):
        method = replace(ACP, way_back=replace(WayBack(), remembered_frames=remembered_frames))
        tracker = Tracker(model, method)
        results = [tracker.start(Frame(0, images[0], LARGE), truth[0])]
        results += [tracker.track(Frame(k, image, LARGE)) for k, image in enumerate(images[1:], 1)]
        wrong[name] = sum(
            one.state is not TrackState.LOST and add_percent(PART, one.cam_T_obj, RIGHT) < 10.0 for one in results
        )
        if remembered_frames:
            assert results[-1].state is TrackState.TRACKING
            assert add_percent(PART, results[-1].cam_T_obj, truth[-1]) < 2.0
    assert wrong["remembers"] == 0
    assert wrong["does not"] > 10


def test_a_part_that_moved_while_it_was_hidden_is_found_beside_another_one(model: PreparedPart) -> None:
    """It comes back where nothing was: below the place where it was, while the other one still lies beside."""
    images, truth = images_of(covered=12, after=0)
    there = beside(-0.1)
    there[1, 3] += 0.3 * PART.diameter
    last = looking_at(PART, np.array([0.8, 0.6, 1.0]), 330.0, 0.3)
    last[:3, 3] = there[:3, 3]
    images += [draw([(PART, RIGHT), (PART, last)], k, LARGE) for k in range(40)]
    tracker = Tracker(model)
    tracker.start(Frame(0, images[0], LARGE), truth[0])
    results = [tracker.track(Frame(k, image, LARGE)) for k, image in enumerate(images[1:], 1)]
    assert results[-1].state is TrackState.TRACKING
    assert add_percent(PART, results[-1].cam_T_obj, last) < 2.0
    assert not any(
        one.state is TrackState.TRACKING and add_percent(PART, one.cam_T_obj, RIGHT) < 10.0 for one in results
    )


def hidden_and_back(
    model: PreparedPart, first: FloatArray, hidden: list[FloatArray], back: list[list[FloatArray]]
) -> list[TrackResult]:
    """Tracked for twelve frames, hidden for sixteen, and back: all poses in each frame then. hidden: of the others."""
    scenes = [[first, *hidden]] * 12 + [hidden] * 16 + back
    images = [draw([(PART, pose) for pose in scene], k, LARGE) for k, scene in enumerate(scenes)]
    tracker = Tracker(model)
    results = [tracker.start(Frame(0, images[0], LARGE), first)]
    return results + [tracker.track(Frame(k, image, LARGE)) for k, image in enumerate(images[1:], 1)]


def back_after(results: list[TrackResult], truth: list[FloatArray]) -> int | None:
    """Frames until it is tracked, where it is, to the end."""
    right = [
        one.state is TrackState.TRACKING and add_percent(PART, one.cam_T_obj, pose) < 8.0
        for one, pose in zip(results[28:], truth, strict=True)
    ]
    return next((k for k in range(len(right)) if all(right[k:])), None)


def test_a_fast_part_is_not_asked_about_for_ever(model: PreparedPart) -> None:
    """It moves by more than a quarter of its diameter in each frame, and nothing like it is about."""
    first, truth = beside(-0.45), []
    for k in range(24):
        step = 0.27 * min(k % 14, 14 - k % 14)
        pose = beside(-1.05 + step)
        pose[1, 3] -= 0.35 * PART.diameter
        truth.append(pose)
    after = back_after(hidden_and_back(model, first, [], [[pose] for pose in truth]), truth)
    assert after is not None
    assert after <= 10


@pytest.mark.parametrize("gap", [0.6, 0.75])
def test_a_close_neighbour_does_not_keep_the_search_from_the_part(model: PreparedPart, gap: float) -> None:
    first = beside(-0.45)
    other = beside(-0.45 + gap)
    results = hidden_and_back(model, first, [other], [[first, other]] * 12)
    after = back_after(results, [first] * 12)
    assert after is not None
    assert after <= 8


@pytest.mark.parametrize("is_one", [False, True])
def test_second_thoughts_do_not_lead_to_what_was_there_before(
    model: PreparedPart, is_one: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Solved:
        cam_T_obj = FAR

    monkeypatch.setattr(SecondThoughts, "prefer", lambda *_: True)
    monkeypatch.setattr(Assessment, "right", lambda *_: 1.0)
    monkeypatch.setattr(LookAlikes, "is_one", lambda *_: is_one)
    whereabouts = Tracker(model)._whereabouts
    preferred = whereabouts.prefers(frame(0), Solved(), Solved(), lambda *_: None, Stopwatch())  # type: ignore[arg-type]
    assert preferred is not is_one


@pytest.mark.parametrize("value", [-1])
def test_nonsense_is_refused(value: int) -> None:
    with pytest.raises(TrackingError, match=r"way_back\.remembered_frames = -1"):
        WayBack(remembered_frames=value)
