"""Small parts are looked at through a magnifying glass, large ones from farther away.

A method's lengths in px (how wide it searches, how it smooths, how its levels narrow) suit a part that appears some
two hundred px long. Of a smaller one, neighbouring edges fall within each other's reach, and the search, which reads
whole pixels, rounds by much of what it measures. A larger one leaves that reach from frame to frame, and its edges are
blurred over more px than a search looks for. So the image around a small part is enlarged before it is looked at, by a
whole number of times, that around a large one is made smaller, and what is reported is in px of the frame again. (Not
in the paper, whose one length is a share of the part.)

Nothing is seen that the frame does not hold: cubic interpolation (Keys, Cubic convolution interpolation for digital
image processing, 1981) draws the same light with more pixels, and the mean of several keeps it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar

import cv2
import numpy as np

from acp_lab.cad.part import Part
from acp_lab.errors import TrackingError
from acp_lab.generator.base import GeneratedEdges
from acp_lab.geometry.arrays import ByteImage, FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import transform
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.result import TargetView, TrackStep

# A part that comes and goes about the limit keeps its glass: what is remembered of its edges is of one size.
_KEEP_BELOW, _KEEP_ABOVE = 0.75, 2.0
_KEEP_LARGE, _KEEP_FROM, _KEEP_TO = 4.0 / 3.0, 0.625, 1.6
# A part that is larger fills the largest images, or is all around the camera.
_MOST_SMALLER = 32
_LEAST_LARGE_PX = 60.0
# Around what is looked at, for the interpolation.
_RIM_PX = 3


@dataclass(frozen=True)
class Magnification:
    """Configuration: which parts are magnified or made smaller, and how much.

    Attributes:
        below_px: parts are magnified whose diameter, at their distance, appears shorter when they are first seen, or
            shorter than three quarters of it later.
        wanted_px: a part appears at least as long when it is first magnified, as far as `most` allows.
        most: times that a part is magnified at most.
        above_px: parts are made smaller that appear longer when they are first seen, or longer than four thirds of it
            later.
        large_px: how long such a part then appears, as nearly as a whole number of times allows.
    """

    kind: ClassVar[str] = "cubic"
    below_px: float = 120.0
    wanted_px: float = 165.0
    most: int = 4
    above_px: float = 360.0
    large_px: float = 210.0

    def __post_init__(self) -> None:
        if not 0.0 <= self.below_px <= self.wanted_px <= 1000.0:
            raise TrackingError(
                f"magnification.below_px = {self.below_px:g}, wanted_px = {self.wanted_px:g}: give px up to 1000, the "
                "second no less than the first"
            )
        if not (isinstance(self.most, int) and 1 <= self.most <= 8):
            raise TrackingError(f"magnification.most = {self.most}: give a whole number from 1 to 8")
        if not _LEAST_LARGE_PX <= self.large_px <= 0.6 * self.above_px <= 1e6:
            raise TrackingError(
                f"magnification.large_px = {self.large_px:g}, above_px = {self.above_px:g}: give px, the first from "
                f"{_LEAST_LARGE_PX:g} to 0.6 of the second, that up to a million, for never"
            )

    def times(self, size_px: float) -> int:
        """How many times a part is magnified that appears `size_px` long."""
        if size_px >= self.below_px:
            return 1
        return min(max(math.ceil(self.wanted_px / max(size_px, 1e-6)), 1), self.most)

    def times_smaller(self, size_px: float) -> int:
        """How many times smaller a part is made that appears `size_px` long; 1 for one that is magnified."""
        if size_px <= self.above_px or self.times(size_px) > 1:
            return 1
        return round(min(size_px / self.large_px, _MOST_SMALLER))


USUAL_MAGNIFICATION = Magnification()
"""Of who looks for a part, whatever method tracks it."""


def appears_px(part: Part, camera: Camera, cam_T_obj: FloatArray) -> float:
    """How long a part's diameter appears at a pose (4, 4); far too long for one behind the camera."""
    depth = float(transform(cam_T_obj, part.box_centre)[2])
    return part.diameter * camera.fx / max(depth, 1e-6)


class MagnifyingGlass:
    """How a part is magnified from frame to frame.

    times: how many times, a whole number, or 1/2, 1/3 and so on where it is made smaller; 1 without a glass.
    """

    def __init__(self, config: Magnification | None) -> None:
        self._config = config
        self.put_away()

    @classmethod
    def of(cls, times: float) -> MagnifyingGlass:
        """One that magnifies so many times, whatever it is held before."""
        glass = cls(None)
        glass.times = times
        return glass

    def put_away(self) -> None:
        """Before a new track."""
        self.times, self._in_use = 1.0, False

    def choose(self, size_px: float) -> None:
        """For a part that appears `size_px` long, in px of the frame; the one in use serves as long as it can."""
        config, shown_px = self._config, self.times * size_px
        if config is None:
            return
        if self.times > 1:
            serves = _KEEP_BELOW * config.below_px <= shown_px <= _KEEP_ABOVE * config.wanted_px
        elif self.times == 1:
            serves = _KEEP_BELOW * config.below_px <= shown_px <= _KEEP_LARGE * config.above_px
        else:
            serves = _KEEP_FROM * config.large_px <= shown_px <= _KEEP_TO * config.large_px
        if not (self._in_use and serves):
            self.times, self._in_use = config.times(size_px) / config.times_smaller(size_px), True

    @property
    def _divisor(self) -> int:
        return max(round(1.0 / self.times), 1)

    def camera(self, camera: Camera) -> Camera:
        """The camera of the magnified image."""
        if self.times == 1:
            return camera
        if self.times < 1:
            return camera.shrunk(self._divisor)
        times = round(self.times)
        return camera.resized(times * camera.width, times * camera.height)

    def image(self, image: ByteImage, box: tuple[int, int, int, int]) -> ByteImage:
        """An image (h, w, 3), magnified inside a box (x0, y0, x1, y1) px of the magnified one; black elsewhere."""
        if self.times < 1:
            return _shrunk(image, box, self._divisor)
        times = round(self.times)
        if times == 1:
            return image
        height, width = image.shape[:2]
        x0, y0 = (max(low // times - _RIM_PX, 0) for low in box[:2])
        x1, y1 = (min(high // times + 1 + _RIM_PX, most) for high, most in zip(box[2:], (width, height), strict=True))
        # Of zeros that nobody touches most systems keep the address alone.
        found = np.zeros((times * height, times * width, 3), np.uint8)
        if x0 < x1 and y0 < y1:
            size = (times * (x1 - x0), times * (y1 - y0))
            found[times * y0 : times * y1, times * x0 : times * x1] = cv2.resize(
                image[y0:y1, x0:x1], size, interpolation=cv2.INTER_CUBIC
            )
        return found

    def frame(self, frame: Frame, box: tuple[int, int, int, int] | None = None) -> Frame:
        """A frame as `camera` and `image` make it; magnified as a whole without a box."""
        if self.times == 1:
            return frame
        camera = self.camera(frame.camera)
        return replace(frame, image=self.image(frame.image, box or (0, 0, camera.width, camera.height)), camera=camera)

    def points(self, points: FloatArray) -> FloatArray:
        """Points (n, 2) px of the magnified image, in px of the frame."""
        return points if self.times == 1 else (points + 0.5) / self.times - 0.5

    def lengths(self, lengths_px: FloatArray) -> FloatArray:
        """(n,) px of the magnified image, in px of the frame."""
        return lengths_px if self.times == 1 else lengths_px / self.times

    def edges(self, edges: GeneratedEdges) -> GeneratedEdges:
        """Edge points of the magnified image, in px of the frame."""
        return edges if self.times == 1 else replace(edges, points=self.points(edges.points))

    def steps(self, steps: tuple[TrackStep, ...]) -> tuple[TrackStep, ...]:
        """Iterations in the magnified image, in px of the frame; their loss stays."""
        if self.times == 1:
            return steps
        return tuple(replace(step, control_points=self.points(step.control_points)) for step in steps)

    def target(self, target: TargetView) -> TargetView:
        """What was found in the magnified image, in px of the frame; it has no distance map there."""
        if self.times == 1:
            return target
        (x, y), (width, height) = target.origin, target.size
        if self.times < 1:
            per = self._divisor
            return TargetView(self.points(target.edge_points), (per * x, per * y), (per * width, per * height))
        times = round(self.times)
        origin = x // times, y // times
        size = -(-(x + width) // times) - origin[0], -(-(y + height) // times) - origin[1]
        return TargetView(self.points(target.edge_points), origin, size)


def _shrunk(image: ByteImage, box: tuple[int, int, int, int], times: int) -> ByteImage:
    """An image (h, w, 3) made so many times smaller, inside a box (x0, y0, x1, y1) px of that; black elsewhere."""
    height, width = image.shape[0] // times, image.shape[1] // times
    x0, y0 = (min(max(low, 0), most) for low, most in zip(box[:2], (width, height), strict=True))
    x1, y1 = (min(high, most) for high, most in zip(box[2:], (width, height), strict=True))
    found = np.zeros((height, width, 3), np.uint8)
    if x0 < x1 and y0 < y1:
        part = image[y0 * times : y1 * times, x0 * times : x1 * times]
        while times % 2 == 0 and times > 2:  # by two and by two is several times faster than by four
            half = part.shape[1] // 2, part.shape[0] // 2
            part, times = np.asarray(cv2.resize(part, half, interpolation=cv2.INTER_AREA), np.uint8), times // 2
        found[y0:y1, x0:x1] = cv2.resize(part, (x1 - x0, y1 - y0), interpolation=cv2.INTER_AREA)
    return found
