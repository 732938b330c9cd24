"""By which tooth a wheel is turned."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from acp_lab.cad.near_turns import near_turns
from acp_lab.errors import TrackingError
from acp_lab.generator.base import GeneratedEdges
from acp_lab.geometry.arrays import BoolArray, FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.in_image import in_image
from acp_lab.geometry.pose import make_pose, so3_exp
from acp_lab.geometry.pose_step import move_pose
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.tracking.learning.knowledge import Off
from acp_lab.tracking.method import ACP, ACP_PAPER, REGION, Method
from acp_lab.tracking.result import TrackState
from acp_lab.tracking.tracker import Tracker
from acp_lab.tracking.turn_check import TurnCheck
from acp_lab.tracking.turned import apart
from tests.made_parts import box, looking_at, wheel
from tests.tracking.rendered import AS_DRAWN, add_percent, draw, prepared

LARGE = Camera(width=320, height=256, fx=520.0, fy=525.0, cx=159.5, cy=127.5)
TEETH = 20
TOOTH = np.deg2rad(360.0 / TEETH)


@pytest.fixture(scope="module")
def keyed() -> PreparedPart:
    part = wheel(TEETH)
    model = prepared(part)
    return replace(model, near_turns=near_turns(part, model.edges))


def turned(pose: FloatArray, angle: float) -> FloatArray:
    """A pose (4, 4) of the wheel after it turned about its axis."""
    return pose @ make_pose(so3_exp(np.array([0.0, 0.0, angle])), np.zeros(3))


def spinning(model: PreparedPart, frames: int, per_frame: float) -> list[FloatArray]:
    """True poses of a wheel that turns by so many teeth per frame, and drifts."""
    first = looking_at(model.part, np.array([0.5, 0.4, 1.0]), 260.0, 0.3)
    drift = np.array([0.0, 0.0, 0.0, 0.4, 0.2, 0.0])
    poses = [turned(first, per_frame * TOOTH * frame) for frame in range(frames)]
    return [move_pose(pose, model.part.box_centre, frame * drift) for frame, pose in enumerate(poses)]


# Not asked in its first frame, a wheel that begins some teeth off has to be put right on the way.
ON_THE_WAY = replace(AS_DRAWN, turns=TurnCheck(start_evidence=1e6))


def follow(model: PreparedPart, method: Method, truth: list[FloatArray], start: FloatArray) -> tuple[list[float], str]:
    """ADD in percent of each frame after the first, and all notes."""
    tracker, errors, notes = Tracker(model, method), list[float](), list[str]()
    tracker.start(Frame(0, draw([(model.part, truth[0])], camera=LARGE), LARGE), start)
    for k, pose in enumerate(truth[1:], 1):
        result = tracker.track(Frame(k, draw([(model.part, pose)], k, LARGE), LARGE))
        assert result.state is TrackState.TRACKING
        errors.append(add_percent(model.part, result.cam_T_obj, pose))
        notes.append(result.note)
    return errors, "; ".join(notes)


def test_a_wheel_that_turns_by_most_of_a_tooth_seems_to_turn_back_but_for_its_keyway(keyed: PreparedPart) -> None:
    truth = spinning(keyed, 8, 0.8)
    errors, notes = follow(keyed, AS_DRAWN, truth, truth[0])
    assert max(errors) < 2.0
    assert "turned" in notes
    without, notes = follow(keyed, replace(AS_DRAWN, turns=Off()), truth, truth[0])
    assert without[-1] > 20.0
    assert "turned" not in notes


@pytest.mark.parametrize("teeth", [1, -3, 10])
def test_a_wheel_that_began_some_teeth_off_is_put_right(keyed: PreparedPart, teeth: int) -> None:
    truth = spinning(keyed, 12, 0.1)
    errors, notes = follow(keyed, ON_THE_WAY, truth, turned(truth[0], teeth * TOOTH))
    assert max(errors[-5:]) < 2.0
    assert "turned" in notes
    without, _ = follow(keyed, replace(AS_DRAWN, turns=Off()), truth, turned(truth[0], teeth * TOOTH))
    assert min(without) > 5.0


@pytest.mark.parametrize("teeth", [1, -3, 10])
def test_a_first_frame_is_asked_at_every_turn(keyed: PreparedPart, teeth: int) -> None:
    (pose,) = spinning(keyed, 1, 0.0)
    frame = Frame(0, draw([(keyed.part, pose)], camera=LARGE), LARGE)
    result = Tracker(keyed, AS_DRAWN).start(frame, turned(pose, teeth * TOOTH))
    assert add_percent(keyed.part, result.cam_T_obj, pose) < 2.0
    assert "turned" in result.note
    tracker = Tracker(keyed, ON_THE_WAY)
    result = tracker.start(frame, turned(pose, teeth * TOOTH))
    assert add_percent(keyed.part, result.cam_T_obj, pose) > 5.0
    assert "turned" not in result.note


def test_a_hand_over_the_keyway_turns_no_first_frame(keyed: PreparedPart) -> None:
    pose, hand = spinning(keyed, 1, 0.0)[0], box((28.0, 36.0, 12.0))
    for k in range(1, 17):
        above = pose @ make_pose(np.eye(3), np.array([45.0 - 4.0 * k, 0.0, 20.0]))
        frame = Frame(0, draw([(keyed.part, pose), (hand, above)], k, LARGE), LARGE)
        result = Tracker(keyed, AS_DRAWN).start(frame, pose)
        assert add_percent(keyed.part, result.cam_T_obj, pose) < 2.0
        assert "turned" not in result.note


def test_a_hand_over_the_keyway_turns_nothing(keyed: PreparedPart) -> None:
    """It makes edges missing that this pose alone shows, but those of another pose are not there either."""
    pose, hand = spinning(keyed, 1, 0.0)[0], box((28.0, 36.0, 12.0))
    tracker = Tracker(keyed, AS_DRAWN)
    tracker.start(Frame(0, draw([(keyed.part, pose)], camera=LARGE), LARGE), pose)
    for k in range(1, 17):
        above = pose @ make_pose(np.eye(3), np.array([45.0 - 4.0 * k, 0.0, 20.0]))
        result = tracker.track(Frame(k, draw([(keyed.part, pose), (hand, above)], k, LARGE), LARGE))
        assert add_percent(keyed.part, result.cam_T_obj, pose) < 2.0
        assert "turned" not in result.note


def test_a_resting_wheel_that_is_put_right_is_not_set_spinning(keyed: PreparedPart) -> None:
    truth = spinning(keyed, 8, 0.0)
    errors, notes = follow(keyed, ON_THE_WAY, truth, turned(truth[0], TOOTH))
    assert max(errors[1:]) < 2.0
    assert notes.count("turned") == 1


def test_a_wheel_that_was_put_right_goes_on_as_it_moves(keyed: PreparedPart) -> None:
    truth = spinning(keyed, 10, 0.7)
    errors, notes = follow(keyed, ON_THE_WAY, truth, turned(truth[0], 3 * TOOTH))
    assert max(errors[3:]) < 2.0
    assert notes.count("turned") <= 3


def test_frames_that_show_nothing_end_a_row_of_suspicion(keyed: PreparedPart) -> None:
    pose = spinning(keyed, 1, 0.0)[0]
    tracker = Tracker(keyed, AS_DRAWN)
    tracker.start(Frame(0, draw([(keyed.part, pose)], camera=LARGE), LARGE), pose)
    checker = tracker._turn_checker
    assert checker is not None
    assert checker._is_sure
    checker._suspected, checker._evidence = 5, 3.0
    tracker.track(UnreadableFrame(1, LARGE, "torn"))
    assert (checker._suspected, checker._evidence, checker._is_sure) == (-1, 0.0, False)


def test_a_wheel_that_is_right_stays_so(keyed: PreparedPart) -> None:
    truth = spinning(keyed, 12, 0.3)
    errors, notes = follow(keyed, AS_DRAWN, truth, truth[0])
    assert max(errors) < 2.0
    assert "turned" not in notes


def test_parts_without_such_turns_are_not_looked_at_again(keyed: PreparedPart) -> None:
    truth = spinning(keyed, 8, 0.8)
    errors, notes = follow(replace(keyed, near_turns=np.zeros((0, 4, 4))), AS_DRAWN, truth, truth[0])
    assert errors[-1] > 20.0
    assert "turned" not in notes


def test_only_the_best_method_asks() -> None:
    assert isinstance(ACP.turns, TurnCheck)
    assert isinstance(ACP_PAPER.turns, Off)
    assert isinstance(REGION.turns, Off)


@pytest.mark.parametrize(
    "values",
    [
        {"motion_from": -2.0},
        {"leap_from": 2.0},
        {"found": -0.1},
        {"evidence": float("nan")},
        {"evidence": -0.1},
        {"may_move": 0.5},
        {"leap_evidence": -1.0},
        {"start_found": -0.1},
        {"start_evidence": -1.0},
    ],
)
def test_nonsense_is_refused(values: dict[str, float]) -> None:
    with pytest.raises(TrackingError, match=r"turns\."):
        TurnCheck(**values)  # type: ignore[arg-type]


def edges(points: FloatArray, angles: FloatArray) -> GeneratedEdges:
    tangents = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return GeneratedEdges(points, tangents, np.ones(len(points)), np.arange(len(points)))


def test_edges_apart_are_those_with_none_of_their_direction_near() -> None:
    """Against distances between all points; at the borders of pixels and directions either answer is right."""
    rng = np.random.default_rng(3)
    points, others = rng.uniform(-10.0, 60.0, (300, 2)), rng.uniform(0.0, 50.0, (80, 2))
    angles, other_angles = rng.uniform(-4.0, 4.0, 300), rng.uniform(-4.0, 4.0, 80)
    found = apart(edges(points, angles), edges(others, other_angles))
    away = np.linalg.norm(points[:, None] - others, axis=2)
    between = np.abs((angles[:, None] - other_angles + 0.5 * np.pi) % np.pi - 0.5 * np.pi)
    step = np.pi / 16
    assert not found[((away < 2.5) & (between < 2.0 * step)).any(1)].any()
    assert found[~((away < 5.5) & (between < 3.0 * step)).any(1)].all()
    assert 20 < np.count_nonzero(found) < 290


def test_without_others_all_edges_are_apart() -> None:
    some, none = edges(np.ones((3, 2)), np.zeros(3)), edges(np.zeros((0, 2)), np.zeros(0))
    assert apart(some, none).all()
    assert apart(none, some).shape == (0,)


def test_a_part_next_to_the_lens_needs_no_more_room() -> None:
    """Some of its points may be projected millions of pixels away."""
    rng = np.random.default_rng(4)
    far = np.array([[6e6, 4e6], [-5e6, 7e6], [20.0, -8e6]])
    points, others = rng.uniform(0.0, 50.0, (100, 2)), rng.uniform(0.0, 50.0, (80, 2))
    angles, other_angles = rng.uniform(-4.0, 4.0, 103), rng.uniform(-4.0, 4.0, 83)
    shown, of_others = edges(points, angles[:100]), edges(others, other_angles[:80])
    near = apart(shown, of_others)
    np.testing.assert_array_equal(apart(shown, edges(np.vstack([others, far]), other_angles)), near)
    beyond = apart(edges(np.vstack([points, far]), angles), of_others)
    np.testing.assert_array_equal(beyond, [*near, True, True, True])
    assert apart(edges(far, angles[:3]), of_others).all()


def test_only_what_the_image_can_show_is_asked(keyed: PreparedPart, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = list[GeneratedEdges]()

    def seen(edges: GeneratedEdges, others: GeneratedEdges) -> BoolArray:
        asked.append(edges)
        return apart(edges, others)

    monkeypatch.setattr("acp_lab.tracking.turned.apart", seen)
    pose = spinning(keyed, 1, 0.0)[0]
    pose[0, 3] += 60.0
    Tracker(keyed, AS_DRAWN).start(Frame(0, draw([(keyed.part, pose)], camera=LARGE), LARGE), pose)
    assert asked
    assert all(in_image(edges.points, LARGE).all() for edges in asked)
    assert max(edges.points[:, 0].max() for edges in asked) > LARGE.width - 10.0
