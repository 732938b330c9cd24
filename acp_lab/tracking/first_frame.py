"""The first frame, measured once more when it is known how far motion smeared its edges, where it shows them, or how
its greys mean light.

Offsets of edges are measured in the first frame, where the pose is known best. What the part moves and for how long
the shutter is open nobody knows then, nor how the camera encodes light. Where edges are smeared, what is taken for
their offsets may be any place in the smear, in light that is taken for another it is not its middle, and where the
image was read row by row, they are shown elsewhere. The second frame tells the motion, a few fast edges the shutter,
some hundred the encoding, and with these the first image is read again.
(Not in the paper; see docs/paper-ledger.md.)
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose_step import pose_step_between
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.frame_solver import FrameSolver
from acp_lab.tracking.start import LOOK_LEVEL
from acp_lab.tracking.stopwatch import Stopwatch

# Where no more than a tenth of the edges is smeared by more, or is shown farther off, the first measurement stands.
_SMEARED_PX, _SHOWN_OFF_PX, _SHARE = 3.0, 0.5, 0.1
# So many frames it waits for a readout: then the offsets have followed what was seen. Of light they cannot follow it:
# measured with another encoding, they contradict what is seen with the right one.
_FRAMES = 12
# By how much a readout must have become another to be news.
_NEWS = 0.1


class FirstFrame:
    """What is kept of it: the frame, the pose (4, 4) at which offsets were measured, and its view region 0..5."""

    def __init__(self, frame: Frame, cam_T_obj: FloatArray, region: int) -> None:
        self._frame = frame.to_keep()
        self._cam_T_obj, self._region = cam_T_obj, region
        self._motion: FloatArray | None = None
        self._age, self._since = 0, 0
        # Whether every frame was seen since: over a gap the next one tells another motion.
        self._is_whole = True
        self._waits_for_shutter = True
        self._smear_was_known = False
        self._readout = np.zeros(2)
        self._gamma: float | None = None

    def next_frame(self) -> None:
        """Another frame comes, whether it shows the part or not."""
        self._since += 1

    def measure_again(self, solver: FrameSolver, cam_T_obj: FloatArray, clock: Stopwatch) -> bool:
        """Measure its offsets again if more is known of the camera by now; whether it is still to be kept.

        cam_T_obj: (4, 4) the pose in the frame that came, which teaches; that of the second frame tells the motion.
        """
        knowledge = solver.knowledge
        self._is_whole, self._since = self._is_whole and self._since == 1, 0
        self._age += 1
        smear_is_new, readout = False, self._readout
        if self._is_whole and self._waits_for_shutter:
            if self._motion is None:
                self._motion = pose_step_between(self._cam_T_obj, cam_T_obj, solver.part.box_centre)
            smear_is_known = knowledge.blur is None or knowledge.blur.share > 0.0
            smear_is_new, self._smear_was_known = smear_is_known and not self._smear_was_known, smear_is_known
            readout = np.zeros(2) if knowledge.readout is None else knowledge.readout
            self._waits_for_shutter = not smear_is_known or (knowledge.shutter is not None and self._age < _FRAMES)
        light_is_new = knowledge.gamma != self._gamma
        if smear_is_new or light_is_new or np.abs(readout - self._readout).max() > _NEWS:
            self._look_again(solver, smear_is_new, light_is_new, readout, clock)
        return (self._is_whole and self._waits_for_shutter) or knowledge.encoding is not None

    def _look_again(
        self, solver: FrameSolver, smear_is_new: bool, light_is_new: bool, readout: FloatArray, clock: Stopwatch
    ) -> None:
        frame, knowledge, pose = self._frame, solver.knowledge, self._cam_T_obj
        before, self._readout = self._readout, readout
        seen = solver.look(frame.image, frame.camera, pose, self._region, motion=self._motion)
        if seen is None:
            return
        self._gamma = knowledge.gamma
        at = seen.view.at_pose(pose)
        edges = solver.source.generate(at, LOOK_LEVEL.samples)
        points_obj = knowledge.edges.points_obj[edges.sample_ids]
        then = replace(seen.view, readout=before).at_pose(pose)
        off = at.read_places(edges.points, points_obj) - then.read_places(edges.points, points_obj)
        off_px = np.linalg.norm(off, axis=1)
        smear_px = knowledge.blur_px(edges, edges.normals, at) if smear_is_new else None
        is_smeared = smear_px is not None and (smear_px > _SMEARED_PX).mean() > _SHARE
        if light_is_new or is_smeared or (off_px > _SHOWN_OFF_PX).mean() > _SHARE:
            knowledge.forget_offsets()
            again = solver.look_at(seen, at, LOOK_LEVEL, clock)
            if again is not None and again.judgement.matches is not None:
                knowledge.measure_offsets(again.judgement.matches)
