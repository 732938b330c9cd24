"""Your own pictures as sequences: a folder of images, a video file, a live camera.

Convention: scene 1, object 1, image ids from 0. All images share one `Camera` (CAMERA.json), whose lens
distortion is removed here, once: the frames carry the pinhole camera. A camera of another image size is
refused. There is no truth in these sequences, so the start pose comes from elsewhere (POSE.json).
"""

from __future__ import annotations

import math
import os
import re
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sized
from contextlib import contextmanager
from operator import index as as_index
from pathlib import Path
from typing import SupportsIndex, TypeVar

import cv2
import numpy as np

from acp_lab.errors import InputFileError, SequenceError, check_kind
from acp_lab.geometry.arrays import ByteImage, FloatArray
from acp_lab.geometry.camera import Camera, Undistorter
from acp_lab.input_file import check_regular
from acp_lab.sequences.frame import Frame, UnreadableFrame, check_image
from acp_lab.sequences.image_file import IMAGE_SUFFIXES, LARGEST_PIXELS, quiet_cv2, read_first, read_rgb
from acp_lab.sequences.image_times import CameraClock, times_of
from acp_lab.sequences.pixel_coding import PixelCoding
from acp_lab.sequences.protocol import at_most

# FFmpeg inside OpenCV prints to stderr on its own; it reads this once, at its first use in the process.
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")

_FAILURES_IN_A_ROW = 30
"""Live images that may fail, one second's worth, before a camera is taken for unplugged."""
_DAMAGED_IN_A_ROW = 300
"""Frames of a video that may be damaged one after another, before it is taken for ended."""
_LARGEST_DEVICE = 2**31 - 1
_UNCOUNTED = 2
"""Frames by which the headers of sound videos are off."""
_UNDECODED = -1
"""Of cv2.CAP_PROP_FORMAT: packets as they are in the file."""
_Found = TypeVar("_Found")


class _OwnImages(ABC):
    """What all sources of one's own images share: one camera, no truth, frames undistorted as they come."""

    scene_id = 1
    object_ids: tuple[int, ...] = (1,)
    frame_ids: tuple[int, ...] = ()

    def __init__(self, name: str, camera: Camera) -> None:
        self.name = name
        self.camera = camera
        self._undistort = Undistorter(camera)

    def frames(self, max_frames: int | None = None) -> Iterator[Frame | UnreadableFrame]:
        """The frames from the first on, read one at a time, at most max_frames; each call starts anew."""
        return at_most(self._read(), max_frames)

    def truth(self, frame_id: int, object_id: int) -> FloatArray | None:
        """None: nobody measured these."""
        return None

    @property
    def first_poses(self) -> Mapping[int, FloatArray]:
        """Always SequenceError."""
        raise SequenceError(f"{self.name}: has no true poses: give a start pose, as read_pose('POSE.json')")

    @property
    def first_pose(self) -> FloatArray:
        """Always SequenceError."""
        raise SequenceError(f"{self.name}: has no true pose: give a start pose, as read_pose('POSE.json')")

    @abstractmethod
    def _read(self) -> Iterator[Frame | UnreadableFrame]: ...

    def _frame(self, index: int, image: ByteImage, source: str, time_s: float | None = None) -> Frame | UnreadableFrame:
        misfit = self._misfit(image, source)
        if misfit is not None:
            return self._unreadable(index, misfit)
        start = time.perf_counter()
        straight = self._undistort(image)
        return Frame(index, straight, self.camera.pinhole(), time_s, time.perf_counter() - start)

    def _unreadable(self, index: int, reason: str) -> UnreadableFrame:
        return UnreadableFrame(index, self.camera.pinhole(), reason)

    def _check_first(self, image: ByteImage, source: str) -> None:
        misfit = self._misfit(image, source)
        if misfit is not None:
            raise InputFileError(misfit)
        # Makes the tables of the undistortion, so that the first frame's clock does not run for them.
        self._undistort(image)

    def _misfit(self, image: ByteImage, source: str) -> str | None:
        height, width = image.shape[:2]
        if (width, height) == (self.camera.width, self.camera.height):
            return None
        return (
            f"{source}: image is {width} x {height} px but the camera is {self.camera.width} x "
            f"{self.camera.height}: give the camera of these images{self._turned(width, height)}"
        )

    def _turned(self, width: int, height: int) -> str:
        if (height, width) != (self.camera.width, self.camera.height):
            return ""
        return "; notes on how to turn a picture (EXIF) are not obeyed: calibrate on the pixels as they are stored"


class ImagesInMemory(_OwnImages):
    """Images (h, w, 3) uint8 RGB that a program has, or makes one after another: a list, an array, a generator.

    A generator gives its images once, and how many nobody knows. Raises SequenceError while it is read, for what is no
    such image; GeometryError for one that is not of the camera's size.
    """

    def __init__(self, images: Iterable[ByteImage], camera: Camera) -> None:
        super().__init__("images", camera)
        self._images = images
        if isinstance(images, Sized):
            self.frame_ids = tuple(range(len(images)))

    def _read(self) -> Iterator[Frame | UnreadableFrame]:
        for index, image in enumerate(self._images):
            check_image(image, f"{self.name}: image {index}")
            start = time.perf_counter()
            straight = self._undistort(image)
            yield Frame(index, straight, self.camera.pinhole(), None, time.perf_counter() - start)


class ImageFolder(_OwnImages):
    """The images of a folder, in natural order of their names: 2.png before 10.png.

    Names that begin with a dot are passed over: they are hidden, and those of macOS hold no pictures. Frames have times
    where all names are Unix times, see `image_times.times_of`. A pixels.json among the images says how their values are
    meant (`PixelCoding`); `coding` overrules it. Raises InputFileError for a folder that is missing, a first image that
    cannot be read or is not of the camera's size, SequenceError for a folder without images.
    """

    def __init__(self, folder: str | Path, camera: Camera, coding: PixelCoding | None = None) -> None:
        self.folder = Path(folder)
        if not self.folder.is_dir():
            raise InputFileError(f"{self.folder}: no such folder: give a folder of images")
        super().__init__(Path(os.path.abspath(self.folder)).name, camera)
        self.image_paths = _images_in(self.folder)
        self.frame_ids = tuple(range(len(self.image_paths)))
        self._times_s = times_of(self.image_paths)
        coding = PixelCoding.beside(self.folder) if coding is None else coding
        first, self._coding = read_first(self.image_paths[0], coding)
        self._check_first(first, str(self.image_paths[0]))

    def _read(self) -> Iterator[Frame | UnreadableFrame]:
        for index, path in enumerate(self.image_paths):
            try:
                image = read_rgb(path, self._coding)
            except InputFileError as error:
                yield self._unreadable(index, str(error))
            else:
                yield self._frame(index, image, str(path), None if self._times_s is None else self._times_s[index])


class VideoFile(_OwnImages):
    """The frames of a video file, turned upright where its header says so.

    frame_ids: as many as the file holds; what headers announce is a guess in some kinds of files.
    A frame that cannot be decoded is an UnreadableFrame if others follow. A file that ends well before its header
    says, in frames and in time, is cut short: its last frame is an UnreadableFrame that says so.
    Raises InputFileError for a file that is missing, no video, or not of the camera's size.
    """

    def __init__(self, path: str | Path, camera: Camera) -> None:
        self.path = Path(path)
        _check_video_file(self.path)
        super().__init__(self.path.name, camera)
        with _capture(str(self.path), cv2.CAP_FFMPEG) as video:
            _check_frame_size(video, self.path)
            found, image = video.read()
            if not found:
                raise InputFileError(f"{self.path}: cannot be decoded as a video: convert it, as to H.264")
            # Streams without an index announce nothing, or a negative number.
            announced, fps = max(0, int(video.get(cv2.CAP_PROP_FRAME_COUNT))), video.get(cv2.CAP_PROP_FPS)
        held, self._promised = _frame_counts(self.path, announced, fps)
        self.frame_ids = tuple(range(held + (self._promised > held)))
        self._check_first(np.asarray(image, np.uint8), str(self.path))

    def _read(self) -> Iterator[Frame | UnreadableFrame]:
        index = 0
        with _capture(str(self.path), cv2.CAP_FFMPEG) as video:
            for picture in _to_the_end(lambda: _timed_picture(video)):
                if picture is None:
                    yield self._unreadable(index, f"{self.path}: frame {index} is damaged")
                else:
                    yield self._frame(index, picture[0], str(self.path), picture[1])
                index += 1
        if index + _UNCOUNTED < self._promised:
            yield self._unreadable(
                index, f"{self.path}: ends after {index} of the {self._promised} frames that its header announces"
            )


class CameraDevice(_OwnImages):
    """A live camera by its number; endless until the loop is left, so frame_ids is empty.

    The device is opened by `frames()` and closed when its iterator ends or is closed. time_s counts from
    there, see `image_times.CameraClock`. Raises SequenceError at once for what is no number of a device, later when
    there is no such device, when it does not deliver the camera's image size, or when it stops delivering.
    """

    def __init__(self, index: SupportsIndex, camera: Camera) -> None:
        self.index = _checked_number(index)
        super().__init__(f"camera {self.index}", camera)

    def _read(self) -> Iterator[Frame | UnreadableFrame]:
        with _capture(self.index, cv2.CAP_ANY) as device:
            if not device.isOpened():
                raise SequenceError(f"{self.name}: cannot be opened: check its number, its cable and who else uses it")
            device.set(cv2.CAP_PROP_FRAME_WIDTH, self.camera.width)
            device.set(cv2.CAP_PROP_FRAME_HEIGHT, self.camera.height)
            clock = CameraClock()
            index = failures = 0
            while failures < _FAILURES_IN_A_ROW:
                found, image = device.read()
                if found:
                    time_s = clock.taken_s(device)
                    misfit = self._misfit(np.asarray(image, np.uint8), self.name)
                    if misfit is not None:
                        raise SequenceError(misfit)
                    failures = 0
                    yield self._frame(index, _rgb(image), self.name, time_s)
                else:
                    failures += 1
                    yield self._unreadable(index, f"{self.name}: gave no image")
                index += 1
        raise SequenceError(f"{self.name}: stopped giving images: check its cable and start again")


def open_images(
    source: str | Path | SupportsIndex | Iterable[ByteImage], camera: Camera
) -> ImageFolder | VideoFile | CameraDevice | ImagesInMemory:
    """The images of a folder, the frames of a video file, or a live camera by its number ("0" or 0).

    Or images that a program has: a list, an array (n, h, w, 3), a generator. A file or folder of a name comes first.
    Errors as in the four classes.
    """
    check_kind(camera, Camera, "camera", "acp.Camera.from_json('CAMERA.json')")
    if not isinstance(source, str | Path):
        if isinstance(source, Iterable):
            return ImagesInMemory(source, camera)
        if not _is_number(source):
            check_kind(source, Iterable, "source", "a folder, a video file, a camera's number, or a list of images")
        return CameraDevice(source, camera)
    path = Path(source)
    if path.is_dir():
        return ImageFolder(path, camera)
    number = _device_number(path)
    if number is not None:
        return CameraDevice(number, camera)
    return VideoFile(path, camera)


def first_size(source: str | Path, coding: PixelCoding | None = None) -> tuple[int, int]:
    """(width, height), px, of the first image that a folder, a video file or a live camera ("0") gives.

    For those who have yet to make its camera. Raises InputFileError or SequenceError when there is none.
    """
    path = Path(source)
    if path.is_dir():
        image = read_rgb(_images_in(path)[0], PixelCoding.beside(path) if coding is None else coding)
        return image.shape[1], image.shape[0]
    number = _device_number(path)
    is_device = number is not None
    if not is_device:
        _check_video_file(path)
    with _capture(str(path) if number is None else number, cv2.CAP_ANY if is_device else cv2.CAP_FFMPEG) as video:
        if not is_device:
            _check_frame_size(video, path)
        found, picture = video.read()
    if not found:
        fix = "check its number and its cable" if is_device else "convert it, as to H.264"
        raise InputFileError(f"{path}: gives no image: {fix}")
    return picture.shape[1], picture.shape[0]


def _images_in(folder: Path) -> tuple[Path, ...]:
    """The image files of a folder in natural order, hidden ones left out; SequenceError when there are none."""
    files = [
        path for path in folder.iterdir() if path.suffix.lower() in IMAGE_SUFFIXES and not path.name.startswith(".")
    ]
    if not files:
        raise SequenceError(f"{folder}: holds no images: put {', '.join(IMAGE_SUFFIXES)} there")
    return tuple(sorted(files, key=lambda path: _natural(path.name)))


def _device_number(path: Path) -> int | None:
    """The number of a live camera; None for a file. SequenceError for a number beyond what OpenCV takes."""
    text = str(path)
    if not text.isdecimal() or path.exists():
        return None
    return _checked_number(int(text))


def _is_number(source: object) -> bool:
    """Whether it is a whole number of any kind, NumPy's too."""
    try:
        as_index(source)  # type: ignore[arg-type]
    except TypeError:
        return False
    return True


def _checked_number(number: SupportsIndex) -> int:
    """That of a live camera; SequenceError for one that OpenCV does not take: it would end the process."""
    if isinstance(number, bool) or not _is_number(number) or not 0 <= as_index(number) <= _LARGEST_DEVICE:
        raise SequenceError(f"camera {number}: there are none of that number: the first one is 0")
    return as_index(number)


def _check_video_file(path: Path) -> None:
    fix = "give a video, or a folder of images"
    if path.exists():
        check_regular(path, fix, math.inf)
    if not path.is_file():
        raise InputFileError(f"{path}: no such video file: {fix}")
    if path.stat().st_size == 0:
        raise InputFileError(f"{path}: is empty: copy it again, or {fix}")


@contextmanager
def _capture(source: str | int, backend: int, *how: tuple[int, ...]) -> Iterator[cv2.VideoCapture]:
    """An opened cv2 capture that is released whatever happens, and that keeps its libraries off stderr."""
    with quiet_cv2():
        capture = cv2.VideoCapture(source, backend, *how)  # type: ignore[call-overload]
    try:
        yield capture
    finally:
        capture.release()


def _to_the_end(read: Callable[[], _Found | None]) -> Iterator[_Found | None]:
    """What a video gives, None for each time it fails: damage, as far as anything follows, and else its end."""
    failures = 0
    while failures < _DAMAGED_IN_A_ROW:
        found = read()
        if found is None:
            failures += 1
            continue
        yield from (None for _ in range(failures))
        yield found
        failures = 0


def _timed_picture(video: cv2.VideoCapture) -> tuple[ByteImage, float] | None:
    """The next frame of a video and its time, s; None where it fails."""
    found, image = video.read()
    # After a read, the position is the time stamp of the frame just read.
    return (_rgb(image), video.get(cv2.CAP_PROP_POS_MSEC) / 1000.0) if found else None


def _packet_time(packets: cv2.VideoCapture) -> float | None:
    """Of the next packet, in frames since time 0, where its first one need not be; None where it fails."""
    return packets.get(cv2.CAP_PROP_PTS) if packets.grab() else None


def _frame_counts(path: Path, announced: int, fps: float) -> tuple[int, int]:
    """How many frames a video holds, and how many it should: more only where it is cut short.

    Some containers, such as Matroska, announce no number; OpenCV makes one up from the duration, as if frames came at
    equal times and from time 0 on. So the packets are counted, which are not decoded for it, and their times have a
    say: a film that lasts as long as announced is whole.

    announced, fps: frames and frames per second, as the header has them.
    """
    with _capture(str(path), cv2.CAP_FFMPEG, (cv2.CAP_PROP_FORMAT, _UNDECODED)) as packets:
        found = list(_to_the_end(lambda: _packet_time(packets)))
    held, times = len(found), [time for time in found if time is not None]
    if not times or not fps > 0.0:
        return announced, announced
    longest = float(np.diff(np.sort(times)).max(initial=1.0))
    missing = announced - max(times)
    is_cut = held + _UNCOUNTED < announced and missing > (1 + _UNCOUNTED) * longest
    return held, announced if is_cut else min(held, announced or held)


def _check_frame_size(video: cv2.VideoCapture, path: Path) -> None:
    """Before the first frame is decoded: its size is in the header."""
    width, height = (int(video.get(which)) for which in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
    if width * height > LARGEST_PIXELS:
        raise InputFileError(
            f"{path}: has frames of {width} x {height} px, {LARGEST_PIXELS // 1_000_000} million is the most: make "
            "them smaller"
        )


def _rgb(image: np.ndarray) -> ByteImage:
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), dtype=np.uint8)


def _natural(name: str) -> tuple[list[str | int], str]:
    # Text and numbers alternate, so equal places always hold the same type; the name itself breaks ties.
    parts = re.split("([0-9]+)", name.lower())
    return [int(part) if i % 2 else part for i, part in enumerate(parts)], name
