"""The six parameters of a pose over a sequence, estimated and true.

One number per frame, such as ADD, says how far off a pose is, not how: along the line of sight, where an image says
least, or across it. So three angles and three coordinates are followed one by one.

Convention: camera axes (x right, y down, z forward). Turns, in degrees, are those of the part about x, y and z from one
true rotation to the next, added up from the first frame on: unlike Euler angles they do not jump where a part turns by
a quarter or half about y, and they go on beyond 180 degrees. An estimate is further by the turn that leads from the
true rotation to it. Coordinates, in mm, are those of the middle of the part's box, since the origin of a CAD file may
lie far outside the part.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from acp_lab.errors import SequenceError
from acp_lab.geometry.arrays import FloatArray, IntArray
from acp_lab.geometry.pose import transform
from acp_lab.geometry.pose_step import pose_step_between
from acp_lab.tracking.session import TrackRun

NAMES = ("turn about x [°]", "turn about y [°]", "turn about z [°]", "x [mm]", "y [mm]", "z [mm]")
_UNITS = np.repeat([np.degrees(1.0), 1.0], 3)


@dataclass(frozen=True, eq=False)
class PoseParameters:
    """Of the n frames of a run that have a truth.

    Attributes:
        frame_ids: (n,).
        estimated, true: (n, 6) in the order of NAMES.
    """

    frame_ids: IntArray
    estimated: FloatArray
    true: FloatArray

    @property
    def off(self) -> FloatArray:
        """(n, 6) estimated minus true."""
        return self.estimated - self.true


def pose_parameters(run: TrackRun, object_id: int = 1) -> PoseParameters:
    """The parameters of a run over a sequence with truth; SequenceError where the object or its truth is missing."""
    if object_id not in run.parts or object_id not in run.results:
        raise SequenceError(f"{run.name}: object {object_id} was not tracked: there are {sorted(run.parts)}")
    truth = run.session.truth if run.session is not None else None
    pairs = [
        (result, true)
        for result in run.results[object_id]
        if truth is not None and (true := truth(result.frame_id, object_id)) is not None
    ]
    if not pairs:
        raise SequenceError(f"{run.name}: no frame of object {object_id} has a truth to compare with")
    centre_obj = run.parts[object_id].box_centre
    truths = [true for _, true in pairs]
    start = np.concatenate([np.zeros(3), transform(truths[0], centre_obj)])
    true_rows = np.cumsum([start, *(_step(before, after, centre_obj) for before, after in pairwise(truths))], axis=0)
    off = np.stack([_step(true, result.cam_T_obj, centre_obj) for result, true in pairs])
    return PoseParameters(np.array([result.frame_id for result, _ in pairs]), true_rows + off, true_rows)


def _step(start: FloatArray, end: FloatArray, centre_obj: FloatArray) -> FloatArray:
    """(6,) degrees and mm from one pose (4, 4) to another."""
    return pose_step_between(start, end, centre_obj) * _UNITS
