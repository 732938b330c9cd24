"""Where did the part's picture go? The last frame's picture of the part, searched in the next frame.

A part that moves fast is blurred and far from where its motion was expected, but it looks much as it did a frame ago.
Normalised cross-correlation of a small picture of it says how far it went, to a few px, whatever its edges do. A moving
occluder can say something else, so the prediction decides whether that is believed (`kalman.PoseKalman.sight`), and a
frame that then fits worse than usual is also solved without it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import cv2
import numpy as np

from acp_lab.errors import TrackingError
from acp_lab.geometry.arrays import ByteImage, Float32Array, FloatArray
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.frame_view import crop_box

# Smaller pictures look like many places.
_LEAST_SIDE = 6


@dataclass(frozen=True)
class PictureSearch:
    """Configuration: the part's last picture is searched in the next frame.

    Attributes:
        side_px: of the picture, after it was made smaller; reach: how far it is searched, as a share of its side.
        core: share of the part's box in the image that is taken as its picture; the rim shows background.
        least_match: least normalised cross-correlation, in [-1, 1]; least_gain: by how much it must be better than
            where the part is expected: along a bar, a picture fits everywhere.
        scatter_px: standard deviation of where it is found, in px of the full image; doubt: standard deviations, of
            picture and prediction together, from which on it is not believed.
        least_px: nearer to the prediction than this it says nothing: edges see better.
    """

    kind: ClassVar[str] = "picture"
    side_px: int = 24
    reach: float = 0.6
    core: float = 0.8
    least_match: float = 0.5
    least_gain: float = 0.05
    scatter_px: float = 4.0
    doubt: float = 4.0
    least_px: float = 6.0

    def __post_init__(self) -> None:
        checks = (
            ("side_px", self.side_px >= _LEAST_SIDE, f"{_LEAST_SIDE} or more"),
            ("reach", 0.0 < self.reach <= 4.0, "a share of the picture's side, such as 0.6"),
            ("core", 0.0 < self.core <= 1.0, "a share above 0, at most 1"),
            ("least_match", -1.0 <= self.least_match <= 1.0, "a correlation from -1 to 1"),
            ("least_gain", 0.0 <= self.least_gain <= 2.0, "a difference of correlations from 0 to 2"),
            ("scatter_px", self.scatter_px > 0.0, "px above 0"),
            ("doubt", self.doubt > 0.0, "a number above 0"),
            ("least_px", self.least_px >= 0.0, "px, 0 or more"),
        )
        for name, good, wanted in checks:
            if not good:
                raise TrackingError(f"sight.{name} = {getattr(self, name):g}: give {wanted}")


@dataclass(frozen=True, eq=False)
class Picture:
    """The part in one frame.

    cut: uint8 RGB, of the full image from the px `origin` (x, y) on, more than the picture. corner: (x, y) px of the
    full image, the picture's upper left; size: (w, h) of it; scale: px of the full image per px of the picture.
    """

    cut: ByteImage
    origin: tuple[int, int]
    corner: tuple[float, float]
    size: tuple[int, int]
    scale: float

    @cached_property
    def pixels(self) -> ByteImage:
        """(h, w, 3) uint8, made smaller; not before it is searched, as most pictures never are."""
        corner = self.corner[0] - self.origin[0], self.corner[1] - self.origin[1]
        return _smaller(self.cut, corner, self.size, self.scale)

    def shift_in(self, image: ByteImage, expected_px: FloatArray, config: PictureSearch) -> FloatArray | None:
        """(2,) px from where the part was to where it is in an image (h, w, 3) RGB.

        expected_px: (2,) the same, as the motion has it. None where the picture is not recognised, or fits there, too.
        """
        width, height = self.size
        reach = int(np.ceil(config.reach * max(height, width)))
        # The searched picture's first pixel lies a whole number of small px from the old one's.
        x0, y0 = (corner - reach * self.scale for corner in self.corner)
        around = _smaller(image, (x0, y0), (width + 2 * reach, height + 2 * reach), self.scale)
        found = cv2.matchTemplate(around, self.pixels, cv2.TM_CCOEFF_NORMED)
        # Pictures of one grey level have no correlation.
        match = np.nan_to_num(found, nan=-1.0, posinf=-1.0, neginf=-1.0).astype(np.float32)
        _, best, _, (column, row) = cv2.minMaxLoc(match)
        column_there, row_there = np.clip(
            np.rint(expected_px / self.scale).astype(int) + reach, 0, (match.shape[1] - 1, match.shape[0] - 1)
        )
        if best < max(config.least_match, float(match[row_there, column_there]) + config.least_gain):
            return None
        x = column + _peak(match[row], column) - reach
        y = row + _peak(match[:, column], row) - reach
        return self.scale * np.array([x, y])


def take_picture(frame: Frame, corners_obj: FloatArray, cam_T_obj: FloatArray, config: PictureSearch) -> Picture | None:
    """The part at a pose (4, 4), its box's corners (8, 3) mm; None where it is hardly inside the image."""
    box = crop_box(corners_obj, cam_T_obj, frame.camera, 0.0)
    if box is None:
        return None
    camera = frame.camera
    (x0, x1), (y0, y1) = (_core(low, high, config.core) for low, high in ((box[0], box[2]), (box[1], box[3])))
    x0, y0, x1, y1 = max(x0, 0.0), max(y0, 0.0), min(x1, camera.width), min(y1, camera.height)
    scale = max(max(x1 - x0, y1 - y0) / config.side_px, 1.0)
    width, height = int((x1 - x0) / scale), int((y1 - y0) / scale)
    if min(width, height) < _LEAST_SIDE:
        return None
    left, top, right, bottom = _read_for(frame.image, (x0, y0), (width, height), scale)
    # A copy: whoever gave the frame may write into its image later.
    cut = frame.image[top:bottom, left:right].copy()
    return Picture(cut, (left, top), (x0, y0), (width, height), scale)


def _core(low: float, high: float, share: float) -> tuple[float, float]:
    middle, half = 0.5 * (low + high), 0.5 * share * (high - low)
    return middle - half, middle + half


def _smaller(image: ByteImage, corner: tuple[float, float], size: tuple[int, int], scale: float) -> ByteImage:
    """(h, w, 3) of an image's rectangle from a corner (x, y), in px `scale` times as large; beyond it its border."""
    (width, height), (left, top) = size, corner
    x0, y0, x1, y1 = _read_for(image, corner, size, scale)
    # Averaging first, over whole px, keeps fine patterns from beating with the coarse grid.
    step = max(int(scale), 1)
    if x1 - x0 < step or y1 - y0 < step:
        return np.zeros((height, width, 3), np.uint8)
    cut = image[y0:y1, x0:x1]
    cut = cut[: (y1 - y0) // step * step, : (x1 - x0) // step * step]
    mean = cv2.resize(cut, (cut.shape[1] // step, cut.shape[0] // step), interpolation=cv2.INTER_AREA)
    zoom = scale / step
    # Centres: small px i covers scale px from left + i scale.
    into = np.array([
        [zoom, 0.0, (left + 0.5 * scale - x0) / step - 0.5],
        [0.0, zoom, (top + 0.5 * scale - y0) / step - 0.5],
    ])  # fmt: skip
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    small = cv2.warpAffine(mean, into, (width, height), flags=flags, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(small, np.uint8)


def _read_for(
    image: ByteImage, corner: tuple[float, float], size: tuple[int, int], scale: float
) -> tuple[int, int, int, int]:
    """The rectangle x0, y0, x1, y1 of an image that `_smaller` reads, the last ones excluded."""
    (left, top), (rows, columns), step = corner, image.shape[:2], max(int(scale), 1)
    right, bottom = left + size[0] * scale, top + size[1] * scale
    return (
        max(int(left) - step, 0),
        max(int(top) - step, 0),
        min(int(right) + 2 * step, columns),
        min(int(bottom) + 2 * step, rows),
    )


def _peak(values: Float32Array, at: int) -> float:
    """Where the parabola through a maximum and its neighbours is highest, from -0.5 to 0.5."""
    if not 0 < at < len(values) - 1:
        return 0.0
    before, here, after = (float(value) for value in values[at - 1 : at + 2])
    curvature = before - 2.0 * here + after
    return 0.5 * (before - after) / curvature if curvature < 0.0 else 0.0
