"""From an image to its edge pixels: grey, blur, gradients, Canny with thresholds taken from the image.

Convention: images are RGB or grey uint8, edge maps are bool (h, w), True on an edge; gradients are Sobel
sums, 8 times the grey levels per px. Both automatic thresholds look at the *gradient*: the popular rules on
grey levels (two thirds of the median, Otsu's split of the histogram) call everything an edge on a dark
background and nothing on a bright one, and metal parts give both.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from acp_lab.errors import GeometryError
from acp_lab.geometry.arrays import BoolArray, ByteImage, Float32Array

_LEAST_HIGH = 40.0
"""An edge of 5 grey levels per px: below it lie noise and compression."""
_LOW_SHARE = 0.4
"""Canny's own ratio of the thresholds, 2 or 3 to 1."""
_NOISE_MULTIPLE = 6.0


@dataclass(frozen=True)
class CannyConfig:
    """blur_sigma: px of the Gaussian, 0 for none; rule: where the two thresholds come from.

    "otsu": the split of the gradient's histogram that separates flat from edge best; follows the contrast.
    "median": a multiple of the median gradient, a measure of the noise; keeps faint edges of clean images.
    """

    blur_sigma: float = 1.0
    rule: Literal["otsu", "median"] = "otsu"


@dataclass(frozen=True)
class Thresholds:
    """Canny's hysteresis on the gradient's length: edges start above high and go on above low."""

    low: float
    high: float

    def __post_init__(self) -> None:
        if not 0.0 <= self.low <= self.high < math.inf:
            raise GeometryError(f"Canny thresholds {self.low:g}, {self.high:g}: need 0 <= low <= high")


def to_grey(image: ByteImage) -> ByteImage:
    """Grey (h, w) uint8 of an RGB image (h, w, 3), or of one that is grey already.

    Raises GeometryError for other shapes and types.
    """
    if image.dtype != np.uint8 or image.size == 0:
        raise GeometryError(f"image of {image.dtype} {image.shape}: give uint8 pixels (h, w) or (h, w, 3)")
    if image.ndim == 2:
        return image
    if image.ndim == 3 and image.shape[2] == 3:
        return cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.uint8, copy=False)
    raise GeometryError(f"image of shape {image.shape}: give uint8 pixels (h, w) or RGB (h, w, 3)")


def blur(image: ByteImage, sigma: float) -> ByteImage:
    """The image after a Gaussian of sigma px; sigma 0 returns it unchanged."""
    if sigma <= 0.0:
        return image
    # cv2's own choice of the kernel's size cuts uint8 images at 3 sigma, which is enough here.
    return cv2.GaussianBlur(image, (0, 0), sigma).astype(np.uint8, copy=False)


def otsu_thresholds(gradient: Float32Array) -> Thresholds:
    """Thresholds from gradient lengths (h, w): high is Otsu's split of their histogram, low 0.4 of it."""
    # 8 bits with the strongest thousandth cut off: a few glints must not set the scale of the histogram.
    top = max(float(np.quantile(_sparse(gradient), 0.999)), _LEAST_HIGH)
    levels = np.minimum(gradient * (255.0 / top), 255.0).astype(np.uint8)
    level, _ = cv2.threshold(levels, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    return _hysteresis((level + 0.5) * top / 255.0)


def median_thresholds(gradient: Float32Array) -> Thresholds:
    """Thresholds from gradient lengths (h, w): high is 6 noise deviations, low 0.4 of it.

    Most pixels show no edge, so the median gradient measures noise: 1.177 standard deviations (Rayleigh).
    """
    deviation = float(np.median(_sparse(gradient))) / math.sqrt(2.0 * math.log(2.0))
    return _hysteresis(_NOISE_MULTIPLE * deviation)


def canny(image: ByteImage, config: CannyConfig = CannyConfig()) -> BoolArray:
    """Edge pixels (h, w) bool, one px wide, of an image (h, w) or (h, w, 3), with automatic thresholds.

    Example:
        >>> image = np.zeros((40, 40), np.uint8)
        >>> image[10:30, 10:30] = 200
        >>> edges = canny(image)
        >>> edges.dtype, bool(edges[20, 9:12].any()), bool(edges[20, 20])
        (dtype('bool'), True, False)
    """
    dx, dy = _gradients(image, config.blur_sigma)
    gradient = cv2.magnitude(dx.astype(np.float32), dy.astype(np.float32)).astype(np.float32, copy=False)
    thresholds = (otsu_thresholds if config.rule == "otsu" else median_thresholds)(gradient)
    return cv2.Canny(dx, dy, thresholds.low, thresholds.high, L2gradient=True) > 0


def canny_at(image: ByteImage, thresholds: Thresholds, blur_sigma: float = 1.0) -> BoolArray:
    """Edge pixels (h, w) bool of an image (h, w) or (h, w, 3), with given thresholds."""
    dx, dy = _gradients(image, blur_sigma)
    return cv2.Canny(dx, dy, thresholds.low, thresholds.high, L2gradient=True) > 0


def _gradients(image: ByteImage, sigma: float) -> tuple[np.ndarray, np.ndarray]:
    """Sobel gradients, int16, x then y: as cv2.Canny would compute them; the thresholds need them, too."""
    smooth = blur(to_grey(image), sigma)
    # Without a replicated border the frame of the image is an edge.
    border = cv2.BORDER_REPLICATE
    return (
        cv2.Sobel(smooth, cv2.CV_16S, 1, 0, borderType=border),
        cv2.Sobel(smooth, cv2.CV_16S, 0, 1, borderType=border),
    )


def _sparse(gradient: Float32Array) -> Float32Array:
    # One pixel in nine tells a quantile as well as all, and sorting was most of the time.
    return gradient[::3, ::3]


def _hysteresis(high: float) -> Thresholds:
    high = max(high, _LEAST_HIGH)
    return Thresholds(_LOW_SHARE * high, high)
