"""Alignment: from where the detector believes the part to be to the pose that the frame shows.

It is what a tracker makes of a first frame from a pose that is not far off: coarse to fine, and again with what the
part's edges have in common (`FrameSolver.settle`). A right candidate is off by about a percent of the distance, which
is several percent of the diameter, and what its edges have in common is first learnt there; so each time all levels are
gone through. It ends where edges and colours agree, a wrong one does not: what the image says of the poses that come
out tells them apart.
"""

from __future__ import annotations

import numpy as np

from acp_lab.cad.part import box_corners
from acp_lab.detection.work import Steps
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import transform
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.frame_solver import FrameSolver
from acp_lab.tracking.method import ACP
from acp_lab.tracking.schedule import Level
from acp_lab.tracking.search import CLOUD_LEVELS
from acp_lab.tracking.stopwatch import Stopwatch

ALIGNING_LEVELS = (*CLOUD_LEVELS, Level(5, 1.0, 600))
BEGIN_WORK, LEVEL_WORK, SETTLE_WORK, LOOK_WORK = 1500.0, 700.0, 3500.0, 0.012
"""Of an alignment, see `detection.work`: of its solver, of a level, of what its edges have in common, and of a pixel
that is looked at."""
_MARGIN_PX = 40.0
_LOOK_AGAIN, _FAR = 0.1, 0.3
"""Of the diameter: a pose that moved farther shows edges and colours that were not looked for; or was of nothing."""


def aligning(model: PreparedPart, frame: Frame, cam_T_obj: FloatArray) -> Steps[FloatArray | None]:
    """The pose (4, 4) mm that a frame shows near a given one; None where that leads away, or too little is seen."""
    aligned = yield from _aligning(model, frame, cam_T_obj)
    if aligned is not None and _LOOK_AGAIN < _moved(model, cam_T_obj, aligned) <= _FAR:
        aligned = yield from _aligning(model, frame, aligned)
    return None if aligned is None or _moved(model, cam_T_obj, aligned) > _FAR else aligned


def _aligning(model: PreparedPart, frame: Frame, cam_T_obj: FloatArray) -> Steps[FloatArray | None]:
    """`aligning`, by what the frame shows around a pose (4, 4), whatever that leads to."""
    # One that knows nothing of how edges looked at another pose.
    solver = FrameSolver(model, ACP)
    yield BEGIN_WORK
    solver.magnify(frame.camera, cam_T_obj)
    region, margin_px = solver.choose_region(cam_T_obj), solver.glass.times * _MARGIN_PX
    seen = solver.look(frame.image, frame.camera, cam_T_obj, region, margin_px)
    if seen is None:
        return None
    x0, y0, x1, y1 = seen.view.box
    yield LOOK_WORK * (x1 - x0) * (y1 - y0)
    at, solution = seen.view.at_pose(cam_T_obj), None
    for level in ALIGNING_LEVELS:
        solution = solver.solve(seen, at, Stopwatch(), (level,))
        yield LEVEL_WORK
        if solution is None:
            return None
        at = solution.estimate
    if solution is None or _moved(model, cam_T_obj, at.cam_T_obj) > _FAR:
        return None
    settled = solver.settle(seen, solution, Stopwatch(), ALIGNING_LEVELS).cam_T_obj
    yield SETTLE_WORK
    return settled


def _moved(model: PreparedPart, before: FloatArray, after: FloatArray) -> float:
    """How far the corners of the part's box moved from one pose (4, 4) to another, on average; in diameters."""
    corners_obj = box_corners(model.part)
    moved_mm = np.linalg.norm(transform(after, corners_obj) - transform(before, corners_obj), axis=1).mean()
    return float(moved_mm / model.part.diameter)
