"""What a frame shows of a part at a pose: the measurements behind an explanation.

The tracker's state plays no role here. The edges that the CAD model shows at a pose are searched for in the image along
their normals, as the tracker does, but without its memories. So one frame can be measured at several poses: the
tracked, the predicted and the true one.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial import cKDTree

from acp_lab.cad.edges import sample_edges, visible_samples
from acp_lab.cad.part import Part
from acp_lab.cad.raycast import make_caster
from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.generator.base import VisibleSamples, project_samples
from acp_lab.geometry.arrays import BoolArray, ByteImage, FloatArray, IntArray
from acp_lab.geometry.camera import Camera
from acp_lab.imaging.edge_search import AS_THEY_ARE, image_patch, search_along_normals
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.magnification import USUAL_MAGNIFICATION, MagnifyingGlass, appears_px
from acp_lab.tracking.schedule import PixelSchedule

MOST_POINTS = 800
NEAR_PX = 2.0
"""An image edge this near belongs to the edge point."""
FOUND_SCORE = 0.3
"""Score (contrast times direction) from which an image edge counts as found."""
STRONG_SCORE = 0.5
OWN_PX = 3.5
"""An image edge this near to a generated edge may belong to that one."""
NEIGHBOURS = 14
SIDE_PX = 4.0
OTHER_COLOUR = 30.0
"""Two RGB colours this far apart are not the same material in another light."""
COHERENT = 0.8
"""Share of an edge point's neighbours that must be missing too for it to count as hidden."""
MATCH_LIMIT = 0.75
"""Correlation from which two patches count as the same."""
MATCH_LEAD = 0.1
"""Margin in correlation by which a motion must beat the predicted one."""
MATCH_BLUR_PX = 1.5
_HIDING_OFFSET = 0.002  # of the diameter, see cad.edges.unoccluded


@dataclass(frozen=True)
class EdgeEvidence:
    """What an image shows at n visible edge points of a part.

    Attributes:
        sample_ids: (n,) rows of the part's edge samples, the same from frame to frame.
        points: (n, 2) px; normals: (n, 2) unit.
        scores: (n,) in [0, 1] of the best image edge within `NEAR_PX`.
        contrasts: (n,) gradient across the edge there, grey levels per px.
        sides: (n, 2, 3) RGB on both sides of the edge, `SIDE_PX` away.
        rivals: (n,) strong image edges of the same direction within reach that belong to no generated edge.
        outside: share of the part's visible edge points outside the image.
        reach_px: search range along the normals.
    """

    sample_ids: IntArray
    points: FloatArray
    normals: FloatArray
    scores: FloatArray
    contrasts: FloatArray
    sides: FloatArray
    rivals: FloatArray
    outside: float
    reach_px: int

    @property
    def found(self) -> BoolArray:
        """(n,) bool: there is an image edge where the part has one."""
        return self.scores > FOUND_SCORE

    @property
    def found_share(self) -> float:
        """In [0, 1]; 0 where nothing of the part is in the image."""
        return float(self.found.mean()) if len(self.scores) else 0.0

    def found_share_of(self, rows: BoolArray) -> float:
        """Of the points of `rows` (n,) bool alone."""
        return float(self.found[rows].mean()) if rows.any() else 0.0

    def contrast_of(self, rows: BoolArray) -> float:
        """Median gradient across the edges of `rows` (n,) bool, grey levels per px; 0 without any."""
        return float(np.median(self.contrasts[rows])) if rows.any() else 0.0

    @property
    def rivals_per_point(self) -> float:
        """Mean number of rivals."""
        return float(self.rivals.mean()) if len(self.rivals) else 0.0

    def hidden(self, before: EdgeEvidence | None) -> BoolArray:
        """(n,) bool: missing together with nearly all neighbours, although found in an earlier frame.

        Weak contrast leaves gaps as well, and a patterned occluder has edges of its own. The colour decides: where
        an occluder covers an edge, both sides change colour.
        """
        missing = ~self.found
        if len(missing) <= NEIGHBOURS:
            return np.zeros(len(missing), bool)
        gone, known = missing, np.ones(len(missing), bool)
        if before is not None:
            now, then = _common(self.sample_ids, before.sample_ids)
            change = np.linalg.norm(self.sides[now] - before.sides[then], axis=2).min(1)
            gone = missing.copy()
            gone[now] = change > OTHER_COLOUR
            known[now] = before.found[then]
        _, near = cKDTree(self.points).query(self.points, NEIGHBOURS + 1)
        core = gone & known & (gone[near[:, 1:]].mean(1) >= COHERENT)
        # Points at the rim of the region have visible neighbours, too.
        return gone & known & core[near].any(1)


class PartObserver:
    """Searches frames for the edges of one part; made once, because sampling the edges takes time."""

    def __init__(self, part: Part) -> None:
        self.part = part
        self.edges = sample_edges(part)
        self._caster = make_caster(part)

    def measure(self, image: ByteImage, camera: Camera, cam_T_obj: FloatArray) -> EdgeEvidence:
        """What an image (h, w, 3) shows of the part at a pose (4, 4)."""
        offset_mm = _HIDING_OFFSET * self.part.diameter
        seen = np.flatnonzero(visible_samples(self.edges, self._caster, eye_position(cam_T_obj), offset_mm))
        ids = seen[:MOST_POINTS]  # any prefix is spread evenly over the part
        nothing = VisibleSamples(ids, np.zeros(len(ids), bool), np.ones(len(ids)))
        generated = project_samples(self.edges, nothing, cam_T_obj, camera)
        x, y = generated.points.T
        inside = (x >= 0) & (y >= 0) & (x <= camera.width - 1) & (y <= camera.height - 1)  # NaN is not
        outside = 1.0 - float(inside.mean()) if len(inside) else 1.0
        points, tangents = generated.points[inside], generated.tangents[inside]
        normals = np.stack([-tangents[:, 1], tangents[:, 0]], 1)
        reach = self.reach_px(camera, cam_T_obj)
        if len(points) == 0:
            none = np.zeros(0)
            return EdgeEvidence(ids[inside], points, normals, none, none, np.zeros((0, 2, 3)), none, outside, reach)
        margin = reach + 8
        (x0, y0), (x1, y1) = points.min(0) - margin, points.max(0) + margin
        # Contrast is told as the user sees it.
        patch = image_patch(image, (int(x0), int(y0), int(x1) + 1, int(y1) + 1), AS_THEY_ARE)
        candidates = search_along_normals(patch, points, normals, reach, AS_THEY_ARE)
        near = np.abs(candidates.offsets) <= NEAR_PX
        scores = np.where(near, candidates.scores, 0.0)
        best, rows = scores.argmax(1), np.arange(len(points))
        contrasts = np.where(near.any(1), np.abs(candidates.gradients[rows, best]), 0.0)
        rivals = _rivals(points, normals, candidates.offsets, candidates.scores)
        sides = np.stack([_colours(image, points + side * SIDE_PX * normals) for side in (-1.0, 1.0)], 1)
        return EdgeEvidence(ids[inside], points, normals, scores.max(1), contrasts, sides, rivals, outside, reach)

    def reach_px(self, camera: Camera, cam_T_obj: FloatArray) -> int:
        """How far `acp`'s first level searches, px of the frame, for a part that it first sees at a pose (4, 4).

        Less for one that appears small, more for a large one.
        """
        size_px, times = self._looked_at(camera, cam_T_obj)
        return round(PixelSchedule().at(times * size_px)[0].reach_px / times)

    def leap_px(self, camera: Camera, cam_T_obj: FloatArray) -> float:
        """How far a part may have gone that was not found, px of the frame: five times a first level's reach."""
        size_px, times = self._looked_at(camera, cam_T_obj)
        # Not less far where it is magnified.
        return 5.0 * PixelSchedule().at(min(times, 1.0) * size_px)[0].reach_px / min(times, 1.0)

    def _looked_at(self, camera: Camera, cam_T_obj: FloatArray) -> tuple[float, float]:
        """How long the part appears, px of the frame, and how many times it is magnified."""
        glass, size_px = MagnifyingGlass(USUAL_MAGNIFICATION), appears_px(self.part, camera, cam_T_obj)
        glass.choose(size_px)
        return size_px, glass.times


def _common(ids: IntArray, others: IntArray) -> tuple[IntArray, IntArray]:
    """Rows of two lists of sample ids that hold the same ones."""
    _, rows, other_rows = np.intersect1d(ids, others, assume_unique=True, return_indices=True)
    return rows, other_rows


def _colours(image: ByteImage, points: FloatArray) -> FloatArray:
    """(n, 3) RGB of an image (h, w, 3) at points (n, 2), interpolated; beyond the border the border's value."""
    x, y = (np.ascontiguousarray(points[:, k], np.float32)[:, None] for k in (0, 1))
    return cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)[:, 0].astype(np.float64)


def _rivals(points: FloatArray, normals: FloatArray, offsets: FloatArray, scores: FloatArray) -> FloatArray:
    rows, columns = np.nonzero(scores > STRONG_SCORE)
    places = points[rows] + offsets[rows, columns][:, None] * normals[rows]
    away, _ = cKDTree(points).query(places)
    return np.bincount(rows[away > OWN_PX], minlength=len(points)).astype(np.float64)


def image_motion(
    before: Frame, after: Frame, points: FloatArray, expected: FloatArray, reach_px: float
) -> FloatArray | None:
    """How far (2,) px the patch of the image around `points` (n, 2) moved from one frame to another.

    By normalised correlation of the patch with the later image, up to `reach_px` away. The `expected` motion (2,) is
    returned unless another is clearly better. None where nothing matches well, as after a large rotation.
    """
    low, high = np.floor(points.min(0)).astype(int) - 2, np.ceil(points.max(0)).astype(int) + 3
    size = np.array(before.image.shape[1::-1])
    low = np.clip(low, 0, size - 8)
    high = np.clip(high, low + 8, size)
    grey = [
        cv2.GaussianBlur(cv2.cvtColor(frame.image, cv2.COLOR_RGB2GRAY), (0, 0), MATCH_BLUR_PX).astype(np.float32)
        for frame in (before, after)
    ]
    patch = grey[0][low[1] : high[1], low[0] : high[0]]
    mask = np.zeros(patch.shape, np.float32)
    cv2.fillConvexPoly(mask, cv2.convexHull(np.round(points - low).astype(np.int32)), 1.0)
    margin = round(reach_px)
    around = cv2.copyMakeBorder(grey[1], margin, margin, margin, margin, cv2.BORDER_REPLICATE)
    window = around[low[1] : high[1] + 2 * margin, low[0] : high[0] + 2 * margin]
    match = cv2.matchTemplate(window, patch, cv2.TM_CCOEFF_NORMED, mask=mask)
    match = np.where(np.isfinite(match), match, -1.0)
    _, best, _, (x, y) = cv2.minMaxLoc(match)
    if best < MATCH_LIMIT:
        return None
    column, row = np.round(expected).astype(int) + margin
    near = match[max(row - 2, 0) : max(row + 3, 0), max(column - 2, 0) : max(column + 3, 0)]
    if near.size and near.max() > best - MATCH_LEAD:
        return expected
    return np.array([x - margin, y - margin], np.float64)
