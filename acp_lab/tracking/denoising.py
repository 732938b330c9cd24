"""Pictures full of noise, such as those of a camera at high gain, are smoothed before anything is looked for in them.

The noise of a sensor in good light is small beside the contrast of edges, and a picture is best seen as it is. With
little light it is not: then each line that is searched along an edge's normal meets steps of noise that are as high as
the edge, and colours are told apart no longer. A Gaussian takes noise away faster than it blurs edges that are smooth
already. How noisy pictures are is a matter of the camera and its gain, so of the last ones the median counts.
(The paper blurs and denoises every picture alike, IV-B; here by how noisy it is. See docs/paper-ledger.md.)
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace
from statistics import median
from typing import ClassVar

import cv2
import numpy as np

from acp_lab.errors import TrackingError
from acp_lab.geometry.arrays import ByteImage
from acp_lab.imaging.noise import noise_levels
from acp_lab.sequences.frame import Frame

# A narrower Gaussian would change next to nothing.
_LEAST_PX = 0.3


@dataclass(frozen=True)
class Denoising:
    """Configuration: which pictures are smoothed, and how much.

    Attributes:
        above: noise, grey levels (see `imaging.noise`), up to which pictures are seen as they are, and where they are
            hardly any noisier.
        full: noise from which on they are smoothed by most_px; between the two the Gaussian's variance grows evenly.
        most_px: standard deviation of the widest Gaussian.
        pictures: the last that were asked, of whose noise the median counts.
        every: one picture in so many is asked, once there are as many; each where the last said otherwise.
    """

    kind: ClassVar[str] = "gaussian"
    above: float = 3.0
    full: float = 9.0
    most_px: float = 0.8
    pictures: int = 5
    every: int = 10

    def __post_init__(self) -> None:
        if not 0.0 <= self.above < self.full <= 255.0:
            raise TrackingError(
                f"denoising.above = {self.above:g}, full = {self.full:g}: give grey levels, the first from 0, the "
                "second more, up to 255"
            )
        if not _LEAST_PX <= self.most_px <= 50.0:
            raise TrackingError(f"denoising.most_px = {self.most_px:g}: give px from {_LEAST_PX:g} to 50")
        for name in ("pictures", "every"):
            value = getattr(self, name)
            if not 1 <= value <= 1000:
                raise TrackingError(f"denoising.{name} = {value}: give 1 to 1000")

    def blur_px(self, noise: float) -> float:
        """Standard deviation of the Gaussian for a picture with so much noise, grey levels; 0 for none."""
        share = (noise - self.above) / (self.full - self.above)
        blur_px = self.most_px * math.sqrt(min(max(share, 0.0), 1.0))
        return blur_px if blur_px >= _LEAST_PX else 0.0


class NoiseFilter:
    """How the pictures of one track are smoothed.

    blur_px: standard deviation of the Gaussian; 0 for pictures that are seen as they are.
    """

    def __init__(self, config: Denoising) -> None:
        self.config = config
        self._levels = deque[float](maxlen=config.pictures)
        self.forget()

    def forget(self) -> None:
        """Before a new track."""
        self._levels.clear()
        self._frames, self._is_unsure, self.blur_px = 0, True, 0.0

    def smoothed(self, frame: Frame) -> Frame:
        """The frame as it is to be seen, whose noise counts from now on."""
        self._frames += 1
        if self._is_unsure or self._frames % self.config.every == 0:
            noise = noise_levels(frame.image)
            if noise is not None:
                self._levels.append(noise)
                self.blur_px = self.config.blur_px(median(self._levels))
                says_otherwise = (self.config.blur_px(noise) > 0.0) != (self.blur_px > 0.0)
                self._is_unsure = len(self._levels) < self.config.pictures or says_otherwise
        return self.preview(frame)

    def preview(self, frame: Frame) -> Frame:
        """The frame as it is seen by what the ones before told of their noise, not by its own; changes nothing."""
        return frame if self.blur_px == 0.0 else replace(frame, image=_smooth(frame.image, self.blur_px))


def _smooth(image: ByteImage, blur_px: float) -> ByteImage:
    return np.asarray(cv2.GaussianBlur(image, (0, 0), blur_px, borderType=cv2.BORDER_REPLICATE), np.uint8)
