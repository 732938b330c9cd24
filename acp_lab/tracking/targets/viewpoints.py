"""The sparse viewpoint model of a region tracker: per view of the part, how far its outline's lines are free.

A correspondence line is of use where there is part behind the outline and background before it, as far as the line
reaches. That changes slowly with the view, so it is kept per view of a sphere and per outline sample, in mm, and taken
from the nearest view (Stoiber et al., "SRT3D", IJCV 2022, section 3.2, who render all views beforehand). Here rays
answer, when a view is met for the first time.
"""

from __future__ import annotations

import numpy as np

from acp_lab.cad.raycast import RayCaster
from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.geometry.arrays import FloatArray, IntArray
from acp_lab.geometry.icosphere import icosphere
from acp_lab.tracking.frame_view import Estimate

# 642 views, some 8 degrees apart: lengths need not be exact, and rays for a new view are the dearest part of a frame.
_SUBDIVISIONS = 3
# What was found is kept until lines of as many px are longer than this tells.
_SAME_SCALE = 0.85


class SparseViews:
    """Free lengths of outline samples, by view."""

    def __init__(
        self, samples: int, box_centre: FloatArray, caster: RayCaster, reach_px: float, step_px: float
    ) -> None:
        """samples: of the part; lines are looked along up to `reach_px` on both sides, in steps."""
        self._views_obj = icosphere(_SUBDIVISIONS)
        self._samples, self._box_centre, self._caster = samples, box_centre, caster
        self._way_px = np.arange(step_px, reach_px + 0.1, step_px)
        self._free_mm: dict[int, tuple[float, FloatArray]] = {}

    def free_mm(self, at: Estimate) -> FloatArray:
        """(2, samples) mm to where the part ends inwards, and begins again outwards, in the nearest view.

        at: the estimate whose view is meant. NaN where nobody asked yet, see `look_along`, or only from much nearer:
        lines are looked along for so many px, and so for shorter lengths there.
        """
        eye_obj = eye_position(at.cam_T_obj) - self._box_centre
        view = int(np.argmax(self._views_obj @ eye_obj))
        mm_per_px = float(np.linalg.norm(eye_obj)) / at.view.camera.fx
        asked_at, known = self._free_mm.get(view, (0.0, None))
        if known is None or mm_per_px * _SAME_SCALE > asked_at:
            known = np.full((2, self._samples), np.nan)
            self._free_mm[view] = mm_per_px, known
        return known

    def look_along(
        self, ids: IntArray, points: FloatArray, outward: FloatArray, px_per_mm: FloatArray, at: Estimate
    ) -> None:
        """Find out, for the view nearest to an estimate's, the free lengths of samples (n,) that are not known.

        points: (n, 2) px, theirs; outward: (n, 2) unit; px_per_mm: (n,) scale across the outline.
        """
        known = self.free_mm(at)
        asked = np.flatnonzero(np.isnan(known[0, ids]))
        free_px = self._cast(points[asked], outward[asked], at)
        known[:, ids[asked]] = free_px / np.maximum(px_per_mm[asked], 1e-9)

    def _cast(self, points: FloatArray, outward: FloatArray, at: Estimate) -> FloatArray:
        way = np.concatenate([-self._way_px, self._way_px])
        pose, camera = at.cam_T_obj, at.view.camera
        # A px outwards adds the same to every viewing direction of a line.
        first = camera.rays(points) @ pose[:3, :3]
        added = (outward / (camera.fx, camera.fy)) @ pose[:2, :3]
        rays_obj = (first[:, None] + way[:, None] * added[:, None]).reshape(-1, 3)
        eye = np.broadcast_to(eye_position(pose), rays_obj.shape)
        hit = self._caster.occluded(eye, rays_obj, 1e9).reshape(len(points), 2, len(self._way_px))
        # As far as the part reaches without a gap inwards, and the background outwards: half a step beyond the last
        # ray, as it ends between that one and the next. On the ray, rounding would decide who is long enough.
        steps = np.stack([np.cumprod(hit[:, 0], axis=1).sum(1), np.cumprod(~hit[:, 1], axis=1).sum(1)])
        return np.asarray(self._way_px[0] * np.where(steps > 0, steps + 0.5, 0.0), np.float64)
