"""The live window, driven from Python, with the sample served as a camera."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

import acp_lab as acp
from acp_lab.display.widgets.live_window import LiveWindow
from acp_lab.errors import InputFileError
from acp_lab.sequences import read_results
from acp_lab.tracking.find import Detection
from tests.display.open_widgets import open_widgets
from tests.plugged_camera import PluggedCamera
from tests.prepared_sample import sample_model, sample_scene


@pytest.fixture
def plugged(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("acp_lab.sequences.images.cv2.VideoCapture", PluggedCamera)
    monkeypatch.setattr(PluggedCamera, "fps", 30.0)


@pytest.fixture
def window(plugged: None) -> Iterator[LiveWindow]:
    made = acp.live(sample_model(), sample_scene().camera(0))
    yield made
    made.loop.stop()


def until(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + 30.0
    while not condition():
        assert time.monotonic() < end, "it never came true"
        time.sleep(0.02)


def test_by_hand_from_watching_to_a_results_file(
    window: LiveWindow, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    until(lambda: len(window.canvas.image) > 0)
    until(lambda: "frames per second" in window.canvas.status)
    assert "no pose yet" in window.canvas.status
    window.align()
    assert window.aligner is not None
    assert window.loop.doing == "waiting"
    truth = sample_scene().truth(PluggedCamera.shown, 1)
    assert truth is not None
    window.aligner.cam_T_obj = truth
    window.follow_aligned()
    assert window.aligner is None
    until(lambda: len(window.loop.rows) > 25)
    until(lambda: "tracking, quality" in window.canvas.status)
    assert len(window.canvas.overlays) > 0
    assert window.canvas.points.shape == (4, 2)
    assert len(window.quality.curves) == 1
    window.stop()
    assert window.loop.doing == "ended"
    window.path.value = str(tmp_path / "results.csv")
    window._save_as_told()
    assert f"{len(window.loop.rows)} poses are in" in window.message.value
    rows = read_results(tmp_path / "results.csv")
    assert len(rows) == len(window.loop.rows)
    np.testing.assert_allclose(rows[0].cam_T_obj, window.loop.rows[0].cam_T_obj)
    with pytest.raises(InputFileError):
        window.save(tmp_path / "results.csv" / "further.csv")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setenv("USERPROFILE", str(tmp_path / "home"))
    for typed, place in ((" again.csv ", "again.csv"), ("~/results.csv", "home/results.csv")):
        window.path.value = typed
        window._save_as_told()
        assert str(tmp_path / place) in window.message.value
        assert (tmp_path / place).is_file()
    window.path.value = " "
    window._save_as_told()
    assert "no file can have that name" in window.message.value
    window.path.value = str(tmp_path / "results.csv" / "<img src=x>.csv")
    window._save_as_told()
    assert "&lt;img src=x&gt;" in window.message.value
    assert "<img" not in window.message.value


def test_cancelling_goes_on_without_a_pose(window: LiveWindow) -> None:
    window.align()
    window._cancel()
    assert window.aligner is None
    assert window.loop.doing == "watching"
    assert window.loop.rows == []


def test_a_cell_that_is_run_again_leaves_no_camera_on(window: LiveWindow) -> None:
    until(lambda: len(window.canvas.image) > 0)
    again = acp.live(sample_model(), sample_scene().camera(0))
    try:
        assert window.loop.doing == "ended"
        assert "stopped" in window.message.value
        other = acp.live(sample_model(), sample_scene().camera(0), source=1)
        assert again.loop.doing == "watching", "another camera is another window"
        other.close()
        assert other.loop.doing == "ended"
    finally:
        again.loop.stop()


def test_a_pose_of_the_detector_is_followed_as_one_that_was_found(
    window: LiveWindow, monkeypatch: pytest.MonkeyPatch
) -> None:
    followed = []
    monkeypatch.setattr(window.loop, "follow", lambda pose, found: followed.append(found))
    until(lambda: len(window.canvas.image) > 0)
    for turn_deg in (0.0, 5.0):
        window.align()
        assert window.aligner is not None
        window.aligner._take_found(Detection(sample_scene().first_pose, 0.9, np.array([0.0, 0.0, 1.0])))
        if turn_deg:
            window.aligner.turn((0.0, 0.0, turn_deg))
        window.follow_aligned()
    assert followed == [True, False], "the second one was turned by hand"


def test_an_aligner_that_is_left_leaves_nothing_behind(window: LiveWindow) -> None:
    """Kernel and page keep every widget until it is closed."""
    until(lambda: len(window.canvas.image) > 0)
    before = open_widgets()
    for leave in (window._cancel, window.follow_aligned, window.stop):
        window.align()
        assert window.aligner is not None
        assert len(open_widgets() - before) > 50
        leave()
        assert open_widgets() == before


def test_a_film_in_a_file_is_shown_in_its_own_time(tmp_path: Path) -> None:
    """To rehearse: 12 frames at 30 per second do not take less than 0.3 s."""
    import cv2

    scene = sample_scene()
    camera = scene.camera(0)
    writer = cv2.VideoWriter(
        str(tmp_path / "clip.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 30.0, (camera.width, camera.height)
    )
    for number in range(12):
        writer.write(cv2.cvtColor(scene.frame(number).image, cv2.COLOR_RGB2BGR))
    writer.release()
    camera.to_json(tmp_path / "CAMERA.json")
    begin = time.monotonic()
    window = acp.live(sample_model(), tmp_path / "CAMERA.json", tmp_path / "clip.mp4", start=scene.first_pose)
    assert window.loop.wait(30.0)
    assert time.monotonic() - begin > 0.3
    assert len(window.loop.rows) == 12
    assert window.loop.rows[-1].score > 0.3
    told = "ended; 12 frames were tracked: run the cell again to begin anew"
    assert window.message.value == told
    for ask in (window.find, window.align):
        window.message.value = ""
        ask()
        assert window.message.value == told
    assert window.aligner is None
