"""Edges of an image by direction, and how near each pixel is to one: what templates and poses are compared with.

Convention: directions are those of edges, not of gradients, unsigned, in bins of pi / bins around k pi / bins from x
towards y. Metal reflects what it likes, so the sign of an edge's contrast says nothing.
"""

from __future__ import annotations

import cv2
import numpy as np

from acp_lab.detection.work import Steps
from acp_lab.geometry.arrays import ByteImage, Float32Array, FloatArray, IntArray
from acp_lab.imaging.edge_search import SCHARR_GAIN

LEAST_GRADIENT = 5.0
"""Grey levels per px; below lie noise and brushed surfaces."""
_BLUR_PX = 0.8
GRADIENT_WORK, THIN_WORK, LAYER_WORK = 0.02, 0.008, 0.003
"""Of a pixel, see `work`."""


def without_specks(image: ByteImage) -> ByteImage:
    """RGB (h, w, 3) after a 5 x 5 median: noise goes, edges of bodies stay."""
    return cv2.medianBlur(np.ascontiguousarray(image), 5).astype(np.uint8, copy=False)


def resized(image: ByteImage, scale: float) -> ByteImage:
    """The image at a scale; areas are averaged when it shrinks."""
    if scale == 1.0:
        return image
    size = (max(16, round(image.shape[1] * scale)), max(16, round(image.shape[0] * scale)))
    way = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_LINEAR
    return cv2.resize(image, size, interpolation=way).astype(np.uint8, copy=False)


def gradients(image: ByteImage) -> tuple[Float32Array, Float32Array]:
    """(h, w) grey levels per px, x and y, of the colour channel with the strongest gradient."""
    smooth = cv2.GaussianBlur(image, (0, 0), _BLUR_PX, borderType=cv2.BORDER_REPLICATE)
    border = cv2.BORDER_REPLICATE
    gx = cv2.Scharr(smooth, cv2.CV_32F, 1, 0, scale=SCHARR_GAIN, borderType=border)
    gy = cv2.Scharr(smooth, cv2.CV_32F, 0, 1, scale=SCHARR_GAIN, borderType=border)
    best_x: Float32Array = np.ascontiguousarray(gx[..., 0], np.float32)
    best_y: Float32Array = np.ascontiguousarray(gy[..., 0], np.float32)
    best = best_x * best_x + best_y * best_y
    for channel in (1, 2):
        x, y = gx[..., channel], gy[..., channel]
        square = x * x + y * y
        stronger = square > best
        np.copyto(best_x, x, where=stronger)
        np.copyto(best_y, y, where=stronger)
        np.copyto(best, square, where=stronger)
    return best_x, best_y


def direction_bins(tangents: FloatArray, bins: int, turned_rad: FloatArray | float = 0.0) -> IntArray:
    """(...) the bin of edges with directions (..., 2), after a turn in the image plane."""
    angle = np.arctan2(tangents[..., 1], tangents[..., 0]) + turned_rad
    return np.floor(angle / np.pi * bins + 0.5).astype(np.int64) % bins


def oriented_edges(image: ByteImage, bins: int) -> Steps[ByteImage]:
    """(bins, h, w) uint8: 1 where an edge of that direction runs, one px wide."""
    from acp_lab.detection.kernels import thin_oriented

    gx, gy = gradients(image)
    yield GRADIENT_WORK * gx.size
    edges = np.zeros((bins, *gx.shape), np.uint8)
    thin_oriented(gx, gy, np.float32(LEAST_GRADIENT), np.uint8(1), edges)
    yield THIN_WORK * gx.size
    return edges


def distances(edges: ByteImage, most_px: float) -> Steps[Float32Array]:
    """(bins, h, w) px to the nearest edge of each direction, at most `most_px`."""
    found = np.empty(edges.shape, np.float32)
    for layer, out in zip(edges, found, strict=True):
        cv2.distanceTransform(1 - layer, cv2.DIST_L2, 3, dst=out)
        np.minimum(out, np.float32(most_px), out=out)
        yield LAYER_WORK * layer.size
    return found
