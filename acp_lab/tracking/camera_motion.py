"""A camera in the hand shakes: what it turned by is no motion of the part.

A motion prior believes that a part goes on as it went. Before a camera that is held in the hand, all that is seen goes
to and fro, and a prediction is off by twice each jerk. How the camera turned is known before the part is looked for
(`background`): by so much more than in the last frame the part is expected to have gone, and to go on. To a filter that
is a known acceleration; a camera that turns evenly, or stands still, changes nothing.

Whether it is so shows in the poses that are found: a part that the camera carries along does not move when the
background does. So the accelerations of the part are followed, with the camera's and without, and the camera is asked
only while its own explain some. (Not in the paper; see docs/paper-ledger.md.)
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from acp_lab.cad.part import Part, box_corners
from acp_lab.errors import TrackingError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import transform
from acp_lab.geometry.pose_step import pose_step_between
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.background import Background
from acp_lab.tracking.frame_view import crop_box
from acp_lab.tracking.learning.knowledge import Off


@dataclass(frozen=True)
class CameraMotion:
    """Configuration: the camera's turns are known accelerations of the part.

    Attributes:
        least_share: jerks that shift the part by a smaller share of its diameter are none: its own motion changes by as
            much, and slow turns of a camera are known in steps.
        margin_px: around the part, in which the picture says nothing of the camera.
        memory: share of what accelerations told before that still counts from frame to frame.
    """

    kind: ClassVar[str] = "background"
    least_share: float = 0.015
    margin_px: float = 12.0
    memory: float = 0.7

    def __post_init__(self) -> None:
        if not 0.0 < self.least_share <= 100.0:
            raise TrackingError(
                f"camera.least_share = {self.least_share:g}: give a share of the diameter, such as 0.015"
            )
        if not 0.0 <= self.margin_px <= 1000.0:
            raise TrackingError(f"camera.margin_px = {self.margin_px:g}: give px from 0 to 1000")
        if not 0.0 <= self.memory < 1.0:
            raise TrackingError(f"camera.memory = {self.memory:g}: give a share from 0 to less than 1")


class CameraFollower:
    """The camera before one tracked part; where the method does not ask it, no part is accelerated by it."""

    def __init__(self, part: Part, config: CameraMotion | Off) -> None:
        self._part, self._is_off = part, isinstance(config, Off)
        self._config = CameraMotion() if isinstance(config, Off) else config
        self._corners_obj = box_corners(part)
        self._background = Background()
        self.forget()

    def forget(self) -> None:
        """Before a new track."""
        self._background.forget()
        self._turns: tuple[FloatArray | None, ...] = ()
        self._poses: tuple[FloatArray, ...] = ()
        self._times, self._missed, self._awaits_pose = 1.0, 0, False
        # Squared px by which the part was accelerated lately: as it was seen, and beside what the camera did. Before
        # there was any jerk it is not asked.
        self._seen = self._own = 0.0

    def begin(self, frame: Frame, cam_T_obj: FloatArray) -> None:
        """Take in a first frame, in which the part is at a pose (4, 4)."""
        self.forget()
        self.acceleration(frame, cam_T_obj)
        self.found(cam_T_obj, frame.camera)

    def acceleration(self, frame: Frame, predicted: FloatArray, times: float = 1.0) -> FloatArray | None:
        """(6,) pose step (rad, mm) by which the part is expected beyond a predicted pose (4, 4); None for none.

        times: as long is the step in time to this frame as the one before.
        """
        if self._is_off:
            return None
        if self._awaits_pose:  # nothing was found in the last frame
            self._poses = ()
        self._times, self._awaits_pose = times, True
        before = self._turns[-1] if self._turns else None
        around = crop_box(self._corners_obj, predicted, frame.camera, self._config.margin_px)
        turn = self._background.turn(frame, around)
        if turn is not None and self._missed:
            turn = turn / (1 + self._missed)  # it was turned over several frames
        self._missed = 0
        self._turns = (*self._turns[-1:], turn)
        if turn is None or before is None or self._own >= self._seen:
            return None
        return self._jerk(turn - times * before, predicted)

    def miss(self) -> None:
        """A frame of which there is no image."""
        self._turns, self._poses, self._missed = (), (), self._missed + 1

    def found(self, cam_T_obj: FloatArray, camera: Camera) -> None:
        """Take in the pose (4, 4) that was found in the frame; not one of a repeated picture, which was not asked."""
        if not self._awaits_pose:
            return
        self._awaits_pose = False
        self._poses = (*self._poses[-2:], cam_T_obj)
        if len(self._poses) < 3 or len(self._turns) < 2:
            return
        before, turn = self._turns
        jerk = None if before is None or turn is None else self._jerk(turn - self._times * before, cam_T_obj)
        if jerk is None:
            return
        centre_obj, (first, second, third) = self._part.box_centre, self._poses
        last = self._times * pose_step_between(first, second, centre_obj)
        seen = pose_step_between(second, third, centre_obj) - last
        px_per_mm = camera.fx / max(float(transform(cam_T_obj, centre_obj)[2]), 1e-6)
        # Turns count by what they move at the part's rim; along the line of sight little is seen.
        px = px_per_mm * np.array([*[self._part.radius] * 3, 1.0, 1.0, 0.0])
        memory = self._config.memory
        self._seen = memory * self._seen + float(np.square(px * seen).sum())
        self._own = memory * self._own + float(np.square(px * (seen - jerk)).sum())

    def _jerk(self, turn: FloatArray, cam_T_obj: FloatArray) -> FloatArray | None:
        """(6,) step of the part, at a pose (4, 4), by a camera's turn (3,); None for one that is too small."""
        if not turn.any():  # as in every frame of a camera that stands still
            return None
        (a, b, c), (x, y, z) = turn.tolist(), transform(cam_T_obj, self._part.box_centre).tolist()
        shift = b * z - c * y, c * x - a * z, a * y - b * x
        is_small = math.hypot(shift[0], shift[1]) < self._config.least_share * self._part.diameter
        return None if is_small else np.concatenate([turn, shift])
