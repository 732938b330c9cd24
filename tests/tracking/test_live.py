"""The live loop, on the sample served as a camera."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
import pytest

from acp_lab.errors import TrackingError
from acp_lab.evaluation import add_mm
from acp_lab.sequences import open_images
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.tracking.live import LiveLoop
from acp_lab.tracking.result import TrackResult
from tests.key_presses import ends_within, pressed_at
from tests.plugged_camera import PluggedCamera
from tests.prepared_sample import sample_model, sample_scene

LAST = 60.0


class Spectator:
    """Takes down what the loop shows, and ends it after some results."""

    def __init__(self, enough: int = 12) -> None:
        self.shown: list[tuple[int, TrackResult | None]] = []
        self.words: list[str] = []
        self.enough = enough
        self.loop: LiveLoop | None = None

    def show(self, frame: Frame | UnreadableFrame, result: TrackResult | None) -> None:
        self.shown.append((PluggedCamera.shown, result))
        if sum(result is not None for _, result in self.shown) >= self.enough and self.loop is not None:
            self.loop.stop()


@pytest.fixture
def spectator() -> Spectator:
    return Spectator()


@pytest.fixture
def loop(spectator: Spectator, monkeypatch: pytest.MonkeyPatch) -> Iterator[LiveLoop]:
    monkeypatch.setattr("acp_lab.sequences.images.cv2.VideoCapture", PluggedCamera)
    monkeypatch.setattr(PluggedCamera, "fps", 60.0)
    camera = open_images("0", sample_scene().camera(0))
    spectator.loop = made = LiveLoop(sample_model(), camera, spectator.show, spectator.words.append)
    yield made
    made.stop(LAST)


def until(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + LAST
    while not condition():
        assert time.monotonic() < end, "it never came true"
        time.sleep(0.01)


def add_percents(spectator: Spectator) -> list[float]:
    part = sample_model().part
    tracked = [(sample_id, result) for sample_id, result in spectator.shown if result is not None]
    truths = [sample_scene().truth(sample_id, 1) for sample_id, _ in tracked]
    return [
        100.0 * add_mm(part.vertices, result.cam_T_obj, truth) / part.diameter
        for (_, result), truth in zip(tracked, truths, strict=True)
        if truth is not None
    ]


def test_it_finds_the_part_and_follows_it(loop: LiveLoop, spectator: Spectator) -> None:
    loop.look()
    loop.begin()
    assert loop.wait(LAST)
    assert loop.doing == "ended"
    percents = add_percents(spectator)
    assert len(percents) == spectator.enough == len(loop.rows)
    assert max(percents) < 5.0
    assert any(text.startswith("found, score") for text in spectator.words)
    assert [row.im_id for row in loop.rows] == sorted(row.im_id for row in loop.rows)


def test_what_it_finds_is_not_taken_for_exact(loop: LiveLoop, spectator: Spectator) -> None:
    loop.look()
    loop.begin()
    assert loop.wait(LAST)
    assert len(loop.rows) == spectator.enough
    assert not loop._tracker.start_was_trusted


def test_a_hand_stops_the_film_and_starts_it_with_a_pose_of_that_frame(loop: LiveLoop, spectator: Spectator) -> None:
    loop.begin()
    frame = loop.hold()
    assert frame is not None
    assert loop.doing == "waiting"
    stood_at, count = PluggedCamera.shown, len(spectator.shown)
    truth = sample_scene().truth(stood_at, 1)
    assert truth is not None
    assert PluggedCamera.shown == stood_at, "no frame is read meanwhile"
    assert len(spectator.shown) == count
    loop.follow(truth)
    assert loop.wait(LAST)
    assert loop.rows[0].im_id == frame.index
    assert max(add_percents(spectator)) < 5.0


def test_a_pose_that_shows_nothing_is_told_and_it_goes_on_watching(loop: LiveLoop, spectator: Spectator) -> None:
    away = np.eye(4)
    away[:3, 3] = (0.0, 0.0, -500.0)
    loop.follow(away)
    loop.begin()
    until(lambda: bool(spectator.words))
    assert "not seen" in spectator.words[0]
    assert loop.hold() is not None, "it goes on"
    assert loop.rows == []


def test_a_new_start_that_shows_nothing_keeps_what_was_tracked(loop: LiveLoop, spectator: Spectator) -> None:
    truth = sample_scene().truth(0, 1)
    assert truth is not None
    frame = sample_scene().frame(0)
    loop.doing, loop._start = "following", (truth, False)
    assert loop._result(frame) is not None
    loop.follow(np.diag([1.0, -1.0, -1.0, 1.0]) @ truth)  # behind the camera
    assert loop._result(frame) is None
    assert "not seen" in spectator.words[-1]
    assert [row.im_id for row in loop.rows] == [0]


def test_an_error_in_the_program_is_told(loop: LiveLoop, spectator: Spectator, monkeypatch: pytest.MonkeyPatch) -> None:
    def trip(*_: object) -> None:
        raise IndexError("no such frame")

    raised: list[type[BaseException]] = []
    monkeypatch.setattr(threading, "excepthook", lambda told: raised.append(told.exc_type))
    monkeypatch.setattr(loop, "_show", trip)
    loop.begin()
    assert loop.wait(LAST)
    assert loop.doing == "ended"
    assert spectator.words == ["ended by an error in the program: IndexError('no such frame')"]
    assert raised == [IndexError]


def test_there_is_nothing_to_wait_for_before_it_begins(loop: LiveLoop) -> None:
    with pytest.raises(TrackingError, match="before begin"):
        loop.wait()


def test_a_button_outranks_what_was_found_at_that_moment(loop: LiveLoop, spectator: Spectator) -> None:
    class Found:
        """A hypothesis that is looked at just when the hand presses "only show"."""

        cam_T_obj, score = np.eye(4), 1.0

        @property
        def is_accepted(self) -> bool:
            loop.watch()
            return True

    loop._finder.find = lambda frame, top: [Found()]  # type: ignore[method-assign, assignment, list-item]
    loop.look()
    loop.begin()
    until(lambda: len(spectator.shown) > 3)
    assert loop.doing == "watching"
    assert loop.rows == []
    assert not any(text.startswith("found") for text in spectator.words)


def test_a_start_that_fails_does_not_take_back_what_was_pressed_meanwhile(
    loop: LiveLoop, spectator: Spectator, monkeypatch: pytest.MonkeyPatch
) -> None:
    truth = sample_scene().truth(0, 1)
    assert truth is not None
    start = loop._tracker.start

    def start_and_press(frame: Frame, cam_T_obj: np.ndarray, found: bool) -> TrackResult:
        monkeypatch.setattr(loop._tracker, "start", start)
        loop.follow(truth)  # a better pose comes while this one is tried
        return start(frame, cam_T_obj)

    monkeypatch.setattr(loop._tracker, "start", start_and_press)
    away = np.eye(4)
    away[:3, 3] = (0.0, 0.0, -500.0)
    loop.follow(away)
    loop.begin()
    assert loop.wait(LAST)
    assert spectator.words == []
    assert len(loop.rows) == spectator.enough


def test_a_stop_that_waited_in_vain_leaves_alone_what_was_pressed_meanwhile(
    spectator: Spectator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("acp_lab.sequences.images.cv2.VideoCapture", PluggedCamera)
    camera = open_images("0", sample_scene().camera(0))
    loop = LiveLoop(sample_model(), camera, spectator.show, spectator.words.append)  # no frame comes: never begun
    presses = threading.Timer(0.1, loop.look)
    presses.start()
    assert loop.hold(0.4) is None
    assert loop.doing == "looking"


def test_a_camera_that_is_not_there_is_told(spectator: Spectator, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(PluggedCamera, "isOpened", lambda self: False)
    monkeypatch.setattr("acp_lab.sequences.images.cv2.VideoCapture", PluggedCamera)
    camera = open_images("3", sample_scene().camera(0))
    loop = LiveLoop(sample_model(), camera, spectator.show, spectator.words.append)
    loop.begin()
    assert loop.wait(LAST)
    assert spectator.words == ["camera 3: cannot be opened: check its number, its cable and who else uses it"]
    assert loop.hold(0.1) is None
    assert loop.doing == "ended"


def test_an_interrupt_at_any_moment_leaves_the_loop_running(spectator: Spectator) -> None:
    """A kernel's interrupt while a button is at work: what the loop's thread asks for next still comes back."""
    for press in (LiveLoop.look, LiveLoop.watch, LiveLoop.stop, lambda loop: loop.follow(np.eye(4))):
        number = 0
        is_pressed = True
        while is_pressed:
            loop = LiveLoop(sample_model(), sample_scene(), spectator.show, spectator.words.append)
            loop.doing = "waiting"
            is_pressed = pressed_at(number, partial(press, loop))
            loop._is_over = True
            assert ends_within(LAST, partial(loop._stand_at, sample_scene().frame(0))), f"after moment {number}"
            number += 1
        assert number > 1
