"""When images were taken: names that say so, and the clock of a camera."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from acp_lab.geometry.camera import Camera
from acp_lab.sequences.frame import Frame
from acp_lab.sequences.image_times import CameraClock, times_of
from acp_lab.sequences.images import ImageFolder

NANOSECONDS = ("1403636579763555584.png", "1403636579813555456.png", "1403636579963555584.png")


def named(*names: str) -> tuple[float, ...] | None:
    return times_of([Path("somewhere") / name for name in names])


@pytest.mark.parametrize(
    "names",
    [
        NANOSECONDS,
        ("1403636579763555.jpg", "1403636579813555.jpg", "1403636579963555.jpg"),
        ("1403636579763.png", "1403636579813.png", "1403636579963.png"),
        ("1403636579.763555.png", "1403636579.813555.png", "1403636579.963555.png"),
    ],
)
def test_names_that_are_times(names: tuple[str, ...]) -> None:
    assert named(*names) == pytest.approx((0.0, 0.05, 0.2), abs=1e-6)


def test_nanoseconds_are_kept() -> None:
    assert named("1403636579000000001.png", "1403636579000000003.png") == (0.0, 2e-9)


@pytest.mark.parametrize(
    "names",
    [
        ("0.png", "1.png"),
        ("frame_000001.png", "frame_000002.png"),
        ("1403636579763.png", "cover.png"),
        ("1403636579763.png", "1403636579763.jpg"),  # the same time twice
        ("1403636579813.png", "1403636579763.png"),
        ("0000000001.png", "0000000002.png"),
        ("14036365797.png", "14036365798.png"),
        ("20240131123045123.png", "20240131123045156.png"),  # a date
        ("0000000000001.png", "0000000000002.png"),
        ("1402856732_0001.png", "1402856732_0002.png"),  # the number of a camera, and of its picture
    ],
)
def test_names_that_are_none(names: tuple[str, ...]) -> None:
    assert named(*names) is None


def test_a_folder_of_such_names_gives_frames_with_times(tmp_path: Path) -> None:
    for name in reversed(NANOSECONDS):
        cv2.imwrite(str(tmp_path / name), np.zeros((8, 8, 3), np.uint8))
    frames = list(ImageFolder(tmp_path, Camera(8, 8, 9.0, 9.0, 3.5, 3.5)).frames())
    assert [frame.index for frame in frames] == [0, 1, 2]
    assert [frame.time_s for frame in frames if isinstance(frame, Frame)] == pytest.approx([0.0, 0.05, 0.2], abs=1e-6)


class _Stamped:
    """Stands in for cv2.VideoCapture: what its driver's clock says of one image after the other, ms."""

    def __init__(self, *stamps_ms: float) -> None:
        self._stamps_ms: Iterator[float] = iter(stamps_ms)

    def get(self, key: int) -> float:
        return next(self._stamps_ms) if key == cv2.CAP_PROP_POS_MSEC else 0.0


def taken_s(*stamps_ms: float) -> list[float]:
    device, clock = _Stamped(*stamps_ms), CameraClock()
    return [clock.taken_s(device) for _ in stamps_ms]  # type: ignore[arg-type]


@pytest.mark.parametrize("begin_ms", [0.0, 40.0, 9.2e9])
def test_a_camera_with_a_clock_says_when_images_were_taken(begin_ms: float) -> None:
    """However late they are read: here all at once."""
    times_s = np.array(taken_s(*(begin_ms + np.array([0.0, 40.0, 80.0, 160.0]))))
    assert 0.0 <= times_s[0] < 0.03
    assert 0.0 <= times_s[1] - times_s[0] < 0.03, "the clock's start is not known before"
    np.testing.assert_allclose(np.diff(times_s)[1:], [0.04, 0.08], rtol=1e-3)


def test_a_clock_that_is_set_goes_on_from_there() -> None:
    times_s = np.array(taken_s(5e6, 5e6 + 20.0, 5e6 + 40.0, 100.0, 120.0, 140.0))
    assert (np.diff(times_s) > -0.05).all()
    assert times_s.max() < 0.1
    np.testing.assert_allclose(times_s[-1] - times_s[-2], 0.02, rtol=1e-3)


@pytest.mark.parametrize("stamp_ms", [0.0, -1.0, float("nan"), 7.0])
def test_without_a_clock_it_is_when_they_arrive(stamp_ms: float, monkeypatch: pytest.MonkeyPatch) -> None:
    arrivals_s = iter((100.0, 100.1, 100.2, 100.3))
    monkeypatch.setattr(time, "perf_counter", lambda: next(arrivals_s))
    assert taken_s(*[stamp_ms] * 3) == pytest.approx([0.1, 0.2, 0.3])
