"""What the region tracker sees in one frame: the colours that it learnt, its lines, and the posterior on each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acp_lab.errors import TrackingError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.frame_solver import FrameSolver
from acp_lab.tracking.method import REGION
from acp_lab.tracking.solution import SeenFrame
from acp_lab.tracking.targets.contour_regions import ContourTarget
from acp_lab.tracking.targets.correspondence_lines import CorrespondenceLines
from acp_lab.tracking.targets.step_posterior import PLACES, SEGMENTS, SmoothStep, fill_posteriors

_LINES = 300


@dataclass(frozen=True, eq=False)
class LinePosteriors:
    """n lines at one scale.

    Attributes:
        inside: (n, 19) probability of each segment, from inside to outside, of being the part's.
        posterior: (n, 12) probability of each place of the step; offsets_px: (12,) of these places, outwards.
        mean_px: (n,) where the outline is believed to be.
    """

    inside: FloatArray
    posterior: FloatArray
    offsets_px: FloatArray
    mean_px: FloatArray


@dataclass(frozen=True, eq=False)
class RegionView:
    """A frame whose colours were learnt at a pose. seen: the frame; target: its colours."""

    solver: FrameSolver
    seen: SeenFrame
    target: ContourTarget

    @classmethod
    def of(cls, model: PreparedPart, frame: Frame, cam_T_obj: FloatArray) -> RegionView:
        """Learn the colours of a frame at a pose (4, 4); TrackingError where the part is outside the image."""
        solver = FrameSolver(model, REGION)
        seen = solver.look(frame.image, frame.camera, cam_T_obj, solver.choose_region(cam_T_obj))
        if seen is None or not isinstance(seen.targets[0], ContourTarget):
            raise TrackingError("the part is not seen at that pose: give another one")
        view = cls(solver, seen, seen.targets[0])
        view.target.memory.learn(view.lines(cam_T_obj))
        return view

    def lines(self, cam_T_obj: FloatArray) -> CorrespondenceLines:
        """The correspondence lines at a pose (4, 4)."""
        at = self.seen.view.at_pose(cam_T_obj)
        return self.target.lines(self.solver.source.generate(at, _LINES), at)

    def probabilities(self) -> tuple[FloatArray, tuple[int, int]]:
        """(h, w) of the crop's pixels being the part's, by colour alone, and (x, y) px of its first pixel."""
        crop = self.target.crop
        return 1.0 / (1.0 + np.exp(-crop.colours.log_odds[crop.bins].astype(float))), crop.origin

    def posteriors(self, cam_T_obj: FloatArray, scale: int, step: SmoothStep | None = None) -> LinePosteriors:
        """What the lines at a pose (4, 4) say, with segments of `scale` px."""
        lines, crop = self.lines(cam_T_obj), self.target.crop
        points = np.ascontiguousarray(lines.points - crop.origin)
        outward, found = np.ascontiguousarray(lines.outward), np.empty((len(lines), PLACES + 2))
        fill_posteriors(
            crop.bins, crop.colours.log_odds, points, outward, scale, (step or SmoothStep()).values, found
        )
        probability = np.exp(found[:, :PLACES])
        probability /= probability.sum(1, keepdims=True)
        offsets_px = np.asarray(scale * (np.arange(PLACES) - 0.5 * (PLACES - 1)), np.float64)
        return LinePosteriors(
            self._inside(points, outward, scale), probability, offsets_px, scale * found[:, PLACES]
        )

    def _inside(self, points: FloatArray, outward: FloatArray, scale: int) -> FloatArray:
        crop = self.target.crop
        way = np.arange(SEGMENTS * scale) - 0.5 * (SEGMENTS * scale - 1)
        at = np.floor(points[:, None] + way[:, None] * outward[:, None] + 0.5).astype(int)
        (height, width), (x, y) = crop.bins.shape, np.moveaxis(at, 2, 0)
        known = (x >= 0) & (x < width) & (y >= 0) & (y < height)
        bins = crop.bins[np.clip(y, 0, height - 1), np.clip(x, 0, width - 1)]
        log_odds = np.where(known, crop.colours.log_odds[bins], 0.0)
        return np.asarray(1.0 / (1.0 + np.exp(-log_odds.reshape(len(points), SEGMENTS, scale).sum(2))), np.float64)
