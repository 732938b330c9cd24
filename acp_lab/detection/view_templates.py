"""What the part's edges look like from all around: views, and sparse templates made of them.

A view keeps 3D edge samples that show from one direction; a template is a view turned in the image plane, as a few
edge points with quantised directions (S. Hinterstoisser et al., "Gradient response maps for real-time detection of
textureless objects", PAMI 2012, section 3.2). Views are stored with the prepared part; templates follow in no time.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from acp_lab.cad.edges import EdgeSamples
from acp_lab.cad.part import Part
from acp_lab.control_points.view_regions import choose_region
from acp_lab.detection.config import SEARCH_SAMPLES, DetectionConfig
from acp_lab.detection.edge_maps import direction_bins
from acp_lab.generator.base import RigidGenerator, VisibleSamples
from acp_lab.geometry.arrays import BoolArray, Float32Array, FloatArray, Int32Array, IntArray
from acp_lab.geometry.icosphere import icosphere
from acp_lab.geometry.pose import make_pose

SCAN_BINS = 8
STEP_PX = 4
"""Of the places that are scanned; the spread of the responses reaches over it."""
VIEW_DISTANCE = 5.0
"""In diameters, as that of the stored visibility."""
SUBDIVISIONS = 3
"""Of the icosphere of all views: 642."""
_SAME_DIRECTION = 1.0 - 1e-6
_FEWEST_SAMPLES = 16
CELL_DIAMETERS = 0.05
_INNER_LATER = 2.0
"""Silhouettes show nearly always, creases on metal often not: of a direction, they come first."""


@dataclass(frozen=True, eq=False)
class Views:
    """v views of a part.

    Attributes:
        directions_obj: (v, 3) unit, from the box centre to the eye.
        samples: (v, k) rows of the part's edge samples that show.
        points_obj, tangents_obj: (v, k, 3) mm about the box centre, samples that show; float32.
        counts: (v,) how many of the k.
        lengths: (v,) length of the distinct visible edges in diameters.
    """

    directions_obj: FloatArray
    samples: IntArray
    points_obj: Float32Array
    tangents_obj: Float32Array
    counts: IntArray
    lengths: FloatArray

    def __len__(self) -> int:
        return len(self.counts)

    @cached_property
    def rotations(self) -> FloatArray:
        """(v, 3, 3) object to camera, the optical axis through the box centre."""
        return np.array([looking_along(-direction) for direction in self.directions_obj])

    def take(self, rows: IntArray | BoolArray) -> Views:
        """Some of them."""
        return Views(
            self.directions_obj[rows],
            self.samples[rows],
            self.points_obj[rows],
            self.tangents_obj[rows],
            self.counts[rows],
            self.lengths[rows],
        )

    def subdivided(self, subdivisions: int) -> Views:
        """Those of a coarser icosphere: 2 subdivisions for 162, 3 for 642."""
        corners = icosphere(subdivisions)
        return self.take((self.directions_obj @ corners.T).max(1) > _SAME_DIRECTION)

    def nearest(self, eyes_obj: FloatArray) -> IntArray:
        """(n,) the views nearest to directions (n, 3) from the box centre."""
        return np.argmax(eyes_obj @ self.directions_obj.T, axis=1)


@dataclass(frozen=True, eq=False)
class Templates:
    """t templates: views turned in the image plane, at `scan_px` per diameter.

    Attributes:
        views: (t,) number of the view; turns_rad: (t,) about the optical axis.
        offsets: (t, f, 2) int px (x, y) of the features from the projected box centre.
        bins: (t, f) quantised direction of the edge; counts: (t,) features in use.
        gains: (t,) what the mean response is multiplied by.
    """

    views: IntArray
    turns_rad: FloatArray
    offsets: IntArray
    bins: IntArray
    counts: IntArray
    gains: Float32Array

    def __len__(self) -> int:
        return len(self.views)

    @cached_property
    def reads(self) -> tuple[Int32Array, Int32Array]:
        """What the scan reads for each feature: (t, f) the plane of its direction and of its phase within a step, and
        (t, f, 2) how many steps (x, y) away. It takes milliseconds, so it is not left to a frame."""
        steps, phase = np.divmod(self.offsets, STEP_PX)
        plane = (self.bins * STEP_PX + phase[..., 1]) * STEP_PX + phase[..., 0]
        return plane.astype(np.int32), steps.astype(np.int32)

    def take(self, rows: IntArray | BoolArray) -> Templates:
        """Some of them; the numbers of their views stay."""
        taken = Templates(
            self.views[rows],
            self.turns_rad[rows],
            self.offsets[rows],
            self.bins[rows],
            self.counts[rows],
            self.gains[rows],
        )
        plane, steps = self.reads
        taken.__dict__["reads"] = plane[rows], steps[rows]
        return taken


def make_views(part: Part, generator: RigidGenerator) -> Views:
    """Views from the vertices of an icosphere; those that show next to nothing are left out.

    They are chosen in less than a second.
    """
    directions = icosphere(SUBDIVISIONS)
    kept, samples, counts, lengths = [], [], [], []
    edges: EdgeSamples = generator.edges
    for direction in directions:
        rotation = looking_along(-direction)
        shift = np.array([0.0, 0.0, VIEW_DISTANCE * part.diameter])
        pose = make_pose(rotation, shift - rotation @ part.box_centre)
        region = choose_region(VIEW_DISTANCE * part.diameter * direction, 0.5 * part.box_size)
        visible = generator.visible(pose, region, len(edges))
        ids = visible.ids
        if len(ids) < _FEWEST_SAMPLES:
            continue
        ids = ids[_spread_of_view(edges, visible, rotation, part)]
        kept.append(direction)
        samples.append(ids[np.arange(SEARCH_SAMPLES) % len(ids)])
        counts.append(min(len(ids), SEARCH_SAMPLES))
        lengths.append(len(ids) * CELL_DIAMETERS)
    rows = np.array(samples, np.int64).reshape(-1, SEARCH_SAMPLES)
    return views_of(
        part, edges, np.array(kept).reshape(-1, 3), rows, np.array(counts, np.int64), np.array(lengths, np.float64)
    )


def views_of(
    part: Part, edges: EdgeSamples, directions_obj: FloatArray, samples: IntArray, counts: IntArray, lengths: FloatArray
) -> Views:
    """Views from what is stored of them, see `Views`."""
    points = (edges.points_obj[samples] - part.box_centre).astype(np.float32)
    return Views(directions_obj, samples, points, edges.tangents_obj[samples].astype(np.float32), counts, lengths)


def make_templates(views: Views, diameter: float, config: DetectionConfig) -> Templates:
    """Every view, turned in the image plane by all turns."""
    count = np.minimum(views.counts, config.features)
    points = views.points_obj[:, : config.features] @ views.rotations.transpose(0, 2, 1)
    tangents = views.tangents_obj[:, : config.features] @ views.rotations.transpose(0, 2, 1)
    depth = points[..., 2:] + VIEW_DISTANCE * diameter
    flat = points[..., :2] / depth
    along = tangents[..., :2] - flat * tangents[..., 2:]
    flat = flat * VIEW_DISTANCE * config.scan_px
    turns = 2.0 * np.pi * np.arange(config.turns) / config.turns
    cosine, sine = np.cos(turns), np.sin(turns)
    matrices = np.stack([np.stack([cosine, -sine], -1), np.stack([sine, cosine], -1)], -2)  # (turns, 2, 2)
    turned = np.einsum("rij,vfj->vrfi", matrices, flat)
    bins = direction_bins(along[:, None], SCAN_BINS, turns[:, None])
    gains = views.lengths**config.length_power / count
    number = len(views.counts) * config.turns
    return Templates(
        np.repeat(np.arange(len(views.counts)), config.turns),
        np.tile(turns, len(views.counts)),
        np.rint(turned).astype(np.int64).reshape(number, config.features, 2),
        bins.reshape(number, config.features),
        np.repeat(count, config.turns),
        np.repeat(gains, config.turns).astype(np.float32),
    )


def spread(points: FloatArray, tangents: FloatArray, outline: BoolArray, cell_px: float) -> IntArray:
    """Rows of edge points (n, 2), no two of one direction within one cell, and in every prefix directions in balance.

    Parallel edges close together match one edge of the image all at once; without this, views from the side, all
    parallel lines, are found on every cable and rod. A direction counts by the root of its length.
    """
    bins = direction_bins(tangents, SCAN_BINS)
    cells = np.floor((points - points.min(0)) / cell_px).astype(np.int64)
    _, first = np.unique((cells[:, 1] * 100_000 + cells[:, 0]) * SCAN_BINS + bins, return_index=True)
    rows = np.sort(first)
    mine = bins[rows]
    by_bin = np.argsort(mine, kind="stable")
    counts = np.bincount(mine, minlength=SCAN_BINS)
    rank = np.empty(len(rows))
    rank[by_bin] = np.arange(len(rows)) - np.repeat(np.cumsum(counts) - counts, counts)
    order = (rank + 0.5) / np.sqrt(counts)[mine]
    order[~outline[rows]] *= _INNER_LATER
    return rows[np.argsort(order, kind="stable")]


def looking_along(direction_obj: FloatArray) -> FloatArray:
    """(3, 3) rotation, object to camera, of a camera that looks along a unit direction (3,)."""
    z_axis = direction_obj
    helper = np.eye(3)[int(np.argmin(np.abs(z_axis)))]
    x_axis = np.cross(helper, z_axis)
    x_axis /= np.linalg.norm(x_axis)
    return np.stack([x_axis, np.cross(z_axis, x_axis), z_axis])


def _spread_of_view(edges: EdgeSamples, visible: VisibleSamples, rotation: FloatArray, part: Part) -> IntArray:
    """`spread` of samples seen from VIEW_DISTANCE; lengths in diameters."""
    points = (edges.points_obj[visible.ids] - part.box_centre) @ rotation.T
    along = edges.tangents_obj[visible.ids] @ rotation.T
    distance = points[:, 2:] + VIEW_DISTANCE * part.diameter
    flat = points[:, :2] / distance
    return spread(flat * VIEW_DISTANCE, along[:, :2] - flat * along[:, 2:], visible.outline, CELL_DIAMETERS)
