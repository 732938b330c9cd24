"""What an image says for and against a pose, and the score that follows from it.

Asked in both directions: how much of the part's generated edges the image shows, and how much of the image's edges
inside the part's silhouette the part explains. On metal, whose reflections no pose explains, the second says little
(see `WEIGHTS`).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from acp_lab.cad.part import Part, box_corners
from acp_lab.cad.raycast import RayCaster
from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.control_points.view_regions import choose_region
from acp_lab.detection.edge_maps import direction_bins
from acp_lab.detection.pose_search import MAP_BINS, UNITS, ZERO_LEVEL, DistanceMaps
from acp_lab.detection.view_templates import CELL_DIAMETERS, spread
from acp_lab.detection.work import Steps
from acp_lab.generator.base import RigidGenerator, project_samples
from acp_lab.geometry.arrays import BoolArray, FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import transform

_REACH_PX = 4.0
_EXPLAINED_PX = 3
_BAND_PX = 7
_COLOUR_LEVELS = 8


@dataclass(frozen=True)
class Evidence:
    """What an image says of a pose.

    Attributes:
        outline, inner: in [0, 1], share of the generated silhouettes and of the other edges that the image shows.
        over_chance: their mean, less what edges at random places would show there.
        explained: in [0, 1], share of the image's edges inside the silhouette that generated edges explain.
        margin: in [0, 1], how well colours tell a band inside the silhouette from one outside it.
        length: of the distinct generated edges, in diameters.
        size_px: the part's diameter in the image.
    """

    outline: float
    inner: float
    over_chance: float
    explained: float
    margin: float
    length: float
    size_px: float

    @property
    def features(self) -> FloatArray:
        """(8,) what the score is made of."""
        return np.array(
            [
                1.0,
                self.outline,
                self.inner,
                self.over_chance,
                self.explained,
                self.margin,
                np.log(max(self.length, 0.1)),
                np.log(self.size_px / 100.0),
            ]
        )

    @property
    def log_odds(self) -> float:
        """For the pose against nothing, see WEIGHTS; between -30 and 30."""
        return float(np.clip(self.features @ WEIGHTS, -30.0, 30.0))

    @property
    def score(self) -> float:
        """In [0, 1]: the probability that the pose is right, if it is the only one in question."""
        return float(1.0 / (1.0 + np.exp(-self.log_odds)))


WEIGHTS = np.array([-24.8, 9.95, 0.83, 16.27, -2.3, 6.74, 5.45, 1.43])
"""Of a logistic regression of right poses (ADD below 10%) against wrong ones; see docs/detection.md."""


class Witness:
    """Looks at poses of one part in one image."""

    def __init__(self, part: Part, generator: RigidGenerator, caster: RayCaster, maps: DistanceMaps) -> None:
        self._part, self._generator, self._caster, self._maps = part, generator, caster, maps
        self._corners_obj = box_corners(part)

    def making_maps(self, cam_T_obj: FloatArray) -> Steps[None]:
        """Make the maps that `look` reads at a pose (4, 4), in slices, if they are not there."""
        depth = transform(cam_T_obj, self._part.box_centre)[2:]
        if depth[0] > self._part.radius:
            yield from self._maps.making(int(self._maps.level(depth)[0]), _REACH_PX)

    def look(self, cam_T_obj: FloatArray) -> Evidence | None:
        """The evidence for a pose (4, 4); None where the part is behind the camera or hardly in the image."""
        part, maps = self._part, self._maps
        centre = transform(cam_T_obj, part.box_centre)
        if centre[2] <= part.radius:
            return None
        level = int(maps.level(centre[2:])[0])
        _, distance = maps.scaled(level)
        height, width = distance.shape[1:]
        fx, fy, cx, cy = maps.intrinsics(level)
        camera = Camera(width, height, fx, fy, cx, cy)
        box = self._box(camera, cam_T_obj)
        if box is None:
            return None
        eye = eye_position(cam_T_obj) - part.box_centre
        visible = self._generator.visible(
            cam_T_obj, choose_region(eye, 0.5 * part.box_size), len(self._generator.edges)
        )
        if len(visible.ids) < 12:
            return None
        edges = project_samples(self._generator.edges, visible, cam_T_obj, camera)
        rows = spread(edges.points, edges.tangents, edges.outline, CELL_DIAMETERS * maps.search_px)
        column, line = (np.floor(edges.points[:, k] + 0.5).astype(np.int64) for k in (0, 1))
        seen = (column >= 0) & (line >= 0) & (column < width) & (line < height)
        rows = rows[seen[rows]]
        if len(rows) < 12:
            return None
        at = (direction_bins(edges.tangents[rows], MAP_BINS), line[rows], column[rows])
        near = np.maximum(1.0 - distance[at] / _REACH_PX, 0.0)
        above_usual = (maps.map(level, _REACH_PX)[at].astype(np.float64) - ZERO_LEVEL) / UNITS
        outline = edges.outline[rows]

        x0, y0, x1, y1 = box
        mask = self._silhouette(cam_T_obj, camera, box)
        generated = np.zeros(mask.shape, np.uint8)
        inside = seen & (column >= x0) & (column < x1) & (line >= y0) & (line < y1)
        generated[line[inside] - y0, column[inside] - x0] = 1
        around = cv2.dilate(generated, np.ones((2 * _EXPLAINED_PX + 1,) * 2, np.uint8)) > 0
        image_edges = maps.any_edge(level)[y0:y1, x0:x1] & (mask | around)
        found = float((image_edges & around).sum())
        total = float(image_edges.sum())
        return Evidence(
            outline=_mean(near[outline]),
            inner=_mean(near[~outline]),
            over_chance=float(above_usual.mean()),
            explained=found / total if total else 0.0,
            margin=_colour_margin(maps.image(level)[y0:y1, x0:x1], mask),
            length=CELL_DIAMETERS * len(rows),
            size_px=part.diameter * maps.focal_px / centre[2],
        )

    def _box(self, camera: Camera, cam_T_obj: FloatArray) -> tuple[int, int, int, int] | None:
        corners = camera.project(self._corners(cam_T_obj))
        low = np.clip(np.floor(corners.min(0)).astype(int) - 2 - _BAND_PX, 0, (camera.width, camera.height))
        high = np.clip(np.ceil(corners.max(0)).astype(int) + 3 + _BAND_PX, 0, (camera.width, camera.height))
        if (high - low).min() < 8:
            return None
        return int(low[0]), int(low[1]), int(high[0]), int(high[1])

    def _corners(self, cam_T_obj: FloatArray) -> FloatArray:
        corners = transform(cam_T_obj, self._corners_obj)
        corners[:, 2] = np.maximum(corners[:, 2], 1.0)
        return corners

    def _silhouette(self, cam_T_obj: FloatArray, camera: Camera, box: tuple[int, int, int, int]) -> BoolArray:
        """The part's mask in a box, by a ray for every other pixel of the map."""
        x0, y0, x1, y1 = box
        x, y = np.arange(x0, x1, 2, dtype=np.float64), np.arange(y0, y1, 2, dtype=np.float64)
        # Directions of pixels are linear in x and y.
        first, right, down = camera.rays(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])) @ cam_T_obj[:3, :3]
        rays = (first + y[:, None, None] * (down - first) + x[None, :, None] * (right - first)).reshape(-1, 3)
        eye = np.broadcast_to(eye_position(cam_T_obj), rays.shape)
        hit = self._caster.occluded(eye, rays, 1e9).reshape(len(y), len(x)).astype(np.uint8)
        return cv2.resize(hit, (x1 - x0, y1 - y0), interpolation=cv2.INTER_NEAREST) > 0


def _mean(values: np.ndarray) -> float:
    return float(values.mean()) if len(values) else 0.0


def _colour_margin(image: np.ndarray, mask: BoolArray) -> float:
    """How far the colour histograms of a band inside a mask and of one outside it are from each other, in [0, 1]."""
    body = mask.astype(np.uint8)
    kernel = np.ones((2 * _BAND_PX + 1,) * 2, np.uint8)
    inner = mask & (cv2.erode(body, np.ones((3, 3), np.uint8)) > 0)
    outer = (cv2.dilate(body, kernel) > 0) & (cv2.dilate(body, np.ones((3, 3), np.uint8)) == 0)
    if inner.sum() < 20 or outer.sum() < 20:
        return 0.0
    step = 256 // _COLOUR_LEVELS
    levels = image.astype(np.int64) // step
    bins = (levels[..., 0] * _COLOUR_LEVELS + levels[..., 1]) * _COLOUR_LEVELS + levels[..., 2]
    first, second = (
        np.bincount(bins[where], minlength=_COLOUR_LEVELS**3).astype(np.float64) for where in (inner, outer)
    )
    overlap = np.sqrt(first / first.sum() * second / second.sum()).sum()
    return float(np.sqrt(max(0.0, 1.0 - overlap)))
