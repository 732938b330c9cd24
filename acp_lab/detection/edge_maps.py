"""Edges of an image by direction, and how near each pixel is to one: what templates and poses are compared with.

Convention: directions are those of edges, not of gradients, unsigned, in bins of pi / bins around k pi / bins from x
towards y. Metal reflects what it likes, so the sign of an edge's contrast says nothing.
"""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np

from acp_lab.detection.work import Steps
from acp_lab.geometry.arrays import ByteImage, Float32Array, FloatArray, IntArray
from acp_lab.imaging.edge_search import SCHARR_GAIN

NO_EDGE = 255
"""Where no edge runs, among the bins of directions."""
LEAST_GRADIENT = 5.0
"""Grey levels per px; below lie noise and brushed surfaces."""
_BLUR_PX = 0.8
_BAND_PIXELS, _OVERLAP = 100_000, 4
"""Of the slices in which an image is gone through; rows beside a slice that the filters reach."""
MEDIAN_WORK, BLUR_WORK, GRADIENT_WORK, THIN_WORK = 0.012, 0.009, 0.006, 0.008
DISTANCE_WORK, TRANSPOSE_WORK, LAYER_WORK = 0.009, 0.005, 0.0015
"""Of a pixel, see `work`."""
RESIZE_WORK = 0.0015
"""Of a value that is read or written."""


def without_specks(image: ByteImage) -> ByteImage:
    """RGB (h, w, 3) after a 5 x 5 median: noise goes, edges of bodies stay."""
    return cv2.medianBlur(np.ascontiguousarray(image), 5).astype(np.uint8, copy=False)


def removing_specks(image: ByteImage) -> Steps[ByteImage]:
    """`without_specks`, in slices."""
    clean = np.empty(image.shape, np.uint8)
    for first, last in bands(*image.shape[:2]):
        top = max(first - _OVERLAP, 0)
        clean[first:last] = without_specks(image[top : last + _OVERLAP])[first - top : last - top]
        yield MEDIAN_WORK * (last - first) * image.shape[1]
    return clean


def resized(image: ByteImage, scale: float) -> ByteImage:
    """The image at a scale, areas averaged; halved as often as possible first, which costs next to nothing."""
    if scale == 1.0:
        return image
    size = (max(16, round(image.shape[1] * scale)), max(16, round(image.shape[0] * scale)))
    while scale <= 0.5 and min(image.shape[:2]) >= 2:
        half = (image.shape[1] // 2, image.shape[0] // 2)
        image = cv2.resize(image, half, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)
        scale *= 2.0
    way = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_LINEAR  # without averages templates and evidence find less
    return cv2.resize(image, size, interpolation=way).astype(np.uint8, copy=False)


def direction_bins(tangents: FloatArray, bins: int, turned_rad: FloatArray | float = 0.0) -> IntArray:
    """(...) the bin of edges with directions (..., 2), after a turn in the image plane."""
    angle = np.arctan2(tangents[..., 1], tangents[..., 0]) + turned_rad
    return np.floor(angle / np.pi * bins + 0.5).astype(np.int64) % bins


def oriented_edges(image: ByteImage, bins: int) -> Steps[ByteImage]:
    """(h, w) uint8: the bin of the edge that runs here, one px wide, or NO_EDGE; of the strongest colour channel."""
    from acp_lab.detection.kernels import strongest_gradients, thin_oriented

    height, width = image.shape[:2]
    smooth = np.empty(image.shape, np.uint8)
    for first, last in bands(height, width):
        top = max(first - _OVERLAP, 0)
        band = cv2.GaussianBlur(image[top : last + _OVERLAP], (0, 0), _BLUR_PX, borderType=cv2.BORDER_REPLICATE)
        smooth[first:last] = band[first - top : last - top]
        yield BLUR_WORK * (last - first) * width
    red, green, blue = cv2.split(cv2.copyMakeBorder(smooth, 1, 1, 1, 1, cv2.BORDER_REPLICATE))
    gx, gy = np.empty((height, width), np.float32), np.empty((height, width), np.float32)
    for first, last in bands(height, width):
        strongest_gradients(red, green, blue, np.float32(SCHARR_GAIN), first, last, gx, gy)
        yield GRADIENT_WORK * (last - first) * width
    directions: ByteImage = np.full((height, width), NO_EDGE, np.uint8)
    for first, last in bands(height, width):
        thin_oriented(gx, gy, np.float32(LEAST_GRADIENT), bins, first, last, directions)
        yield THIN_WORK * (last - first) * width
    return directions


def bands(height: int, width: int) -> Iterator[tuple[int, int]]:
    """First and last row of the slices in which an image is gone through."""
    step = max(1, _BAND_PIXELS // max(width, 1))
    for first in range(0, height, step):
        yield first, min(first + step, height)


def distances(directions: ByteImage, bins: int, most_px: float, per_bin_px: float = np.inf) -> Steps[Float32Array]:
    """(bins, h, w) px from each pixel to the nearest edge of each direction, at most `most_px`, which may be 30.

    directions: (h, w) from `oriented_edges`, of at most `kernels.LANES` bins. per_bin_px: an edge one or two bins away
    counts as that much further for each, an edge of any other direction not at all.

    The distance is the sum of steps from pixel to pixel, as in OpenCV's with a mask of 3 x 3, but of all directions in
    one go, in a fraction of the time.
    """
    from acp_lab.detection.kernels import (
        DISTANCE_UNITS,
        LANES,
        distances_from_above,
        distances_from_below,
        distances_in_px,
    )

    height, width = directions.shape
    most = round(most_px * DISTANCE_UNITS)
    # What is touched for the first time takes as long as what is computed: each band is, in its own slice.
    lanes = np.empty((height + 2, width + 2, LANES), np.int16)
    lanes[0] = lanes[-1] = most
    for first, last in bands(height, width):
        lanes[first + 1 : last + 1] = most
        distances_from_above(directions, lanes.reshape(height + 2, -1), first, last)
        yield DISTANCE_WORK * (last - first) * width
    for first, last in reversed(list(bands(height, width))):
        distances_from_below(lanes, first, last)
        yield DISTANCE_WORK * (last - first) * width
    found: Float32Array = np.empty((bins, height, width), np.float32)
    per_bin = np.int32(round(min(per_bin_px, most_px) * DISTANCE_UNITS))
    for first, last in bands(height, bins * width):
        planes = cv2.transpose(lanes[first + 1 : last + 1].reshape(-1, LANES)).reshape(LANES, -1, width + 2)
        distances_in_px(planes, per_bin, first, last, found)
        yield (TRANSPOSE_WORK + LAYER_WORK * bins) * (last - first) * width
    return found
