"""The six parameters of a pose over a sequence, estimated and true.

One number per frame, such as ADD, says how far off a pose is, not how: along the line of sight, where an image says
least, or across it. So three angles and three coordinates are followed one by one.

Convention: camera axes (x right, y down, z forward). Angles, in degrees, turn the part about x, then y, then z, from
its true rotation in the first frame; they go on beyond 180 degrees. Coordinates, in mm, are those of the middle of the
part's box, since the origin of a CAD file may lie far outside the part.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from acp_lab.cad.part import Part
from acp_lab.errors import SequenceError
from acp_lab.geometry.arrays import FloatArray, IntArray
from acp_lab.geometry.pose import transform
from acp_lab.tracking.session import TrackRun

NAMES = ("turn about x [°]", "turn about y [°]", "turn about z [°]", "x [mm]", "y [mm]", "z [mm]")


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
    part, first = run.parts[object_id], pairs[0][1]
    true_rows = _parameters([true for _, true in pairs], first, part)
    found_rows = _parameters([result.cam_T_obj for result, _ in pairs], first, part)
    true_rows[:, :3] = np.unwrap(true_rows[:, :3], period=360.0, axis=0)
    # An angle and the same one a turn further are the same: take the one next to the truth.
    found_rows[:, :3] -= 360.0 * np.round((found_rows[:, :3] - true_rows[:, :3]) / 360.0)
    return PoseParameters(np.array([result.frame_id for result, _ in pairs]), found_rows, true_rows)


def _parameters(poses: list[FloatArray], first: FloatArray, part: Part) -> FloatArray:
    """(n, 6) of poses (4, 4), turns counted from `first`."""
    turned = np.stack([pose[:3, :3] @ first[:3, :3].T for pose in poses])
    centres = np.stack([transform(pose, part.box_centre) for pose in poses])
    return np.column_stack([Rotation.from_matrix(turned).as_euler("xyz", degrees=True), centres])
