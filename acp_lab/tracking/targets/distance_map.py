"""The target of paper IV-B: a frame's edge map and its distance map, where e(I) looks up how far an edge point is off.

Blur, denoise, Canny with automatic thresholds, exact Euclidean distance transform, all in a crop around the part
(paper: the whole image). Between pixels the map is read bilinearly, and its gradient is that of what is read.

With `orientation_bins` above 1 the edges are sorted by direction into as many maps, and a point looks into the one of
its own direction. (Deviation, off by default: one map attracts an edge point to edges of any direction.)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from acp_lab.imaging.canny import CannyConfig, canny, to_grey
from acp_lab.imaging.distance import distance_map

Denoiser = Literal["none", "median", "bilateral", "nonlocal-means"]


@dataclass(frozen=True)
class TargetConfig:
    """How a frame becomes something to compare edges with.

    Attributes:
        search: "distance-map" (the paper), or "normals": image edges are searched along each edge point's normal
            instead, as `--method acp` does; the other settings then do not apply.
        blur_px: standard deviation of the Gaussian before Canny.
        denoise: what takes out noise before the blur.
        thresholds: rule of Canny's automatic thresholds, see `imaging.canny`.
        orientation_bins: 1 for the paper's single map, more for one map per edge direction.
    """

    search: Literal["distance-map", "normals"] = "distance-map"
    blur_px: float = 0.7
    denoise: Denoiser = "none"
    thresholds: Literal["otsu", "median"] = "otsu"
    orientation_bins: int = 1


@dataclass(frozen=True)
class Distances:
    """values: (n,) px to the nearest image edge; gradients: (n, 2) by the point's position, of length about 1."""

    values: np.ndarray
    gradients: np.ndarray


@dataclass(frozen=True)
class DistanceTarget:
    """Distance maps of a crop.

    Attributes:
        edges: (h, w) bool, Canny's edge pixels.
        maps: (bins, h, w) float32 px.
        origin: (x, y) of the crop's first pixel in the full image.
    """

    edges: np.ndarray
    maps: np.ndarray
    origin: tuple[int, int]

    def distances(self, points: np.ndarray, normals: np.ndarray) -> Distances:
        """Distance and gradient at points (n, 2) px of the full image with edge normals (n, 2).

        Outside the crop the border's value is read, grown by the way to the border, so that a point which left the
        crop is far from everything, and one that is nowhere (NaN) infinitely far.
        """
        height, width = self.edges.shape
        # A point on the vanishing line has no place; it, too, is far from everything.
        x, y = np.nan_to_num(points - self.origin, nan=np.inf, posinf=np.inf, neginf=-np.inf).T
        inside_x = np.minimum(np.maximum(x, 0.0), width - 1.001)
        inside_y = np.minimum(np.maximum(y, 0.0), height - 1.001)
        column, row = inside_x.astype(np.intp), inside_y.astype(np.intp)
        u, v = inside_x - column, inside_y - row
        pixel = (self._layers(normals) * height + row) * width + column
        a, b, c, d = (self.maps.take(pixel + step) for step in (0, 1, width, width + 1))
        top, bottom = a + u * (b - a), c + u * (d - c)
        gradients = np.stack([(1 - v) * (b - a) + v * (d - c), bottom - top], 1)
        outside = np.stack([x - inside_x, y - inside_y], 1)
        way = np.hypot(outside[:, 0], outside[:, 1])
        left = way > 0.0
        with np.errstate(invalid="ignore"):  # infinitely far there is no direction; solvers leave NaN out
            gradients[left] = outside[left] / way[left, None]
        return Distances(top + v * (bottom - top) + way, gradients)

    def _layers(self, normals: np.ndarray) -> np.ndarray:
        bins = len(self.maps)
        if bins == 1:
            return np.zeros(len(normals), np.intp)
        return np.round(_angle(normals[:, 0], normals[:, 1]) * bins / np.pi).astype(np.intp) % bins


def distance_target(image: np.ndarray, box: tuple[int, int, int, int], config: TargetConfig) -> DistanceTarget:
    """Edge map and distance maps of an image (h, w, 3) uint8 RGB inside a box (x0, y0, x1, y1), cut to the image."""
    height, width = image.shape[:2]
    x0, y0 = min(max(box[0], 0), width - 8), min(max(box[1], 0), height - 8)
    x1, y1 = max(min(box[2], width), x0 + 8), max(min(box[3], height), y0 + 8)
    grey = _denoised(to_grey(image[y0:y1, x0:x1]), config.denoise)
    edges = canny(grey, CannyConfig(config.blur_px, config.thresholds))
    if config.orientation_bins == 1:
        return DistanceTarget(edges, distance_map(edges)[None], (x0, y0))
    return DistanceTarget(edges, _maps_by_direction(grey, edges, config), (x0, y0))


def _denoised(grey: np.ndarray, denoise: Denoiser) -> np.ndarray:
    if denoise == "median":
        return cv2.medianBlur(grey, 3).astype(np.uint8, copy=False)
    if denoise == "bilateral":
        return cv2.bilateralFilter(grey, 5, 25.0, 2.0).astype(np.uint8, copy=False)
    if denoise == "nonlocal-means":
        return cv2.fastNlMeansDenoising(grey, None, 7.0, 5, 11).astype(np.uint8, copy=False)
    return grey


def _maps_by_direction(grey: np.ndarray, edges: np.ndarray, config: TargetConfig) -> np.ndarray:
    smooth = cv2.GaussianBlur(grey, (0, 0), max(config.blur_px, 0.3))
    angle = _angle(
        cv2.Sobel(smooth, cv2.CV_32F, 1, 0, borderType=cv2.BORDER_REPLICATE),
        cv2.Sobel(smooth, cv2.CV_32F, 0, 1, borderType=cv2.BORDER_REPLICATE),
    )
    bins = config.orientation_bins
    maps = []
    for layer in range(bins):
        off = np.abs((angle - layer * np.pi / bins + 0.5 * np.pi) % np.pi - 0.5 * np.pi)
        # Each edge is in the two nearest bins: at a border between bins a small turn must not lose it.
        maps.append(distance_map(edges & (off <= np.pi / bins)))
    return np.stack(maps)


def _angle(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Direction of a line in [0, pi): a normal and its opposite are the same."""
    angle: np.ndarray = np.arctan2(y, x) % np.pi
    return angle
