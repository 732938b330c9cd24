"""From candidates to poses: a pattern search in true perspective on directional distance maps.

The map is that of M. Liu et al., "Fast object localization and pose estimation in heavy clutter for robotic bin
picking", IJRR 2012, section 3: an edge counts by its distance in place and in direction together. It is stored as a
response that fades to zero, less its local mean, as in the scan.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from acp_lab.detection.config import DetectionConfig
from acp_lab.detection.edge_maps import LAYER_WORK, NO_EDGE, RESIZE_WORK, distances, oriented_edges, resized
from acp_lab.detection.view_templates import Views
from acp_lab.detection.work import Steps, finish
from acp_lab.geometry.arrays import BoolArray, ByteImage, Float32Array, FloatArray, IntArray
from acp_lab.geometry.camera import Camera

MAP_BINS = 16
_MAP_STEP = 1.25
"""Ratio of neighbouring maps' scales."""
_MOST_MAP_PIXELS = 400_000
"""In a large image a part far away is searched at a coarser scale than `search_px` asks for: time stays bounded."""
_MOST_PX = 12.0
_PX_PER_BIN = 1.5
"""What an edge turned by one bin is away, in px of the map."""
ZERO_LEVEL = 64
"""Of the 256 levels of a map: what no edge and no surroundings say."""
UNITS = 160.0
"""Levels between no edge and an edge."""
_LOCAL_MEAN_SHARE = 0.7
_LENGTH_POWER = 0.5
_DISTINCT_ROWS, _DISTINCT_WORK = 64, 0.005
"""Poses of a slice; work of a pair that is compared."""


@dataclass(frozen=True)
class Round:
    """A round of the search: reach of the edges (px), first steps (degrees, diameters, share of depth), halvings, and
    the work of a pose, see `work`.
    """

    reach_px: float
    turn_deg: float
    shift_diameters: float
    depth_share: float
    halvings: int
    work: float


ROUNDS = (
    Round(8.0, 6.0, 0.04, 0.05, 2, 50.0),
    Round(4.0, 4.0, 0.02, 0.03, 3, 55.0),
    Round(4.0, 2.0, 0.01, 0.015, 3, 28.0),
)


class DistanceMaps:
    """Directional maps of one image at the scales that are asked for, each made once."""

    def __init__(self, image: ByteImage, camera: Camera, diameter: float, config: DetectionConfig) -> None:
        self._image, self.camera, self._diameter = image, camera, diameter
        self.search_px = config.search_px
        self.focal_px = 0.5 * (camera.fx + camera.fy)
        self._images: dict[int, ByteImage] = {}
        self._edges: dict[int, BoolArray] = {}
        self._distances: dict[int, tuple[tuple[float, float], Float32Array]] = {}
        self._maps: dict[tuple[int, float], ByteImage] = {}

    def level(self, depths: FloatArray) -> IntArray:
        """The number of the map for parts at depths (n,) mm; 0 is the full image."""
        height, width = self._image.shape[:2]
        most = min(1.0, float(np.sqrt(_MOST_MAP_PIXELS / (width * height))))
        scale = np.minimum(self.search_px * depths / (self.focal_px * self._diameter), most)
        return np.rint(np.log(scale) / np.log(_MAP_STEP)).astype(np.int64)

    def scaled(self, level: int) -> tuple[tuple[float, float], Float32Array]:
        """Scale of a level in x and y, which whole pixels make differ a little, and distances (bins, h, w) px by
        direction."""
        finish(self.making_distances(level))
        return self._distances[level]

    def making(self, level: int, reach_px: float) -> Steps[None]:
        """Make the map of a level in slices, if it is not there."""
        yield from self.making_distances(level)
        yield from self._making_map(level, reach_px)

    def making_distances(self, level: int) -> Steps[None]:
        """What `scaled` gives, in slices, if it is not there."""
        if level in self._distances:
            return
        image = self.image(level)
        yield RESIZE_WORK * (self._image.size + image.size)
        directions = yield from oriented_edges(image, MAP_BINS)
        # A direction near that of the edge counts as a little further.
        found = yield from distances(directions, MAP_BINS, _MOST_PX, _PX_PER_BIN)
        self._edges[level] = directions != NO_EDGE
        (height, width), (full_height, full_width) = image.shape[:2], self._image.shape[:2]
        self._distances[level] = (width / full_width, height / full_height), found

    def image(self, level: int) -> ByteImage:
        """(h, w, 3): the image at a level's scale."""
        if level not in self._images:
            self._images[level] = resized(self._image, _MAP_STEP**level)
        return self._images[level]

    def any_edge(self, level: int) -> BoolArray:
        """(h, w): where an edge of any direction runs."""
        self.scaled(level)
        return self._edges[level]

    def map(self, level: int, reach_px: float) -> ByteImage:
        """(bins, h, w) 256 levels: UNITS above ZERO_LEVEL on an edge, less towards the reach, less for edges around."""
        finish(self._making_map(level, reach_px))
        return self._maps[level, reach_px]

    def _making_map(self, level: int, reach_px: float) -> Steps[None]:
        from acp_lab.detection.kernels import nearness

        if (level, reach_px) in self._maps:
            return
        yield from self.making_distances(level)
        _, found = self._distances[level]
        levels, side = np.empty(found.shape, np.uint8), (int(self.search_px), int(self.search_px))
        gain = UNITS / 255.0
        near = np.empty(found.shape[1:], np.uint8)
        for layer, distance in zip(levels, found, strict=True):
            nearness(distance, np.float32(reach_px), near)
            usual = cv2.boxFilter(near, -1, side, borderType=cv2.BORDER_REFLECT)
            cv2.addWeighted(near, gain, usual, -_LOCAL_MEAN_SHARE * gain, ZERO_LEVEL, dst=layer)
            yield 2.0 * LAYER_WORK * layer.size
        self._maps[level, reach_px] = levels

    def intrinsics(self, level: int) -> tuple[float, float, float, float]:
        """fx, fy, cx, cy of a level's camera; pixel centres at integers."""
        (across, down), c = self.scaled(level)[0], self.camera
        return across * c.fx, down * c.fy, across * (c.cx + 0.5) - 0.5, down * (c.cy + 0.5) - 0.5


@dataclass(frozen=True, eq=False)
class Poses:
    """n poses of the part: rotations (n, 3, 3), centres (n, 3) mm of the box centre in the camera, scores (n,)."""

    rotations: Float32Array
    centres: Float32Array
    scores: Float32Array

    def __len__(self) -> int:
        return len(self.scores)

    def take(self, rows: IntArray) -> Poses:
        """Some of them."""
        return Poses(self.rotations[rows], self.centres[rows], self.scores[rows])


def joined(several: Sequence[Poses]) -> Poses:
    """One after the other; at least one."""
    return Poses(
        np.concatenate([poses.rotations for poses in several]),
        np.concatenate([poses.centres for poses in several]),
        np.concatenate([poses.scores for poses in several]),
    )


def search_round(maps: DistanceMaps, views: Views, poses: Poses, diameter: float, how: Round) -> Steps[Poses]:
    """Each pose climbed to a better one nearby; the best first."""
    from acp_lab.detection.kernels import climb

    table = ((np.arange(256) - ZERO_LEVEL) / UNITS).astype(np.float32)
    eyes = -np.einsum("nji,nj->ni", poses.rotations, poses.centres)
    nearest = views.nearest(eyes)
    levels = maps.level(poses.centres[:, 2].astype(np.float64))
    rotations, centres, scores = poses.rotations.copy(), poses.centres.copy(), poses.scores.copy()
    turn = np.float32(np.radians(how.turn_deg))
    shift, away = np.float32(how.shift_diameters * diameter), np.float32(how.depth_share)
    for level in np.unique(levels):
        yield from maps.making(int(level), how.reach_px)
        image = maps.map(int(level), how.reach_px)
        fx, fy, cx, cy = (np.float32(v) for v in maps.intrinsics(int(level)))
        for i in np.flatnonzero(levels == level):
            view = nearest[i]
            scores[i] = climb(
                image,
                fx,
                fy,
                cx,
                cy,
                views.points_obj[view],
                views.tangents_obj[view],
                views.counts[view],
                rotations[i],
                centres[i],
                table,
                turn,
                shift,
                away,
                how.halvings,
            )
            yield how.work
    scores *= (views.lengths[nearest] ** _LENGTH_POWER).astype(np.float32)
    best = np.argsort(-scores, kind="stable")
    return Poses(rotations[best], centres[best], scores[best])


def distinct(poses: Poses, diameter: float, most: int) -> Steps[Poses]:
    """The best of poses that are nearly the same, in their order: within 6% of the diameter and 5 degrees."""
    from acp_lab.detection.kernels import keep_distinct

    kept, count = np.zeros(max(most, 1), np.int64), 0
    near, least_trace = np.float32(0.06 * diameter), np.float32(1.0 + 2.0 * np.cos(np.radians(5.0)))
    for first in range(0, len(poses), _DISTINCT_ROWS):
        last = min(first + _DISTINCT_ROWS, len(poses))
        begin = count
        count = keep_distinct(poses.centres, poses.rotations, near, least_trace, first, last, most, kept, begin)
        yield _DISTINCT_WORK * (last - first) * (begin + 1)
    return poses.take(kept[:count])
