"""What would another camera have made of these pictures, and what becomes of a tracker then?

Made pictures all come from one made camera, and recorded ones from whichever stood there. A tracker that was judged on
them alone may know that camera rather than parts. So the pictures are taken once more: softer, darker, noisier, without
colours, with another tone curve, as light falls through the lens onto the sensor and is encoded.

`AlteredSequence(sequence, camera.take)` is a sequence as a camera would have taken it. `track_as_taken` tracks it for
each camera, and says how far the poses are from those that are known, such as the true ones.

It is no more than what can be told from the picture: what was too bright stays white, and what was blurred stays
blurred.

Convention: light runs from 0 to 1, a picture's grey level over 255 to the power `PICTURE_GAMMA`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import cv2
import numpy as np

from acp_lab.errors import ParameterError, SequenceError
from acp_lab.evaluation.metrics import recall
from acp_lab.evaluation.part_metric import PartMetric
from acp_lab.geometry.arrays import ByteImage, Float32Array, FloatArray
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.altered import AlteredSequence
from acp_lab.sequences.frame import Frame
from acp_lab.sequences.protocol import Sequence
from acp_lab.tracking.method import Method
from acp_lab.tracking.tracker import Tracker

# As displays decode pictures; what the edge search takes cameras to have encoded by is less.
PICTURE_GAMMA = 2.2
_LIGHT: Float32Array = ((np.arange(256) / 255.0) ** PICTURE_GAMMA).astype(np.float32)
# Of a usual industrial sensor, electrons, standard deviation.
_READ_NOISE = 12.0
_SHARPENED_PX = 1.2


@dataclass(frozen=True)
class OtherCamera:
    """A camera that stands where the camera stood.

    Attributes:
        blur_px: standard deviation of its lens's blur, on top of what is in the picture.
        is_half: it has half the pixels in each direction.
        exposure: times the light that the camera took.
        electrons: that a white pixel holds: the fewer, the more photon and read noise; 0 for no noise.
        gamma: grey is light to the power 1 / gamma: 2.2 as displays take it, 1 for light as it is.
        sharpening: what is added of the difference to a picture blurred by 1.2 px, as cameras do that sharpen.
        is_grey: it sees no colours.
        jpeg_quality: as it stores pictures; 0 for as they are.
    """

    blur_px: float = 0.0
    is_half: bool = False
    exposure: float = 1.0
    electrons: float = 0.0
    gamma: float = PICTURE_GAMMA
    sharpening: float = 0.0
    is_grey: bool = False
    jpeg_quality: int = 0

    def __post_init__(self) -> None:
        limits = (
            ("blur_px", 0.0, 50.0), ("exposure", 1e-3, 1e3), ("electrons", 0.0, 1e7), ("gamma", 0.5, 5.0),
            ("sharpening", 0.0, 10.0), ("jpeg_quality", 0, 100),
        )  # fmt: skip
        for name, low, high in limits:
            if not low <= getattr(self, name) <= high:
                raise ParameterError(f"camera.{name} = {getattr(self, name):g}: give {low:g} to {high:g}")

    def take(self, frame: Frame, seed: int = 0) -> Frame:
        """The frame as this camera would have taken it; its noise is that of the seed and of the frame's index."""
        camera, rng = frame.camera, np.random.default_rng([seed, frame.index])
        light = _LIGHT[frame.image]
        if self.blur_px > 0.0:
            light = np.asarray(cv2.GaussianBlur(light, (0, 0), self.blur_px), np.float32)
        if self.is_half:
            camera = camera.halved()
            even = light[: 2 * camera.height, : 2 * camera.width]
            light = np.asarray(
                cv2.resize(even, (camera.width, camera.height), interpolation=cv2.INTER_AREA), np.float32
            )
        image = self._encoded(self._sensed(self.exposure * light, rng))
        return replace(frame, image=self._stored(image), camera=camera)

    def _sensed(self, light: Float32Array, rng: np.random.Generator) -> Float32Array:
        if self.electrons == 0.0:
            return light
        counted = rng.poisson(self.electrons * np.minimum(light, 1.0)) + rng.normal(0.0, _READ_NOISE, light.shape)
        return (counted / self.electrons).astype(np.float32)

    def _encoded(self, light: Float32Array) -> ByteImage:
        grey = 255.0 * np.clip(light, 0.0, 1.0) ** (1.0 / self.gamma)
        if self.sharpening > 0.0:
            grey = grey + self.sharpening * (grey - cv2.GaussianBlur(grey, (0, 0), _SHARPENED_PX))
        encoded: ByteImage = grey.round().clip(0, 255).astype(np.uint8)
        return encoded

    def _stored(self, image: ByteImage) -> ByteImage:
        if self.is_grey:
            image = np.asarray(cv2.cvtColor(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), cv2.COLOR_GRAY2RGB), np.uint8)
        if self.jpeg_quality:
            # OpenCV takes blue for the first channel, and JPEG keeps red and blue unlike.
            _, file = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, self.jpeg_quality])
            return np.asarray(cv2.imdecode(file, cv2.IMREAD_COLOR_RGB), np.uint8)
        return image


CAMERAS: dict[str, OtherCamera] = {
    "soft": OtherCamera(blur_px=1.8),
    "half": OtherCamera(is_half=True),
    "sharpened": OtherCamera(sharpening=1.2),
    "noisy": OtherCamera(electrons=1000.0),
    "grainy": OtherCamera(electrons=200.0),
    "dark": OtherCamera(exposure=0.15, electrons=6000.0),
    "bright": OtherCamera(exposure=2.5),
    "linear": OtherCamera(gamma=1.0),
    "grey": OtherCamera(is_grey=True),
    "compressed": OtherCamera(jpeg_quality=30),
}
"""By name: a lens out of focus, half the pixels, a camera that sharpens, one at high gain, one at a far higher one, one
in a sixth of the light, one that exposes too long, one that stores light as it is, one without colours, one that stores
small files."""


@dataclass(frozen=True, eq=False)
class CameraStudy:
    """How far poses are from the known ones when other cameras took the pictures. Prints as a table.

    errors: (n,) ADD or ADD-S as shares of the diameter by camera, of the frames behind the first; infinite without a
        pose.
    """

    errors: Mapping[str, FloatArray]

    def recall(self, camera: str, below: float) -> float:
        """The share of the frames whose error is below a share of the diameter."""
        return recall(self.errors[camera], below)

    def __str__(self) -> str:
        width = max(len("camera"), *map(len, self.errors))
        head = f"{'camera':{width}}  within 2%  within 5%  median ADD"
        rows = (
            f"{name:{width}}  {self.recall(name, 0.02):9.2f}  {self.recall(name, 0.05):9.2f}  "
            f"{100.0 * float(np.median(errors)):9.2f}%"
            for name, errors in self.errors.items()
        )
        return "\n".join((head, *rows))


def track_as_taken(
    model: PreparedPart,
    sequence: Sequence,
    start: FloatArray,
    cameras: Mapping[str, OtherCamera],
    known: Callable[[int], FloatArray | None],
    method: str | Method = "acp",
    max_frames: int | None = None,
) -> CameraStudy:
    """Track the only object of a sequence as each camera would have taken it.

    Args:
        start: (4, 4) pose in the first frame, for all cameras.
        known: of a frame id the pose (4, 4) to hold results against, such as the true one; None where there is none.

    Raises SequenceError where no frame behind the first has a known pose, or the sequence has several objects; else as
    `Tracker.run`.
    """
    metric = PartMetric(model.part)
    errors = dict[str, FloatArray]()
    for name, camera in cameras.items():
        run = Tracker(model, method).run(AlteredSequence(sequence, camera.take), start, max_frames=max_frames)
        (results,) = run.results.values()
        pairs = [(result.cam_T_obj, known(result.frame_id)) for result in results[1:]]
        errors[name] = np.array([metric.share(found, pose) for found, pose in pairs if pose is not None])
        if not len(errors[name]):
            raise SequenceError(f"{sequence.name}: no frame behind the first has a known pose: give those of a run")
    return CameraStudy(errors)
