"""The first frame, measured once more when it is known how far motion smeared its edges.

Offsets of edges are measured in the first frame, where the pose is known best. What the part moves and for how long
the shutter is open nobody knows then; where edges are smeared, what is taken for their offsets may be any place in the
smear. The second frame tells the motion, a few fast edges the shutter, and with both the first image is read again.
(Not in the paper; see docs/paper-ledger.md.)
"""

from __future__ import annotations

from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose_step import pose_step_between
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.frame_solver import FrameSolver
from acp_lab.tracking.start import LOOK_LEVEL
from acp_lab.tracking.stopwatch import Stopwatch

# Where no more than a tenth of the edges is smeared by more, the first measurement stands.
_SMEARED_PX, _SMEARED_SHARE = 3.0, 0.1


class FirstFrame:
    """What is kept of it: the frame, the pose (4, 4) at which offsets were measured, and its view region 0..5."""

    def __init__(self, frame: Frame, cam_T_obj: FloatArray, region: int) -> None:
        self._frame = frame.to_keep()
        self._cam_T_obj, self._region = cam_T_obj, region
        self._motion: FloatArray | None = None

    def measure_again(self, solver: FrameSolver, cam_T_obj: FloatArray, clock: Stopwatch) -> bool:
        """Measure its offsets again if the smear of its edges is known by now; whether it is still to be kept.

        cam_T_obj: (4, 4) the pose in the frame after; at the first call this is the second frame, which tells the
            motion.
        """
        knowledge, pose = solver.knowledge, self._cam_T_obj
        if knowledge.blur is None:
            return False
        if self._motion is None:
            self._motion = pose_step_between(pose, cam_T_obj, solver.part.box_centre)
        if knowledge.blur.share == 0.0:
            return True
        frame = self._frame
        seen = solver.look(frame.image, frame.camera, pose, self._region, motion=self._motion)
        if seen is not None:
            at = seen.view.at_pose(pose)
            edges = solver.source.generate(at, LOOK_LEVEL.samples)
            smear_px = knowledge.blur_px(edges, edges.normals, at)
            if smear_px is not None and (smear_px > _SMEARED_PX).mean() > _SMEARED_SHARE:
                knowledge.forget_offsets()
                again = solver.look_at(seen, at, LOOK_LEVEL, clock)
                if again is not None and again.judgement.matches is not None:
                    knowledge.measure_offsets(again.judgement.matches)
        return False
