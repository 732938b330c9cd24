"""The first frame, measured once more when it is known how far motion smeared its edges.

Offsets of edges are measured in the first frame, where the pose is known best. What the part moves and for how long
the shutter is open nobody knows then; where edges are smeared, what is taken for their offsets may be any place in the
smear. The second frame tells the motion, a few fast edges the shutter, and with both the first image is read again.
(Not in the paper; see docs/paper-ledger.md.)
"""

from __future__ import annotations

import numpy as np

from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose_step import pose_step_between
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.frame_solver import FrameSolver
from acp_lab.tracking.start import LOOK_LEVEL
from acp_lab.tracking.stopwatch import Stopwatch

# Where fewer edges than a tenth are smeared by more, the first measurement stands.
_SMEARED_PX, _SMEARED_SHARE = 3.0, 0.1


class FirstFrame:
    """What is kept of it: the frame, the pose (4, 4) at which offsets were measured, and its view region 0..5."""

    def __init__(self, frame: Frame, cam_T_obj: FloatArray, region: int) -> None:
        self._frame, self._cam_T_obj, self._region = frame, cam_T_obj, region
        self._motion: FloatArray | None = None

    def move_to(self, cam_T_obj: FloatArray, centre_obj: FloatArray) -> None:
        """The pose (4, 4) of the next frame, which tells the motion; of later ones, nothing.

        centre_obj: (3,) mm, of the part.
        """
        if self._motion is None:
            self._motion = pose_step_between(self._cam_T_obj, cam_T_obj, centre_obj)

    def measure_again(self, solver: FrameSolver, clock: Stopwatch) -> bool:
        """Measure its offsets again if the smear of its edges is known; whether that is done, or not worth it."""
        knowledge, motion = solver.knowledge, self._motion
        if knowledge.blur is None:
            return True
        if motion is None or knowledge.blur.share == 0.0:
            return False
        frame, pose = self._frame, self._cam_T_obj
        seen = solver.look(frame.image, frame.camera, pose, self._region, motion=motion)
        if seen is None:
            return True
        at = seen.view.at_pose(pose)
        first = solver.look_at(seen, at, LOOK_LEVEL, clock)
        matches = None if first is None else first.judgement.matches
        if matches is None:
            return True
        smear_px = knowledge.blur.smear_px(matches.jacobian @ motion)
        if smear_px is None or np.quantile(smear_px, 1.0 - _SMEARED_SHARE) < _SMEARED_PX:
            return True
        knowledge.forget_offsets()
        again = solver.look_at(seen, at, LOOK_LEVEL, clock)
        if again is not None and again.judgement.matches is not None:
            knowledge.measure_offsets(again.judgement.matches)
        return True
