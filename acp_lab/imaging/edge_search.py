"""Image edges where the generated edges say to look: 1D searches along projected normals.

No edge map of the whole frame is made. The image is cropped to where the part is expected and its
gradient taken once; each generated edge point then reads that gradient along its normal and keeps the
few strongest peaks as candidates. (Deviation from paper IV-B, which takes Canny edges and a distance
transform: a distance map attracts to edges of any direction.)

Light adds up before a camera encodes it for displays. Where an edge is blurred, by motion or by a pixel's own size, the
encoded grey is steepest towards its dark side: dark parts on bright ground look smaller, the more the faster they move.
So gradients are taken in linear light; what is said of them is said in grey levels, which is how noise and contrast go.

Cameras differ. Light is sharpened before its slopes are taken, that of a soft picture more (`sharpness`), and of the
edges of a faint picture, such as one in the dark, less contrast is asked.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import cv2
import numpy as np

from acp_lab.compiled import kernel
from acp_lab.errors import TrackingError
from acp_lab.geometry.arrays import ByteImage, Float32Array, FloatArray, IntArray, plain
from acp_lab.imaging.edge_search_kernel import strongest_peaks
from acp_lab.imaging.sharpness import edge_blur_px, sharpened, softness

# Scharr's kernel sums to 32 per unit slope; dividing makes gradients grey levels per px.
SCHARR_GAIN = 1.0 / 32.0
# sRGB has about 2.2; many cameras brighten shadows less.
DISPLAY_GAMMA = 1.8
# Five taps hold 99% of a Gaussian of this standard deviation.
_NARROW_PX = 1.0
# A smear that is longer says little of where the edge is.
_WIDEST_PX = 12.0
# Below this grey level the encoding is nearly straight, as that of sRGB is; and a step out of black is no noise.
_DARK = 4.0
# Of a picture's gradients this share is no edge of anything; every fourth pixel each way tells as much as all.
_FLAT_SHARE = 0.9
_STEP = 4
# Of the usual contrast: in a picture without any edges its noise would pass for those of the part, were less asked.
_FAINTEST = 0.25


@dataclass(frozen=True)
class SearchConfig:
    """How image edges are searched along normals.

    Attributes:
        blur_px: standard deviation of the Gaussian before the gradient.
        max_candidates: peaks kept per edge point.
        contrast: gradient along the normal, grey levels per px, at which a peak scores one half.
        gamma: linear light is the grey level to this power; 1 to take grey levels as they are.
        faint_below: a picture whose steep gradients (`ImagePatch.steepness`) are below so many grey levels per px is
            faint as a whole, and less contrast is asked of its edges: in the square of the ratio. 0 for never.
        sharpening: how many times what a smoother copy lacks is added to the light of a picture in focus, after the
            Gaussian; to that of another by its `sharpness.softness`. 0 for a picture as it is.
    """

    blur_px: float = 1.0
    max_candidates: int = 6
    contrast: float = 6.0
    gamma: float = DISPLAY_GAMMA
    faint_below: float = 8.0
    sharpening: float = 1.6

    def __post_init__(self) -> None:
        for name, low, high in (("blur_px", 0.1, 50.0), ("max_candidates", 1, 100), ("contrast", 1e-3, 255.0)):
            if not low <= getattr(self, name) <= high:
                raise TrackingError(f"search.{name} = {getattr(self, name):g}: give {low:g} to {high:g}")
        if not 0.0 <= self.faint_below <= 255.0:
            raise TrackingError(f"search.faint_below = {self.faint_below:g}: give grey levels per px from 0 to 255")
        if not 0.0 <= self.sharpening <= 10.0:
            raise TrackingError(f"search.sharpening = {self.sharpening:g}: give 0 to 10")
        if not 1.0 <= self.gamma <= 4.0:
            raise TrackingError(f"search.gamma = {self.gamma:g}: give 1 to 4, such as 2.2")

    def contrast_in(self, patch: ImagePatch) -> float:
        """What is asked of an edge in a picture, grey levels per px."""
        if self.faint_below == 0.0 or patch.steepness >= self.faint_below:
            return self.contrast
        return self.contrast * max((patch.steepness / self.faint_below) ** 2, _FAINTEST)


AS_THEY_ARE = SearchConfig(faint_below=0.0, sharpening=0.0)
"""Pictures taken as they are: not sharpened, and whatever they are like, the same contrast is asked of edges."""


@dataclass(frozen=True)
class ImagePatch:
    """The part of a frame in which edges are searched.

    Attributes:
        channels: (h, w, 3) float32: gradient x, gradient y (of linear light from 0 to 255, sharpened, per px), smoothed
            grey, which is not sharpened.
        origin: (x, y) of the patch's first pixel in the full image.
        gamma, blur_px: see `SearchConfig`.
    """

    channels: Float32Array
    origin: tuple[int, int]
    gamma: float
    blur_px: float

    @cached_property
    def steepness(self) -> float:
        """Of its steep gradients, grey levels per px: of ten pixels nine have a lower one."""
        height, width, _ = self.channels.shape
        slopes = np.empty((-(-height // _STEP)) * (-(-width // _STEP)), np.float32)
        _some_slopes(self.channels, _STEP, slopes_of_encoding(self.gamma), slopes)
        place = int(_FLAT_SHARE * slopes.size)
        return float(np.partition(slopes, place)[place])

    @property
    def edge_blur_px(self) -> float | None:
        """How far its steepest edges are blurred, see `sharpness.edge_blur_px`."""
        return edge_blur_px(self.channels[..., 2], self.blur_px)


@kernel("void(f4[:, :, ::1], i8, f4[::1], f4[::1])")
def _some_slopes(channels: Float32Array, step: int, levels_per_light: Float32Array, slopes: Float32Array) -> None:
    """Fill slopes (k,), grey levels per px, of every `step`-th pixel of a patch (h, w, 3) each way, see `ImagePatch`.

    levels_per_light: see `slopes_of_encoding`.
    """
    height, width, _ = channels.shape
    place = 0
    for y in range(0, height, step):
        for x in range(0, width, step):
            across, along = channels[y, x, 0], channels[y, x, 1]
            steep = np.float32(np.sqrt(np.float64(across) * across + np.float64(along) * along))
            slopes[place] = steep * levels_per_light[int(channels[y, x, 2])]
            place += 1


@dataclass(frozen=True)
class Candidates:
    """Image edges found along the normals of n edge points, m per point, unused ones with score 0.

    Attributes:
        offsets: (n, m) px along the normal.
        scores: (n, m) in [0, 1]: contrast times squared cosine between gradient and normal.
        gradients: (n, m) grey levels per px along the normal, signed.
        before, after: (n, m) smoothed grey `FLANK_PX` before and after the peak along the normal.
    """

    offsets: FloatArray
    scores: FloatArray
    gradients: FloatArray
    before: FloatArray
    after: FloatArray


def image_patch(
    image: ByteImage,
    box: tuple[int, int, int, int],
    config: SearchConfig | None = None,
    lens_blur_px: float | None = None,
) -> ImagePatch:
    """Gradient and smoothed grey of an image inside a box.

    Args:
        image: (h, w, 3) uint8 RGB.
        box: (x0, y0, x1, y1) px, x1 and y1 excluded; cut to the image.
        config: how it is smoothed, sharpened and decoded; None for the defaults.
        lens_blur_px: standard deviation of the camera's own blur, 0 or more, by which light is sharpened; None to ask
            the image.
    """
    config = SearchConfig() if config is None else config
    height, width = image.shape[:2]
    x0, y0 = min(max(box[0], 0), width - 2), min(max(box[1], 0), height - 2)
    x1, y1 = max(min(box[2], width), x0 + 2), max(min(box[3], height), y0 + 2)
    # Copied first, as OpenCV takes three times as long over an image whose rows do not follow each other.
    grey = cv2.cvtColor(np.ascontiguousarray(image[y0:y1, x0:x1]), cv2.COLOR_RGB2GRAY)
    light = np.asarray(cv2.LUT(grey, _linear_light(config.gamma)), np.float32)
    smooth, smooth_light = (_smoothed(each, config.blur_px) for each in (grey.astype(np.float32), light))
    if config.sharpening > 0.0:
        # Slopes alone: beside an edge that is sharpened greys overshoot, and it is asked what they are.
        softness_here = softness(edge_blur_px(smooth, config.blur_px) if lens_blur_px is None else lens_blur_px)
        smooth_light = sharpened(smooth_light, config.sharpening * softness_here)
    # A replicated border makes no edge of its own where the part leaves the image.
    gx = cv2.Scharr(smooth_light, cv2.CV_32F, 1, 0, scale=SCHARR_GAIN, borderType=cv2.BORDER_REPLICATE)
    gy = cv2.Scharr(smooth_light, cv2.CV_32F, 0, 1, scale=SCHARR_GAIN, borderType=cv2.BORDER_REPLICATE)
    channels = cv2.merge([gx, gy, smooth]).astype(np.float32, copy=False)
    return ImagePatch(channels, (x0, y0), config.gamma, config.blur_px)


def _smoothed(grey: Float32Array, blur_px: float) -> Float32Array:
    """(h, w) behind a Gaussian."""
    # OpenCV takes twice as long over more than five taps.
    taps = (5, 5) if blur_px <= _NARROW_PX else (0, 0)
    return np.asarray(cv2.GaussianBlur(grey, taps, blur_px, borderType=cv2.BORDER_REPLICATE), np.float32)


@lru_cache(maxsize=8)
def _linear_light(gamma: float) -> Float32Array:
    """(256,) of each grey level, from 0 to 255."""
    table: Float32Array = (255.0 * (np.arange(256) / 255.0) ** gamma).astype(np.float32)
    return table


@lru_cache(maxsize=8)
def slopes_of_encoding(gamma: float) -> Float32Array:
    """(257,) grey levels per level of light at each grey level, see `edge_search_kernel.at_grey`."""
    grey = np.clip(np.arange(257.0), _DARK, 255.0) / 255.0
    table: Float32Array = (grey ** (1.0 - gamma) / gamma).astype(np.float32)
    return table


def half_widths(blur_px: FloatArray) -> IntArray:
    """(n,) px to either side over which slopes are averaged where motion smears an edge over blur_px (n,).

    A smeared step has the same slope all over the smear, and the steepest place is anywhere in it; its mean over that
    width is highest in the middle.
    """
    return np.minimum(0.5 * np.abs(blur_px), _WIDEST_PX).astype(np.int64)


def search_along_normals(
    patch: ImagePatch,
    points: FloatArray,
    normals: FloatArray,
    reach_px: int,
    config: SearchConfig,
    blur_px: FloatArray | None = None,
) -> Candidates:
    """The strongest image edges within `reach_px` of each point along its normal.

    Args:
        points: (n, 2) px, full image.
        normals: (n, 2) unit.
        blur_px: (n,) over which motion smears edges along the normals, see `half_widths`; None for not at all.

    Returns:
        Candidates, the best of each point first, with m = `config.max_candidates`, or fewer where the reach is short.
    """
    # A short search has few peaks; carrying empty candidates through the solver would cost as much as full ones.
    count = min(config.max_candidates, 1 + reach_px // 2)
    found = np.zeros((5, len(points), count))
    halves = np.zeros(len(points), np.int64) if blur_px is None else half_widths(blur_px)
    encoding = slopes_of_encoding(patch.gamma)
    strongest_peaks(
        patch.channels,
        *patch.origin,
        plain(points),
        plain(normals),
        reach_px,
        halves,
        config.contrast_in(patch),
        encoding,
        found,
    )
    return Candidates(*found)
