"""Whether a part that fits poorly for some frames is where it is followed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from acp_lab.cad.models_info import Symmetries
from acp_lab.cad.part import Part
from acp_lab.detection.view_templates import make_views
from acp_lab.detection.work import Steps
from acp_lab.errors import TrackingError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose_step import move_pose
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.tracking.assessment import Assessment
from acp_lab.tracking.find import Detection
from acp_lab.tracking.learning.knowledge import Off
from acp_lab.tracking.method import ACP
from acp_lab.tracking.pursuit import Pursuit
from acp_lab.tracking.recovery import WayBack
from acp_lab.tracking.second_thoughts import LEAST_SCORE, SecondThoughts
from acp_lab.tracking.solution import Solution
from acp_lab.tracking.start import LOOK_LEVEL
from acp_lab.tracking.stopwatch import Stopwatch
from acp_lab.tracking.tracker import Tracker
from tests.made_parts import bracket, looking_at
from tests.tracking.rendered import add_percent, draw, poses, prepared

LARGE = Camera(width=320, height=256, fx=420.0, fy=425.0, cx=159.5, cy=127.5)
HERE = np.eye(4)
POOR, WELL = 0.84, 0.85
ELSEWHERE = np.eye(4)
ELSEWHERE[0, 3] = 40.0


@pytest.mark.parametrize("values", [{"poor_below": 1.5}, {"poor_below": float("nan")}, {"poor_frames": -1}])
def test_nonsense_is_refused(values: dict[str, float]) -> None:
    with pytest.raises(TrackingError, match="way_back"):
        WayBack(**values)  # type: ignore[arg-type]


class Searched:
    """Stands for a finder that looks for a told number of frames and finds told poses."""

    def __init__(self, found: list[tuple[FloatArray, float]], frames: int = 1) -> None:
        self.found, self.frames = found, frames
        self.searched: list[int] = []

    def is_same(self, cam_T_obj: FloatArray, others: tuple[FloatArray, ...]) -> bool:
        return any(np.allclose(cam_T_obj, other) for other in others)

    def search(
        self, frame: Frame, top: int, prior: object, aligned_most: int | None = None, rival: FloatArray | None = None
    ) -> Steps[tuple[Detection, ...]]:
        self.searched.append(frame.index)
        for _ in range(self.frames):
            yield 1e6
        return tuple(Detection(pose, score, np.array([0.0, 0.0, 1.0])) for pose, score in self.found)


def thinking(finder: Searched, **settings: float) -> SecondThoughts:
    model = prepared(bracket(shift=(0.0, 0.0, 0.0)))
    return SecondThoughts(model, WayBack(**settings), lambda: finder)  # type: ignore[arg-type, return-value]


def frame(index: int) -> Frame:
    return Frame(index, np.zeros((4, 4, 3), np.uint8), Camera(4, 4, 4.0, 4.0, 1.5, 1.5))


def here(index: int) -> FloatArray:
    return HERE


def played(
    thoughts: SecondThoughts,
    qualities: list[float],
    lost: tuple[int, ...] = (),
    at: Callable[[int], FloatArray] = here,
) -> list[int]:
    """In which frames something is proposed; at: where the part is followed."""
    proposed = []
    for index, quality in enumerate(qualities):
        if index not in lost and thoughts.proposals(frame(index), at(index)):
            proposed.append(index)
        thoughts.take_in(quality, index in lost)
    return proposed


def test_the_detector_looks_around_a_part_that_fits_poorly_for_some_frames() -> None:
    # It starts in the frame after five poor ones, works on in the next, and then begins anew.
    for frames, proposed in ((1, [6, 8, 10]), (3, [8])):
        finder = Searched([(ELSEWHERE, 0.5)], frames)
        assert played(thinking(finder), [POOR] * 11) == proposed
        assert finder.searched[0] == 5
    # Not as long as it fits, or fitted a moment ago, or is lost.
    for qualities, lost in (
        ([WELL] * 11, ()),
        ([POOR, POOR, POOR, POOR, WELL] * 3, ()),
        ([POOR] * 11, tuple(range(4, 11))),
    ):
        finder = Searched([(ELSEWHERE, 0.5)])
        assert played(thinking(finder), qualities, lost) == []
        assert finder.searched == []


def test_a_search_goes_on_when_the_part_fits_again_but_not_for_long() -> None:
    for well, proposed in ((1, [8]), (5, [])):
        finder = Searched([(ELSEWHERE, 0.5)], frames=well + 2)
        assert played(thinking(finder), [POOR] * 5 + [WELL] * well + [POOR] * 3)[:1] == proposed


@pytest.mark.parametrize(
    ("found", "ends"),
    [
        ([(HERE, 0.5)], 1),  # one search, which ends in the frame after its first
        ([(ELSEWHERE, 0.4), (HERE, 0.5)], 1),
        ([(ELSEWHERE, 0.5)], 5),  # that speaks against it: three searches have to be enough
        ([(HERE, 0.4)], 5),
        ([], 5),
    ],
)
def test_a_part_that_was_lost_is_on_probation(found: list[tuple[FloatArray, float]], ends: int) -> None:
    thoughts = thinking(Searched(found))
    assert not thoughts.on_probation
    thoughts.take_in(0.1, True)
    probation = list[bool]()
    for index in range(8):
        thoughts.proposals(frame(index), HERE)
        probation.append(thoughts.on_probation)
        thoughts.take_in(POOR if index == 0 else WELL, False)
    assert probation == [True] * ends + [False] * (8 - ends)


def test_fitting_well_for_some_frames_ends_a_probation() -> None:
    thoughts = thinking(Searched([], frames=100))
    thoughts.take_in(0.1, True)
    probation = list[bool]()
    for index, quality in enumerate([WELL] * 4 + [POOR] + [WELL] * 6):
        thoughts.proposals(frame(index), HERE)
        thoughts.take_in(quality, False)
        probation.append(thoughts.on_probation)
    assert probation == [True] * 9 + [False] * 2


def test_a_frame_with_nothing_to_think_of_ends_a_search_but_no_probation() -> None:
    """A part in doubt, above all, is not believed for being doubted."""
    finder = Searched([(HERE, 0.9)], frames=2)
    thoughts = thinking(finder)
    thoughts.take_in(0.1, True)
    assert thoughts.proposals(frame(0), HERE) == []
    thoughts.pause()
    assert thoughts.on_probation
    for index in range(1, 4):
        assert thoughts.on_probation
        thoughts.proposals(frame(index), HERE)
    assert finder.searched == [0, 1]
    assert not thoughts.on_probation


def test_nobody_is_on_probation_where_second_thoughts_are_off() -> None:
    thoughts = thinking(Searched([(ELSEWHERE, 0.9)]), poor_frames=0)
    assert played(thoughts, [POOR] * 8, (0, 1)) == []
    assert not thoughts.on_probation


def test_how_many_frames_are_poor_is_a_setting() -> None:
    assert played(thinking(Searched([(ELSEWHERE, 0.5)]), poor_frames=2), [POOR] * 4) == [3]
    finder = Searched([(ELSEWHERE, 0.5)])
    assert played(thinking(finder, poor_frames=0), [0.3] * 20) == []
    assert played(thinking(finder, poor_below=0.5), [0.5] * 20) == []
    assert finder.searched == []


def test_what_is_found_where_the_part_is_followed_or_is_unlikely_is_not_proposed() -> None:
    for found in ([(HERE, 0.9)], [(ELSEWHERE, 0.9 * LEAST_SCORE)], []):
        finder = Searched(found)
        assert played(thinking(finder), [POOR] * 9) == []
        assert finder.searched == [5, 7]


def test_what_is_found_where_the_part_was_when_it_was_searched_is_not_proposed() -> None:
    """A part that is followed rightly has moved on since."""

    def moving(index: int) -> FloatArray:
        pose = np.eye(4)
        pose[0, 3] = 8.0 * index
        return pose

    for started, proposed in ((5, []), (6, [8])):
        finder = Searched([(moving(started), 0.9)], frames=3)
        assert played(thinking(finder), [POOR] * 9, at=moving) == proposed


def test_of_equal_poses_of_a_symmetric_part_the_nearest_is_proposed() -> None:
    flipped = np.diag([-1.0, -1.0, 1.0, 1.0])
    part = replace(bracket(shift=(0.0, 0.0, 0.0)), symmetries=Symmetries(discrete=(flipped,)))
    thoughts = SecondThoughts(prepared(part), WayBack(), lambda: Searched([(ELSEWHERE @ flipped, 0.5)]))  # type: ignore[arg-type, return-value]
    for _ in range(5):
        thoughts.take_in(POOR, False)
    assert thoughts.proposals(frame(5), HERE) == []
    (found,) = thoughts.proposals(frame(6), HERE)
    np.testing.assert_allclose(found, ELSEWHERE, atol=1e-12)


class Scored:
    def __init__(self, score: float, cam_T_obj: FloatArray) -> None:
        self.score, self.cam_T_obj = score, cam_T_obj


def test_a_pose_is_replaced_by_what_fits_better_elsewhere_and_is_surely_right() -> None:
    thoughts, followed = thinking(Searched([])), Scored(0.5, HERE)
    for score, pose, right, is_preferred in (
        (0.54, ELSEWHERE, 0.9, True),
        (0.52, ELSEWHERE, 1.0, False),
        (0.9, ELSEWHERE, 0.89, False),
        (0.9, HERE, 1.0, False),
    ):
        assert thoughts.prefer(Scored(score, pose), right, followed) is is_preferred  # type: ignore[arg-type]


def test_a_gap_is_no_row_of_frames() -> None:
    part = bracket(shift=(0.0, 0.0, 0.0))
    pose = looking_at(part, np.array([0.8, 0.6, 1.0]), 330.0, 0.3)
    model = prepared(part)
    model = replace(model, views=make_views(part, model.best_generator()))
    tracker = Tracker(model, replace(ACP, way_back=WayBack(poor_below=1.0)))
    thoughts = tracker._whereabouts._second_thoughts
    assert thoughts is not None
    shown = Frame(0, draw([(part, pose)], 0, LARGE), LARGE)
    tracker.start(shown, pose)
    for k in range(1, 4):
        tracker.track(replace(shown, index=k))
    assert thoughts._poor_frames == 3
    tracker.track(UnreadableFrame(4, LARGE, "gone"))
    assert thoughts._poor_frames == 0


@pytest.mark.parametrize(("gap", "expected"), [(None, [0, 1, 2, 8, 9]), (4, [0, 1, 2, 9])])
def test_a_part_on_probation_teaches_nothing(
    gap: int | None, expected: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Five frames that fit well are enough; one that is not seen is none of them, and changes nothing."""
    part = bracket(shift=(0.0, 0.0, 0.0))
    pose = looking_at(part, np.array([0.8, 0.6, 1.0]), 330.0, 0.3)
    model = prepared(part)
    tracker = Tracker(replace(model, views=make_views(part, model.best_generator())))
    shown, learnt = Frame(0, draw([(part, pose)], 0, LARGE), LARGE), list[int]()
    monkeypatch.setattr(Tracker, "_learn", lambda self, frame, *_: learnt.append(frame.index))
    monkeypatch.setattr(SecondThoughts, "proposals", lambda *_: [])
    thoughts = tracker._whereabouts._second_thoughts
    assert thoughts is not None
    tracker.start(shown, pose)
    for k in range(1, 10):
        if k == 3:
            thoughts.take_in(0.1, True)
        tracker.track(UnreadableFrame(k, LARGE, "gone") if k == gap else replace(shown, index=k))
    assert learnt == expected


def test_methods_without_a_probability_have_no_second_thoughts() -> None:
    model = prepared(bracket())
    model = replace(model, views=make_views(model.part, model.best_generator()))
    assert Tracker(model)._whereabouts._second_thoughts is not None
    assert Tracker(model, replace(ACP, confidence=Off()))._whereabouts._second_thoughts is None
    assert Tracker(replace(model, views=None))._whereabouts._second_thoughts is None


def test_a_part_that_is_followed_beside_itself_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    part: Part = bracket(shift=(0.0, 0.0, 0.0))
    truth = poses(part, looking_at(part, np.array([0.8, 0.6, 1.0]), 330.0, 0.3), 30, np.zeros(6))
    images = [draw([(part, pose)], k, LARGE) for k, pose in enumerate(truth)]
    model = prepared(part)
    model = replace(model, views=make_views(part, model.best_generator()))
    beside = move_pose(truth[0], part.box_centre, np.array([0.0, 0.0, 0.4, 12.0, -8.0, 60.0]))

    def fits_somewhat(_: Assessment, solution: Solution) -> float:
        """The part never counts as lost."""
        return 0.97 if add_percent(part, solution.cam_T_obj, truth[0]) < 5.0 else 0.6

    follow = Pursuit.follow

    def stuck(pursuit: Pursuit, frame: Frame, clock: Stopwatch) -> tuple[FloatArray, Solution | None]:
        """What is beside the part stays there."""
        if add_percent(part, pursuit.predicted, truth[0]) < 5.0:
            return follow(pursuit, frame, clock)
        seen = pursuit.look(frame, pursuit.predicted, clock)
        assert seen is not None
        return pursuit.predicted, pursuit.solver.look_at(seen, seen.view.at_pose(beside), LOOK_LEVEL, clock)

    monkeypatch.setattr(Assessment, "quality", fits_somewhat)
    monkeypatch.setattr(Pursuit, "follow", stuck)
    off, notes = dict[str, list[float]](), list[str]()
    for name, poor_frames in (("with", 5), ("without", 0)):
        method = replace(ACP, recovery=Off(), sight=Off(), way_back=WayBack(poor_frames=poor_frames))
        tracker = Tracker(model, method)
        tracker.start(Frame(0, images[0], LARGE), truth[0])
        tracker._pursuit.restart(beside)
        off[name] = []
        for k in range(1, len(images)):
            result = tracker.track(Frame(k, images[k], LARGE))
            off[name].append(add_percent(part, result.cam_T_obj, truth[0]))
            if "elsewhere" in result.note:
                notes.append(result.note)
                # How fast it is nobody knows.
                assert not tracker._pursuit.predictor.is_sure(LARGE)
                assert tracker._pursuit.predictor.motion is None
    assert min(off["without"]) > 10.0
    assert min(off["with"][:5]) > 10.0
    assert max(off["with"][-10:]) < 2.0
    assert notes == ["the detector finds it elsewhere"]
