"""Folders of images, videos and live cameras: order, colours, distortion, damage."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from acp_lab.errors import InputFileError, SequenceError
from acp_lab.geometry.camera import Camera, Undistorter
from acp_lab.sequences import (
    CameraDevice,
    Frame,
    ImageFolder,
    Sequence,
    UnreadableFrame,
    VideoFile,
    open_images,
)
from acp_lab.sequences.images import first_size
from tests.sequences.timed_video import coded_video, timed_video
from tests.sequences.tiny_dataset import HEIGHT, WIDTH, write_image

CAMERA = Camera(WIDTH, HEIGHT, 80.0, 81.0, 31.5, 23.5)
BENT = Camera(WIDTH, HEIGHT, 80.0, 81.0, 31.5, 23.5, (-0.3, 0.1, 0.0, 0.0, 0.0))


def _folder(path: Path, names: tuple[str, ...]) -> Path:
    path.mkdir()
    for i, name in enumerate(names):
        write_image(path / name, 10 * i)
    return path


def _video(path: Path, count: int = 10) -> Path:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 25.0, (WIDTH, HEIGHT))
    assert writer.isOpened()
    for i in range(count):
        image = np.full((HEIGHT, WIDTH, 3), 20 * i, np.uint8)
        image[:, : WIDTH // 2] = (0, 0, 220)  # red, as BGR
        writer.write(image)
    writer.release()
    return path


def test_a_folder_is_read_in_natural_order_and_numbered_from_0(tmp_path: Path) -> None:
    names = ("img2.png", "img10.png", "IMG11.png", "img100.png")
    folder = _folder(tmp_path / "clip", names)
    (folder / "notes.txt").write_text("no image")
    images = ImageFolder(folder, CAMERA)
    assert [path.name for path in images.image_paths] == list(names)
    assert (images.name, images.scene_id, images.object_ids) == ("clip", 1, (1,))
    assert images.frame_ids == (0, 1, 2, 3)
    frames = list(images.frames())
    assert [frame.index for frame in frames] == [0, 1, 2, 3]
    for i, frame in enumerate(frames):
        assert isinstance(frame, Frame)
        assert frame.image[0, 0].tolist() == [200, 0, 0]
        assert frame.image[0, -1, 0] == 10 * i
    assert len(list(images.frames(2))) == 2


def test_hidden_files_of_a_folder_are_no_frames(tmp_path: Path) -> None:
    folder = _folder(tmp_path / "clip", ("1.png", "2.png"))
    (folder / "._1.png").write_bytes(b"what macOS notes of a file")
    write_image(folder / ".0.png", width=40)
    assert [path.name for path in ImageFolder(folder, CAMERA).image_paths] == ["1.png", "2.png"]
    assert first_size(folder) == (WIDTH, HEIGHT)
    for path in folder.glob("[12].png"):
        path.unlink()
    for call in (lambda: ImageFolder(folder, CAMERA), lambda: first_size(folder)):
        with pytest.raises(SequenceError, match="holds no images"):
            call()


def test_frames_are_undistorted_once_and_carry_the_pinhole_camera(tmp_path: Path) -> None:
    folder = _folder(tmp_path / "clip", ("0.png", "1.png"))
    texture = np.random.default_rng(0).integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    for path in folder.iterdir():
        cv2.imwrite(str(path), texture)
    straight = list(ImageFolder(folder, CAMERA).frames())
    bent = list(ImageFolder(folder, BENT).frames())
    for plain, corrected in zip(straight, bent, strict=True):
        assert isinstance(plain, Frame)
        assert isinstance(corrected, Frame)
        assert corrected.camera == BENT.pinhole()
        np.testing.assert_array_equal(corrected.image, Undistorter(BENT)(plain.image))
        assert (corrected.image != plain.image).any()
        assert corrected.undistort_s > 0.0


def test_a_damaged_or_misfitting_image_in_the_middle_is_yielded(tmp_path: Path) -> None:
    folder = _folder(tmp_path / "clip", ("0.png", "1.png", "2.png", "3.png"))
    (folder / "1.png").write_bytes(b"")
    write_image(folder / "2.png", width=40)
    frames = list(ImageFolder(folder, BENT).frames())
    assert [type(frame) for frame in frames] == [Frame, UnreadableFrame, UnreadableFrame, Frame]
    assert isinstance(frames[1], UnreadableFrame)
    assert isinstance(frames[2], UnreadableFrame)
    assert frames[1].camera == BENT.pinhole()
    assert "1.png: the file is empty" in frames[1].reason
    assert "2.png: image is 40 x 48 px but the camera is 64 x 48" in frames[2].reason


def test_a_camera_of_another_size_is_refused(tmp_path: Path) -> None:
    other = Camera(32, 24, 40.0, 40.0, 15.5, 11.5)
    folder = _folder(tmp_path / "clip", ("0.png",))
    with pytest.raises(InputFileError, match="64 x 48 px but the camera is 32 x 24: give the camera"):
        ImageFolder(folder, other)
    with pytest.raises(InputFileError, match=r"clip\.mp4: image is 64 x 48 px but the camera is 32 x 24"):
        VideoFile(_video(tmp_path / "clip.mp4"), other)


def test_folders_without_images(tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match="no such folder"):
        ImageFolder(tmp_path / "none", CAMERA)
    with pytest.raises(SequenceError, match="holds no images"):
        ImageFolder(tmp_path, CAMERA)
    (tmp_path / "0.png").write_bytes(b"junk")
    with pytest.raises(InputFileError, match=r"0\.png"):
        ImageFolder(tmp_path, CAMERA)


def test_a_video_yields_rgb_frames_with_times(tmp_path: Path) -> None:
    video = VideoFile(_video(tmp_path / "clip.mp4"), CAMERA)
    assert video.frame_ids == tuple(range(10))
    for _ in range(2):  # each call starts anew
        frames = list(video.frames())
        assert [frame.index for frame in frames] == list(range(10))
        for i, frame in enumerate(frames):
            assert isinstance(frame, Frame)
            assert frame.time_s == pytest.approx(i / 25.0, abs=1e-3)
            red, green, blue = frame.image[HEIGHT // 2, 4].astype(int)
            assert red > 180 > 60 > max(green, blue)
            assert abs(int(frame.image[HEIGHT // 2, -4, 1]) - 20 * i) < 12
    assert [frame.index for frame in video.frames(3)] == [0, 1, 2]


@pytest.mark.parametrize("name", ["clip.mkv", "clip.mp4"])
def test_a_video_that_ends_early_says_so(name: str, tmp_path: Path) -> None:
    path = timed_video(tmp_path / name, [round(i * 1000 / 30) for i in range(40)])
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    video = VideoFile(path, CAMERA)
    *before, last = video.frames()
    assert 8 < len(before) < 36
    assert isinstance(last, UnreadableFrame)
    assert f"ends after {len(before)} of the 40 frames" in last.reason
    assert video.frame_ids == tuple(range(len(before) + 1)), "the one that says so, too"


@pytest.mark.parametrize(
    "times_ms",
    [
        [0, 33, 67, 133, 167, 233, 267, 300, 367, 400, 467, 500],  # OpenCV announces 16
        [16 * i for i in range(12)],  # 6
        [33 * i + 300 * (i > 6) for i in range(12)],
        [33 * i + 5000 for i in range(12)],  # 162
    ],
)
def test_a_video_whose_frames_come_at_uneven_times_is_whole(times_ms: list[int], tmp_path: Path) -> None:
    video = VideoFile(timed_video(tmp_path / "clip.mkv", times_ms), CAMERA)
    frames = list(video.frames())
    assert all(isinstance(frame, Frame) for frame in frames)
    assert video.frame_ids == tuple(frame.index for frame in frames) == tuple(range(12))


@pytest.mark.parametrize("codec", ["mjpeg", "libx264"])
def test_a_damaged_frame_does_not_end_a_video(codec: str, tmp_path: Path) -> None:
    path, places = coded_video(tmp_path / ("clip.avi" if codec == "mjpeg" else "clip.mp4"), codec, 20)
    data = bytearray(path.read_bytes())
    at, size = places[7]
    data[at : at + size] = bytes(size)
    path.write_bytes(data)
    video = VideoFile(path, CAMERA)
    frames = list(video.frames())
    assert video.frame_ids == tuple(frame.index for frame in frames) == tuple(range(20))
    (damaged,) = (frame for frame in frames if isinstance(frame, UnreadableFrame))
    assert damaged.reason == f"{path}: frame {damaged.index} is damaged"
    if codec == "mjpeg":  # where frames lean on others, those around it may go first
        assert damaged.index == 7
        assert [frame.time_s for frame in frames if isinstance(frame, Frame)] == pytest.approx(
            [i / 30 for i in range(20) if i != 7], abs=1e-3
        )


def test_damage_up_to_the_end_of_a_video_is_one_early_end(tmp_path: Path) -> None:
    path, places = coded_video(tmp_path / "clip.avi", "mjpeg", 20)
    data = bytearray(path.read_bytes())
    for at, size in places[13:]:
        data[at : at + size] = bytes(size)
    path.write_bytes(data)
    *before, last = VideoFile(path, CAMERA).frames()
    assert [frame.index for frame in before if isinstance(frame, Frame)] == list(range(13))
    assert len(before) == 13
    assert isinstance(last, UnreadableFrame)
    assert "ends after 13 of the 20 frames" in last.reason


@pytest.mark.parametrize(
    ("content", "said"), [(b"", "is empty"), (b"this is no video", "cannot be decoded as a video")]
)
def test_files_that_are_no_video(tmp_path: Path, content: bytes, said: str, capfd: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "clip.mp4"
    path.write_bytes(content)
    with pytest.raises(InputFileError, match=rf"clip\.mp4: {said}"):
        VideoFile(path, CAMERA)
    with pytest.raises(InputFileError, match="no such video file"):
        VideoFile(tmp_path / "none.mp4", CAMERA)
    assert capfd.readouterr().err == ""


def test_open_images_takes_a_folder_a_file_or_the_number_of_a_camera(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert isinstance(open_images(_folder(tmp_path / "clip", ("0.png",)), CAMERA), ImageFolder)
    assert isinstance(open_images(_video(tmp_path / "clip.mp4"), CAMERA), VideoFile)
    monkeypatch.chdir(tmp_path)
    device = open_images("7", CAMERA)
    assert isinstance(device, CameraDevice)
    assert device.index == 7
    for call in (lambda: open_images("99999999999", CAMERA), lambda: first_size("99999999999")):
        with pytest.raises(SequenceError, match="camera 99999999999: there are none of that number"):
            call()
    _folder(tmp_path / "7", ("0.png",))
    assert isinstance(open_images("7", CAMERA), ImageFolder)


@pytest.mark.parametrize("number", [3, np.int64(3), np.uint8(3)])
def test_the_number_of_a_camera_may_be_of_numpy(number: Any) -> None:
    device = open_images(number, CAMERA)
    assert isinstance(device, CameraDevice)
    assert (type(device.index), device.index, device.name) == (int, 3, "camera 3")


@pytest.mark.parametrize("number", [-1, 2**40, True, np.int64(-1)])
def test_a_number_that_no_camera_has_is_refused_before_it_is_opened(number: Any) -> None:
    for call in (open_images, CameraDevice):
        with pytest.raises(SequenceError, match=f"camera {number}: there are none of that number"):
            call(number, CAMERA)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes among the files of this system")
def test_a_pipe_is_no_video(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "clip.mp4")
    for call in (lambda: VideoFile(tmp_path / "clip.mp4", CAMERA), lambda: first_size(tmp_path / "clip.mp4")):
        with pytest.raises(InputFileError, match=r"clip\.mp4: is a pipe, a device or a socket"):
            call()


def test_the_first_size_is_told_before_there_is_a_camera(
    tmp_path: Path, plug_in: Callable[[_FakeDevice], _FakeDevice]
) -> None:
    assert first_size(_folder(tmp_path / "clip", ("2.png", "10.png"))) == (WIDTH, HEIGHT)
    assert first_size(_video(tmp_path / "clip.mp4")) == (WIDTH, HEIGHT)
    (tmp_path / "empty").mkdir()
    with pytest.raises(SequenceError, match="holds no images"):
        first_size(tmp_path / "empty")
    with pytest.raises(InputFileError, match="no such video file"):
        first_size(tmp_path / "none.mp4")
    (tmp_path / "junk.mp4").write_bytes(b"junk")
    with pytest.raises(InputFileError, match="gives no image: convert it"):
        first_size(tmp_path / "junk.mp4")
    device = plug_in(_FakeDevice([np.zeros((10, 20, 3), np.uint8)]))
    assert first_size("5") == (20, 10)
    assert device.released


@pytest.mark.parametrize("kind", ["folder", "video", "device"])
def test_there_is_no_truth(tmp_path: Path, kind: str) -> None:
    source: Sequence
    if kind == "folder":
        source = ImageFolder(_folder(tmp_path / "clip", ("0.png",)), CAMERA)
    elif kind == "video":
        source = VideoFile(_video(tmp_path / "clip.mp4", 1), CAMERA)
    else:
        source = CameraDevice(0, CAMERA)
    assert source.truth(0, 1) is None
    with pytest.raises(SequenceError, match="give a start pose"):
        _ = source.first_pose
    with pytest.raises(SequenceError, match="give a start pose"):
        _ = source.first_poses


class _FakeDevice:
    """Stands in for cv2.VideoCapture: gives the listed images, None for a failure, then fails for good."""

    def __init__(self, images: list[np.ndarray | None], opened: bool = True) -> None:
        self.images = iter(images)
        self.opened = opened
        self.released = False

    def isOpened(self) -> bool:
        return self.opened

    def set(self, key: int, value: float) -> bool:
        return True

    def get(self, key: int) -> float:
        return 0.0

    def read(self) -> tuple[bool, Any]:
        image = next(self.images, None)
        return image is not None, image

    def release(self) -> None:
        self.released = True


@pytest.fixture
def plug_in(monkeypatch: pytest.MonkeyPatch) -> Callable[[_FakeDevice], _FakeDevice]:
    def plug(device: _FakeDevice) -> _FakeDevice:
        monkeypatch.setattr("acp_lab.sequences.images.cv2.VideoCapture", lambda *_: device)
        return device

    return plug


def test_a_live_camera_yields_until_it_is_left(plug_in: Callable[[_FakeDevice], _FakeDevice]) -> None:
    image = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    image[..., 2] = 9
    device = plug_in(_FakeDevice([image, None, image, image]))
    frames = list(CameraDevice(0, BENT).frames(3))
    assert [type(frame) for frame in frames] == [Frame, UnreadableFrame, Frame]
    assert [frame.index for frame in frames] == [0, 1, 2]
    assert isinstance(frames[2], Frame)
    assert frames[2].time_s is not None
    assert frames[2].camera == BENT.pinhole()
    assert frames[2].image[HEIGHT // 2, WIDTH // 2].tolist() == [9, 0, 0]
    assert device.released


def test_a_live_camera_that_stops_is_an_error(plug_in: Callable[[_FakeDevice], _FakeDevice]) -> None:
    device = plug_in(_FakeDevice([np.zeros((HEIGHT, WIDTH, 3), np.uint8)]))
    with pytest.raises(SequenceError, match="camera 2: stopped giving images"):
        list(CameraDevice(2, CAMERA).frames())
    assert device.released


def test_a_live_camera_that_is_absent_or_of_another_size(
    plug_in: Callable[[_FakeDevice], _FakeDevice],
) -> None:
    plug_in(_FakeDevice([], opened=False))
    with pytest.raises(SequenceError, match="camera 7: cannot be opened"):
        next(CameraDevice(7, CAMERA).frames())
    plug_in(_FakeDevice([np.zeros((10, 10, 3), np.uint8)]))
    with pytest.raises(SequenceError, match="image is 10 x 10 px but the camera is 64 x 48"):
        next(CameraDevice(7, CAMERA).frames())


def test_a_video_of_huge_frames_is_not_decoded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = _video(tmp_path / "clip.mp4")
    monkeypatch.setattr("acp_lab.sequences.images.LARGEST_PIXELS", WIDTH * HEIGHT - 1)
    for read in (lambda: VideoFile(path, CAMERA), lambda: first_size(path)):
        with pytest.raises(InputFileError, match=rf"clip.mp4: has frames of {WIDTH} x {HEIGHT} px"):
            read()


def test_a_picture_on_its_side_is_told_of_notes_that_are_not_obeyed(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "0.png"), np.zeros((WIDTH, HEIGHT, 3), np.uint8))
    with pytest.raises(InputFileError, match=r"give the camera of these images; notes .* \(EXIF\) are not obeyed"):
        ImageFolder(tmp_path, CAMERA)
    cv2.imwrite(str(tmp_path / "0.png"), np.zeros((WIDTH, HEIGHT + 1, 3), np.uint8))
    with pytest.raises(InputFileError, match=r"give the camera of these images$"):
        ImageFolder(tmp_path, CAMERA)
