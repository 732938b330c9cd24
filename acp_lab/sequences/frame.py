"""What a sequence yields: a frame, or the note that a frame could not be read.

Convention: images are (h, w, 3) uint8 RGB and undistorted, so their camera has no distortion; pixel (0, 0) is
the centre of the top-left pixel. The camera belongs to the frame: intrinsics may differ from one to the next.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from acp_lab.errors import SequenceError, check_kind
from acp_lab.geometry.arrays import ByteImage
from acp_lab.geometry.camera import Camera


@dataclass(frozen=True, eq=False)
class Frame:
    """One image with its camera.

    index: the image id (`im_id`); ids rise within a sequence, with gaps where images are absent.
    image: (h, w, 3) uint8 RGB, undistorted.
    camera: the pinhole camera of this image, of the image's size.
    time_s: when the image was taken, seconds from the start of the sequence; None when nobody knows.
    undistort_s: wall seconds spent on removing lens distortion; it counts as tracking time, decoding does
    not.

    Raises SequenceError for an image that is none of that form or not of its camera's size, and for a camera with lens
    distortion, of which nothing behind a sequence knows.
    """

    index: int
    image: ByteImage
    camera: Camera
    time_s: float | None = None
    undistort_s: float = 0.0

    def __post_init__(self) -> None:
        image, camera = self.image, self.camera
        if not isinstance(self.index, int | np.integer):
            raise SequenceError(f"frame {self.index!r}: its index is no whole number: give one")
        if not (self.time_s is None or isinstance(self.time_s, int | float | np.number)):
            raise SequenceError(
                f"frame {self.index}: its time_s is a {type(self.time_s).__name__}: give seconds, or None"
            )
        check_image(image, f"frame {self.index}: its image")
        check_kind(camera, Camera, "camera", "acp.Camera.from_matrix(K, width, height), or Camera.from_json of a file")
        if image.shape[:2] != (camera.height, camera.width):
            raise SequenceError(
                f"frame {self.index}: its image is {image.shape[1]} x {image.shape[0]} px but its camera "
                f"{camera.width} x {camera.height}: give the camera of this image"
            )
        if camera.is_distorted:
            raise SequenceError(
                f"frame {self.index}: its camera has lens distortion: take it out of the image, by "
                "Undistorter(camera)(image), and give camera.pinhole()"
            )

    def to_keep(self) -> Frame:
        """The same with an image of its own: whoever gave this one may write the next image into its array."""
        return replace(self, image=self.image.copy())


def check_image(image: object, what: str) -> None:
    """SequenceError, beginning with `what`, for anything but an image of a frame: (h, w, 3) uint8 RGB."""
    if not isinstance(image, np.ndarray):
        raise SequenceError(f"{what} is {type(image).__name__}: give RGB, an array, uint8 (height, width, 3)")
    if image.dtype == np.uint8 and image.ndim == 3 and image.shape[2] == 3:
        return
    if image.dtype == np.uint16:
        fix = "; of 16 bits (image >> 8).astype(np.uint8)"
    elif image.dtype != np.uint8:
        fix = "; of 0 to 1 np.uint8(255.0 * image)"
    elif image.ndim == 2:
        fix = "; grey three times: np.dstack([grey] * 3)"
    else:
        fix = "; of RGBA image[..., :3]" if image.ndim == 3 and image.shape[2] == 4 else ""
    raise SequenceError(f"{what} is {image.dtype} {image.shape}: give RGB, uint8 (height, width, 3){fix}")


def check_frame(frame: object) -> None:
    """ParameterError for an argument that is no `Frame`, such as a bare image."""
    check_kind(frame, Frame, "frame", "a frame of a sequence, as scene.frame(0), or Frame(index, image, camera)")


@dataclass(frozen=True)
class UnreadableFrame:
    """A frame whose image is damaged, missing or of another size: yielded in its place, never raised.

    index: the image id. camera: its pinhole camera, None when that is unknown too.
    reason: one line for a warning, naming the file where there is one.
    """

    index: int
    camera: Camera | None
    reason: str
