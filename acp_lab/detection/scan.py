"""The scan: every template at every place of an image pyramid, the best of them as candidates.

Responses are spread, quantised by direction and laid out so that a template's sum is a sum of contiguous rows, as in
LINE-MOD (Hinterstoisser et al. 2012, sections 3.3 to 3.5), with two changes. A response fades with the distance from
the edge instead of being there or not, and the mean response around it is taken off: on a grid or in brushed grain
every template finds edges everywhere, and only more than the usual says anything.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from acp_lab.detection.config import DetectionConfig
from acp_lab.detection.edge_maps import (
    LAYER_WORK,
    RESIZE_WORK,
    bands,
    distances,
    oriented_edges,
    removing_specks,
    resized,
)
from acp_lab.detection.view_templates import SCAN_BINS, STEP_PX, Templates
from acp_lab.detection.work import Steps
from acp_lab.geometry.arrays import ByteImage, Float32Array, FloatArray, IntArray
from acp_lab.geometry.camera import Camera

GROUPS = 12
"""Neighbouring views share a group; each place keeps the best template of each group."""
_NEIGHBOUR_SHARE = 0.6
_LOCAL_MEAN_SHARE = 0.6
"""Not all of it: the part itself is in its surroundings."""
_UNITS = 100.0
_SLICE_WORK = 2000.0
FEATURE_WORK, PLANE_WORK, PEAK_WORK = 3.5e-5, 0.005, 0.006
"""Of a feature at a place; of a response that is laid out; of a place that is compared with its neighbours."""
LARGEST_SCALE = 1.05
"""A part that appears smaller than scan_px has too few pixels to be told from others."""


@dataclass(frozen=True, eq=False)
class Candidates:
    """n candidates of the scan, the best first.

    scores: (n,). templates: (n,) rows of the templates. centres: (n, 2) px of the full image where the part's centre
    appears. depths: (n,) mm.
    """

    scores: Float32Array
    templates: IntArray
    centres: FloatArray
    depths: FloatArray

    def __len__(self) -> int:
        return len(self.scores)

    def take(self, rows: slice) -> Candidates:
        """Some of them."""
        return Candidates(self.scores[rows], self.templates[rows], self.centres[rows], self.depths[rows])


def depth_levels(depth_mm: tuple[float, float], step: float) -> FloatArray:
    """(n,) mm, the pyramid's levels: equal ratios, none above a step, that cover the nearest to the farthest depth."""
    near, far = depth_mm
    count = max(1, int(np.ceil(np.log(far / near) / np.log(step))))
    return near * (far / near) ** ((np.arange(count) + 0.5) / count)


def scan(
    image: ByteImage,
    camera: Camera,
    diameter: float,
    templates: Templates,
    groups: IntArray,
    depths: FloatArray,
    config: DetectionConfig,
) -> Steps[Candidates]:
    """Candidates of an image (h, w, 3) from all levels.

    groups: (t,) 0 to GROUPS - 1, of each template. depths: (n,) mm, of the levels.
    """
    found = []
    for depth in depths:
        scale = config.scan_px * depth / (0.5 * (camera.fx + camera.fy) * diameter)
        if scale > LARGEST_SCALE:
            continue
        small = resized(image, scale)
        yield RESIZE_WORK * (image.size + small.size)
        ratio = np.array([small.shape[1] / image.shape[1], small.shape[0] / image.shape[0]])
        response = yield from responses(small, config)
        scores, ids, places = yield from _scan_level(response, templates, groups, config)
        # Pixel centres: x of the small image lies at (x + 0.5) / ratio - 0.5 of the full one.
        found.append((scores, ids, (places + 0.5) / ratio - 0.5, np.full(len(scores), depth)))
    if not found:
        return Candidates(np.zeros(0, np.float32), np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros(0))
    scores, ids, centres, depths = (np.concatenate(column) for column in zip(*found, strict=True))
    best = np.argsort(-scores, kind="stable")[: config.starts]
    return Candidates(scores[best], ids[best].astype(np.int64), centres[best], depths[best])


def responses(image: ByteImage, config: DetectionConfig) -> Steps[Float32Array]:
    """(SCAN_BINS, h, w): how much each pixel says for an edge of each direction, less what its surroundings say.

    Half of it is said by the image after a median that takes thin lines out: grids and prints are weaker, bodies are
    not.
    """
    from acp_lab.detection.kernels import spread_by_direction

    height, width = image.shape[:2]
    response: Float32Array = np.zeros((SCAN_BINS, height, width), np.float32)
    clean = yield from removing_specks(image)
    reach_px = np.float32(config.spread_px)
    for seen in (image, clean):
        directions = yield from oriented_edges(seen, SCAN_BINS)
        found = yield from distances(directions, SCAN_BINS, config.spread_px)
        for first, last in bands(height, width):
            spread_by_direction(found, reach_px, np.float32(_NEIGHBOUR_SHARE), first, last, response)
            yield LAYER_WORK * (last - first) * width * SCAN_BINS
    window = (int(config.scan_px), int(config.scan_px))
    for layer in response:
        layer *= 0.5
        layer -= _LOCAL_MEAN_SHARE * cv2.boxFilter(layer, -1, window, borderType=cv2.BORDER_REFLECT)
        yield 2.0 * LAYER_WORK * layer.size
    return response


def _scan_level(
    response: Float32Array, templates: Templates, groups: IntArray, config: DetectionConfig
) -> Steps[tuple[Float32Array, IntArray, FloatArray]]:
    """Scores (n,), templates (n,) and places (n, 2) px of the level's local maxima."""
    from acp_lab.detection.kernels import CHUNK, scan_templates

    _, height, width = response.shape
    step = STEP_PX
    plane_of, steps = templates.reads
    # What is farthest from the middle of a part's box, a long corner say, is read beyond every border.
    margin = int(np.abs(steps).max(initial=0)) + 1
    rows, columns = -(-height // step), -(-width // step)
    high, wide = rows + 2 * margin, columns + 2 * margin
    planes = np.zeros((SCAN_BINS, step, step, high * wide + CHUNK), np.int8)
    padded = np.zeros((high * step, wide * step), np.int8)
    at = margin * step
    for layer, from_layer in zip(planes, response, strict=True):
        padded[at : at + height, at : at + width] = np.rint(_UNITS * from_layer)
        phases = padded.reshape(high, step, wide, step).transpose(1, 3, 0, 2)
        layer[..., : high * wide] = phases.reshape(step, step, high * wide)
        yield PLANE_WORK * padded.size
    planes = planes.reshape(SCAN_BINS * step * step, -1)
    shifts = steps[..., 1] * np.int32(wide) + steps[..., 0]
    first, length = margin * wide, rows * wide
    best: Float32Array = np.full((GROUPS, length), -1e9, np.float32)
    ids = np.zeros((GROUPS, length), np.int32)
    counts, gains = templates.counts, templates.gains
    block = max(1, int(_SLICE_WORK / (FEATURE_WORK * length * counts.max())))
    for begin in range(0, len(counts), block):
        end = min(begin + block, len(counts))
        scan_templates(planes, plane_of, shifts, counts, gains, groups, begin, end, first, length, best, ids)
        yield FEATURE_WORK * length * float(counts[begin:end].sum())

    inside = slice(margin, margin + columns)
    best = (best.reshape(GROUPS, rows, wide)[:, :, inside] / _UNITS).astype(np.float32)
    ids = ids.reshape(GROUPS, rows, wide)[:, :, inside]
    around = np.ones((3, 3), np.uint8)
    peak = np.empty(best.shape, bool)
    for layer, is_peak in zip(best, peak, strict=True):
        np.greater_equal(layer, cv2.dilate(np.ascontiguousarray(layer), around), out=is_peak)
        yield PEAK_WORK * layer.size
    group, row, column = np.nonzero(peak & (best > 0.0))
    places = np.stack([column * step, row * step], 1).astype(np.float64)
    return best[group, row, column], ids[group, row, column].astype(np.int64), places
