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
        if not isinstance(image, np.ndarray) or image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
            kind = f"{image.dtype} {image.shape}" if isinstance(image, np.ndarray) else type(image).__name__
            raise SequenceError(
                f"frame {self.index}: its image is {kind}: give RGB, uint8 (height, width, 3); grey three times: "
                "np.dstack([grey] * 3)"
            )
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
