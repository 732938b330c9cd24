"""The clock of a replay: time never runs backwards."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.display.replay.clock import GUESSED_FPS, LARGEST_S, RunningClock
from acp_lab.sequences.frame import Frame, UnreadableFrame
from tests.display.made_run import CAMERA

FPS = 120.0


def times_of(clock: RunningClock, readable: str) -> list[float]:
    """When frames at 120 per second begin; "x" is one that cannot be read."""
    times = []
    for number, kind in enumerate(readable):
        image = np.zeros((CAMERA.height, CAMERA.width, 3), np.uint8)
        frame = UnreadableFrame(number, CAMERA, "torn") if kind == "x" else Frame(number, image, CAMERA, number / FPS)
        clock.begin(frame)
        times.append(clock.begin(frame).time_s)  # asked twice, as a recorder does
        clock.end(0)
    return times


def test_frames_that_cannot_be_read_keep_the_pace_of_the_others() -> None:
    np.testing.assert_allclose(times_of(RunningClock(), "ooxxooxxxo"), np.arange(10) / FPS)


@pytest.mark.parametrize("readable", ["oxxooooo", "xxoooo"])
def test_time_never_runs_backwards(readable: str) -> None:
    """Where no step is known yet, the guess may be too long."""
    clock = RunningClock()
    for _ in range(2):
        assert (np.diff(times_of(clock, readable)) >= 0.0).all()
        clock.new_scene()


@pytest.mark.parametrize("unusable", [float("nan"), float("inf"), 1.7e12, -1e300, pytest.param(10**400, id="huge")])
def test_times_that_no_timeline_can_show_are_unknown(unusable: float) -> None:
    """Of some frames, or of all; milliseconds since 1970 among them."""
    image = np.zeros((CAMERA.height, CAMERA.width, 3), np.uint8)
    for known in ([0.0, 0.1, unusable, 0.3, unusable], [unusable] * 5):
        clock, times = RunningClock(), []
        for number, time_s in enumerate(known):
            times.append(clock.begin(Frame(number, image, CAMERA, time_s)).time_s)
            clock.end(0)
        step = 0.1 if known[0] == 0.0 else 1.0 / GUESSED_FPS
        np.testing.assert_allclose(times, step * np.arange(5))


def test_the_last_moment_of_a_timeline_is_not_passed() -> None:
    """Seconds since 1970 in one scene after the other."""
    image = np.zeros((CAMERA.height, CAMERA.width, 3), np.uint8)
    clock, times = RunningClock(), []
    for number in range(8):
        clock.new_scene()
        times.append(clock.begin(Frame(number, image, CAMERA, 1.7e9)).time_s)
        clock.end(0)
    assert max(times) <= LARGEST_S < 2.0**63 * 1e-9
    assert sorted(times) == times


def test_a_scene_begins_after_the_last_one_and_guesses_anew() -> None:
    clock = RunningClock()
    first = times_of(clock, "ooo")
    clock.new_scene()
    second = times_of(clock, "xx")
    assert second[0] > first[-1]
    assert second[1] - second[0] == pytest.approx(1.0 / GUESSED_FPS)
