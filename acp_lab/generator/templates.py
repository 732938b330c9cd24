"""View templates: which edge samples are occluded, stored for some 2600 views all around the part.

Which faces are front-facing is computed exactly for each pose; only whether the part occludes a sample is
looked up, at the nearest stored view. That answer changes slowly with the view, so a sparse sphere
suffices. Built in seconds by casting rays; there is nothing to train.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from acp_lab.cad.edges import EdgeSamples, facing, nearly_showing, unoccluded
from acp_lab.cad.part import Part
from acp_lab.cad.raycast import RayCaster
from acp_lab.compiled import kernel
from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.control_points.view_regions import REGION_COUNT
from acp_lab.generator.base import VisibleSamples
from acp_lab.geometry.icosphere import icosphere

SPHERE_SUBDIVISIONS = 4
# Occlusion depends little on distance; stored at one that suits the usual bench camera.
DISTANCE_IN_DIAMETERS = 5.0
RAY_OFFSET_IN_DIAMETERS = 0.002


class TemplateGenerator:
    """t(I) by the nearest stored view.

    Attributes:
        edges: the part's 3D edge samples.
        views_obj: (v, 3) unit directions from the box centre to the eye, object frame.
        packed: (v, ceil(n / 8)) uint8, bit set where nothing hides the sample (numpy.packbits order).
    """

    name = "templates"

    def __init__(self, edges: EdgeSamples, box_centre: np.ndarray, views_obj: np.ndarray, packed: np.ndarray) -> None:
        self.edges = edges
        self.views_obj = np.asarray(views_obj, np.float64)
        self.packed = packed
        self._box_centre = box_centre

    @property
    def regions(self) -> tuple[int, ...]:
        """All view regions: the views lie all around the part."""
        return tuple(range(REGION_COUNT))

    def visible(self, cam_T_obj: np.ndarray, region: int, count: int) -> VisibleSamples:
        """At most `count` samples that show at a pose (4, 4); `region` is ignored."""
        eye_obj = eye_position(cam_T_obj)
        nearest = int(np.argmax(self.views_obj @ (eye_obj - self._box_centre)))
        free = np.unpackbits(self.packed[nearest], count=len(self.edges)).view(bool)
        seen = facing(self.edges, eye_obj)
        ids = np.flatnonzero(seen.shows & free)[:count]
        return VisibleSamples(ids, seen.outline[ids], np.ones(len(ids)))

    def outlines(self, cam_T_obj: np.ndarray, count: int) -> VisibleSamples:
        """The silhouettes among `visible`, at most `count` of them; in one pass, for methods that see nothing else."""
        eye_obj = eye_position(cam_T_obj)
        nearest = int(np.argmax(self.views_obj @ (eye_obj - self._box_centre)))
        normals, offsets = self.edges.planes
        found = np.empty(len(self.edges), np.int64)
        shown = _outlines(self.packed[nearest], normals, offsets, self.edges.convex, eye_obj, count, found)
        return VisibleSamples(found[:shown], np.ones(shown, bool), np.ones(shown))


@kernel("i8(u1[::1], f8[:, :, ::1], f8[:, ::1], b1[::1], f8[::1], i8, i8[::1])")
def _outlines(
    packed: np.ndarray, normals: np.ndarray, offsets: np.ndarray, convex: np.ndarray, eye_obj: np.ndarray, most: int,
    found: np.ndarray,
) -> int:  # fmt: skip
    """Write the ids of free samples of which just one face turns to the eye, see `facing`; returns how many."""
    count = 0
    for i in range(len(convex)):
        if count == most:
            break
        if not (convex[i] and packed[i >> 3] >> (7 - (i & 7)) & 1):
            continue
        first, second = -offsets[0, i], -offsets[1, i]
        for k in range(3):
            first += normals[0, i, k] * eye_obj[k]
            second += normals[1, i, k] * eye_obj[k]
        if (first > 0.0) != (second > 0.0):
            found[count] = i
            count += 1
    return count


def build_templates(
    part: Part,
    edges: EdgeSamples,
    caster: RayCaster,
    progress: Callable[[int, int], None] | None = None,
    subdivisions: int = SPHERE_SUBDIVISIONS,
) -> TemplateGenerator:
    """Cast rays for every view of an icosphere (2562 views by default).

    Args:
        progress: called with (views done, views in all).
    """
    views = icosphere(subdivisions)
    packed = np.zeros((len(views), (len(edges) + 7) // 8), np.uint8)
    for row, direction in enumerate(views):
        eye_obj = part.box_centre + DISTANCE_IN_DIAMETERS * part.diameter * direction
        packed[row] = np.packbits(free_samples(part, edges, caster, eye_obj))
        if progress is not None and (row % 64 == 63 or row + 1 == len(views)):
            progress(row + 1, len(views))
    return TemplateGenerator(edges, part.box_centre, views, packed)


def free_samples(part: Part, edges: EdgeSamples, caster: RayCaster, eye_obj: np.ndarray) -> np.ndarray:
    """(n,) bool: the sample shows from about `eye_obj` (3,) mm and nothing hides it.

    "About": on a curved surface the silhouette moves to other samples within a degree, so those that only
    nearly show are cast too.
    """
    free = np.zeros(len(edges), bool)
    rows = np.flatnonzero(nearly_showing(edges, eye_obj))
    free[rows] = unoccluded(edges.take(rows), caster, eye_obj, RAY_OFFSET_IN_DIAMETERS * part.diameter)
    return free
