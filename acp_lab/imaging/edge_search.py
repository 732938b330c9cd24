"""Image edges where the generated edges say to look: 1D searches along projected normals.

No edge map of the whole frame is made. The image is cropped to where the part is expected and its
gradient taken once; each generated edge point then reads that gradient along its normal and keeps the
few strongest peaks as candidates. (Deviation from paper IV-B, which takes Canny edges and a distance
transform: a distance map attracts to edges of any direction.)
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from acp_lab.geometry.arrays import ByteImage, Float32Array, FloatArray

# Scharr's kernel sums to 32 per unit slope; dividing makes gradients grey levels per px.
SCHARR_GAIN = 1.0 / 32.0
FLANK_PX = 3


@dataclass(frozen=True)
class SearchConfig:
    """How image edges are searched along normals.

    Attributes:
        blur_px: standard deviation of the Gaussian before the gradient.
        max_candidates: peaks kept per edge point.
        contrast: gradient along the normal, grey levels per px, at which a peak scores one half.
    """

    blur_px: float = 1.0
    max_candidates: int = 6
    contrast: float = 6.0


@dataclass(frozen=True)
class ImagePatch:
    """The part of a frame in which edges are searched.

    Attributes:
        channels: (h, w, 3) float32: gradient x, gradient y (grey levels per px), smoothed grey.
        origin: (x, y) of the patch's first pixel in the full image.
    """

    channels: Float32Array
    origin: tuple[int, int]


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


def image_patch(image: ByteImage, box: tuple[int, int, int, int], blur_px: float) -> ImagePatch:
    """Gradient and smoothed grey of an image inside a box.

    Args:
        image: (h, w, 3) uint8 RGB.
        box: (x0, y0, x1, y1) px, x1 and y1 excluded; cut to the image.
        blur_px: standard deviation of the Gaussian.
    """
    height, width = image.shape[:2]
    x0, y0 = min(max(box[0], 0), width - 2), min(max(box[1], 0), height - 2)
    x1, y1 = max(min(box[2], width), x0 + 2), max(min(box[3], height), y0 + 2)
    grey = cv2.cvtColor(image[y0:y1, x0:x1], cv2.COLOR_RGB2GRAY).astype(np.float32)
    smooth = cv2.GaussianBlur(grey, (0, 0), blur_px, borderType=cv2.BORDER_REPLICATE)
    # A replicated border makes no edge of its own where the part leaves the image.
    gx = cv2.Scharr(smooth, cv2.CV_32F, 1, 0, scale=SCHARR_GAIN, borderType=cv2.BORDER_REPLICATE)
    gy = cv2.Scharr(smooth, cv2.CV_32F, 0, 1, scale=SCHARR_GAIN, borderType=cv2.BORDER_REPLICATE)
    return ImagePatch(cv2.merge([gx, gy, smooth]).astype(np.float32, copy=False), (x0, y0))


def search_along_normals(
    patch: ImagePatch, points: FloatArray, normals: FloatArray, reach_px: int, config: SearchConfig
) -> Candidates:
    """The strongest image edges within `reach_px` of each point along its normal.

    Args:
        points: (n, 2) px, full image; at most 32766, the rows that cv2.remap takes.
        normals: (n, 2) unit.

    Returns:
        Candidates with m = `config.max_candidates`.
    """
    if len(points) == 0:  # cv2.remap refuses empty maps
        none = np.zeros((0, config.max_candidates))
        return Candidates(none, none, none, none, none)
    steps = np.arange(-reach_px - FLANK_PX, reach_px + FLANK_PX + 1, dtype=np.float32)
    start = (points - patch.origin).astype(np.float32)
    direction = normals.astype(np.float32)
    map_x = start[:, :1] + direction[:, :1] * steps
    map_y = start[:, 1:] + direction[:, 1:] * steps
    profile = cv2.remap(patch.channels, map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    gradient_x, gradient_y, grey = cv2.split(profile)
    along = gradient_x * direction[:, :1] + gradient_y * direction[:, 1:]
    square = along * along

    # Peaks are looked for inside the reach only; the flanks beyond it serve the grey levels.
    inner, left, right = (slice(FLANK_PX + k, k - FLANK_PX) for k in (0, -1, 1))
    inside, x, y = square[:, inner], gradient_x[:, inner], gradient_y[:, inner]
    # Contrast, and the squared cosine between gradient and normal.
    score = inside / (inside + config.contrast**2)
    score *= inside / (x * x + y * y + 1e-6)
    score *= (inside > square[:, left]) & (inside >= square[:, right])

    # A short search has few peaks; carrying empty candidates through the solver would cost as much as full ones.
    count = min(config.max_candidates, 1 + reach_px // 2)
    best = np.argpartition(score, -count, axis=1)[:, -count:]
    rows = np.arange(len(points))[:, None]
    column = best + FLANK_PX
    before_peak, peak, after_peak = (np.abs(along[rows, column + k]) for k in (-1, 0, 1))
    curvature = before_peak - 2.0 * peak + after_peak
    shift = 0.5 * (before_peak - after_peak) / np.where(curvature < -1e-6, curvature, -1e-6)
    return Candidates(
        offsets=(best - reach_px + np.clip(shift, -0.5, 0.5)).astype(np.float64),
        scores=score[rows, best].astype(np.float64),
        gradients=along[rows, column].astype(np.float64),
        before=grey[rows, best].astype(np.float64),
        after=grey[rows, best + 2 * FLANK_PX].astype(np.float64),
    )
