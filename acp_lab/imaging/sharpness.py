"""How soft a picture is, and a sharper one: lenses, small pixels and sharpening cameras blur edges by more or by less.

Where an edge is blurred, its neighbours run into it: a bevel's two edges become one, and what lies between a part and
the ground is lost. A Gaussian blur can be taken back to some extent, at the price of noise, by adding what a smoother
copy lacks (unsharp masking). By how much is asked of the picture: a step that is blurred by s px has, behind a Gaussian
of b px, a slope in inverse proportion to sqrt(s^2 + b^2), so its slopes behind two Gaussians tell s. Who sees many
pictures of one camera learns it from them (`tracking.learning.lens_blur`).
(The paper blurs and denoises every picture alike, IV-B; here by how soft it is. See docs/paper-ledger.md.)
"""

from __future__ import annotations

import cv2
import numpy as np

from acp_lab.compiled import kernel
from acp_lab.geometry.arrays import Float32Array

SHARPEN_PX = 1.5
"""Standard deviation of the Gaussian that makes the smoother copy, before its tails are cut off."""
SHARPEN_TAPS = 5
"""Width of that Gaussian, px: OpenCV takes twice as long over any that is wider."""
# Of the second Gaussian, on top of the first.
_COARSER_PX = 2.0
# Of the pixels that are looked at, this share is the steepest: edges, whatever else there is.
_STEEP_SHARE = 0.05
_LEAST_SIDE = 16
# Grey levels per px: what is no steeper is no edge, and the tails of those that are look softer than these.
_FLAT = 0.25
USUAL_BLUR_PX = 1.2
"""Of a picture in focus: by its pixels, the rims of its parts, and edges that lie side by side."""
LEAST_SOFTNESS = 0.5
"""Of a picture as sharp as can be: there is the Gaussian before the gradient to be taken back as well."""
SOFTEST_PX = 2.5
"""A picture counts as no softer: slopes that are wider are no blurred edges."""


def edge_blur_px(smooth: Float32Array, blur_px: float) -> float | None:
    """Standard deviation, px, of the blur of a picture's steepest edges, from 0 to `SOFTEST_PX`.

    None where nothing can be told: of a picture under 16 px wide or high, or one that is flat but for a few pixels.

    smooth: (h, w) float32 grey, behind a Gaussian of `blur_px`, which does not count.
    """
    height, width = smooth.shape
    if min(height, width) < _LEAST_SIDE:
        return None
    # Every second pixel each way tells as much as all; of fewer, upright edges may all lie between two.
    half = np.ascontiguousarray(smooth[::2, ::2])
    coarse = np.asarray(cv2.GaussianBlur(half, (0, 0), 0.5 * _COARSER_PX, borderType=cv2.BORDER_REPLICATE), np.float32)
    # Of the same pixels, as far as all have neighbours.
    fine_slopes = _slopes(smooth, 2, 2, (height - 3, width - 3))
    coarse_slopes = 0.5 * _slopes(coarse, 1, 1, ((height - 2) // 2, (width - 2) // 2))
    place = int((1.0 - _STEEP_SHARE) * fine_slopes.size)
    steep = np.argpartition(fine_slopes, place)[place:]
    if not fine_slopes[steep].min() > _FLAT:
        return None
    ratio = float(np.median(fine_slopes[steep] / np.maximum(coarse_slopes[steep], 1e-6))) ** 2
    if ratio <= 1.0:
        return SOFTEST_PX
    squared = (blur_px**2 + _COARSER_PX**2 - ratio * blur_px**2) / (ratio - 1.0)
    return float(np.sqrt(np.clip(squared, 0.0, SOFTEST_PX**2)))


def _slopes(grey: Float32Array, first: int, step: int, end: tuple[int, int]) -> Float32Array:
    """(k,) of grey (h, w), per px, at every `step`-th pixel each way, from (first, first) to before `end`."""
    rows, columns = ((last - first + step - 1) // step for last in end)
    slopes = np.empty((rows, columns), np.float32)
    _fill_slopes(grey, first, step, slopes)
    return slopes.ravel()


@kernel("void(f4[:, :], i8, i8, f4[:, ::1])")
def _fill_slopes(grey: Float32Array, first: int, step: int, slopes: Float32Array) -> None:
    """Fill slopes (r, c), see `_slopes`."""
    rows, columns = slopes.shape
    for i in range(rows):
        for k in range(columns):
            y, x = first + i * step, first + k * step
            across, along = grey[y, x + 1] - grey[y, x - 1], grey[y + 1, x] - grey[y - 1, x]
            slopes[i, k] = 0.5 * np.sqrt(np.float64(across) * across + np.float64(along) * along)


def softness(blur_px: float | None) -> float:
    """How many times as much as a picture in focus one is to be sharpened whose edges are blurred by `blur_px`.

    What sharpening takes back grows with its amount as what a blur takes away does with its square. None, of whose blur
    nothing is known, counts as in focus; what is softer than `SOFTEST_PX`, as that.
    """
    if blur_px is None:
        return 1.0
    return max((min(blur_px, SOFTEST_PX) / USUAL_BLUR_PX) ** 2, LEAST_SOFTNESS)


def sharpened(grey: Float32Array, amount: float) -> Float32Array:
    """(h, w) float32: `amount` times what a copy behind a Gaussian (`SHARPEN_PX`, `SHARPEN_TAPS`) lacks, added."""
    taps = (SHARPEN_TAPS, SHARPEN_TAPS)
    smoother = cv2.GaussianBlur(grey, taps, SHARPEN_PX, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(cv2.addWeighted(grey, 1.0 + amount, smoother, -amount, 0.0), np.float32)
