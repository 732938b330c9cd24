"""A Kalman filter of a rigid motion: constant velocity with random accelerations.

The state is the pose and its velocity per step from frame to frame; errors are pose steps about the part's centre, in
camera axes (rad, mm), so that the filter is linear in them (Barfoot, "State Estimation for Robotics", 2017, chapter 8).
Its prediction knows how sure it is, and its innovation, how far a frame was from it, widens the accelerations that it
allows.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from acp_lab.errors import TrackingError
from acp_lab.geometry.arrays import FloatArray, plain
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import transform
from acp_lab.geometry.pose_kernels import invert, move, step_between
from acp_lab.geometry.pose_step import image_directions, move_pose
from acp_lab.tracking.kalman_kernel import go_on, take_in
from acp_lab.tracking.time_step import TimeStep

_STAYED = 0.3
"""Share of a step that a part may seem to make in a picture that comes again."""


@dataclass(frozen=True)
class KalmanPrediction:
    """Configuration: constant velocity, with its uncertainty. mm are of parts of usual size, see `part_size`.

    Attributes:
        turn_deg, shift_mm: standard deviation of the acceleration, per frame and frame.
        speed_share: the same, as a share of the speed: what moves fast also changes its motion fast.
        most_widening: how many times the variance of the acceleration may grow by the innovation.
        hold_below: a pose of less quality is not taken in: the part is held where it was last seen.
        first_turn_deg, first_shift_mm: standard deviation of a start pose; first_speed: of its motion, as multiples
            of these per frame.
        sure_px, sure_innovation: a prediction is sure whose standard deviation in the image, of the part's centre, and
            whose last innovation are below these; 0 for never.
    """

    kind: ClassVar[str] = "kalman"
    weighs_images: ClassVar[bool] = True
    in_mm: ClassVar[Mapping[str, int]] = {"shift_mm": 1, "first_shift_mm": 1}
    turn_deg: float = 0.7
    shift_mm: float = 1.5
    speed_share: float = 0.2
    most_widening: float = 30.0
    hold_below: float = 0.1
    first_turn_deg: float = 0.3
    first_shift_mm: float = 0.5
    first_speed: float = 25.0
    sure_px: float = 4.0
    sure_innovation: float = 0.5

    def __post_init__(self) -> None:
        for name in ("turn_deg", "shift_mm", "first_turn_deg", "first_shift_mm", "first_speed"):
            if not 0.0 < getattr(self, name) < float("inf"):
                raise TrackingError(f"prediction.{name} = {getattr(self, name):g}: give a number above 0")
        if not (self.speed_share >= 0.0 and self.most_widening >= 1.0):
            raise TrackingError("prediction: speed_share must be 0 or more, most_widening 1 or more")

    def predictor(self, centre_obj: FloatArray) -> PoseKalman:
        """For a part with its centre at (3,) mm."""
        return PoseKalman(centre_obj, self)


class PoseKalman:
    """The filter of one part. innovation: of the last frame, squared, per degree of freedom; about 1 if all is well."""

    def __init__(self, centre_obj: FloatArray, config: KalmanPrediction) -> None:
        self._centre_obj = np.array(centre_obj, np.float64)
        self._config = config
        self._last: FloatArray | None = None
        self._coasted: FloatArray | None = None
        # Of the next frame, as predicted: pose (4, 4), velocity (6,), covariance (12, 12) of both.
        self._pose, self._velocity, self._covariance = np.eye(4), np.zeros(6), np.eye(12)
        self._information: FloatArray | None = None
        # Of the last frame, (12, 12), which that was predicted from, over a step of so much of the usual one.
        self._posterior, self._of_usual = self._covariance, 1.0
        # The pose predicted before it was known that the next frame repeats the last picture.
        self._ahead: FloatArray | None = None
        self._widening, self.innovation, self._observed = 1.0, 0.0, False

    @property
    def last(self) -> FloatArray:
        """(4, 4) the last pose taken in; where frames were left out since, one usual step before the predicted one."""
        return self._seen if self._coasted is None else self._coasted

    @property
    def _seen(self) -> FloatArray:
        """(4, 4) the last pose taken in."""
        if self._last is None:
            raise ValueError("no pose observed yet: call restart first")
        return self._last

    @property
    def moves(self) -> bool:
        """Whether the filter knows a velocity."""
        return self._last is not None and bool(self._velocity.any())

    def restart(self, cam_T_obj: FloatArray) -> None:
        """Forget the past; the part rests at `cam_T_obj` (4, 4), for all that is known."""
        config = self._config
        first = np.array([np.radians(config.first_turn_deg)] * 3 + [config.first_shift_mm] * 3)
        self._widening, self.innovation, self._observed = 1.0, 0.0, False
        self._go_on(cam_T_obj, np.zeros(6), np.diag(np.concatenate([first, config.first_speed * first]) ** 2))

    @property
    def motion(self) -> FloatArray | None:
        """(6,) the pose step (rad, mm) expected in a usual time step; None before a motion was seen."""
        return self._velocity / self._of_usual if self.moves else None

    @property
    def steps(self) -> float:
        """How many usual time steps the predicted one is."""
        return self._of_usual

    def predict(self) -> FloatArray:
        """(4, 4) the pose expected in the next frame."""
        if self._last is None:
            raise ValueError("no pose observed yet: call restart first")
        return self._pose

    def information(self) -> FloatArray:
        """(6, 6) inverse covariance of that pose."""
        if self._information is None:
            self._information = np.empty((6, 6))
            invert(np.array(self._covariance[:6, :6]), self._information)
        return self._information

    def innovation_of(self, cam_T_obj: FloatArray) -> float:
        """How far a pose (4, 4) is from the predicted one: squared, normalised, per degree of freedom."""
        off = self._off(cam_T_obj)
        return float(off @ self.information() @ off) / 6.0

    def sight(self, camera: Camera, centre_px: FloatArray, scatter_px: float, doubt: float) -> None:
        """Take in, before the next frame is solved, where the part's centre (2,) px seems to be in it.

        scatter_px: its standard deviation; doubt: standard deviations of its distance from the prediction, of both
        together, beyond which it is not believed.
        """
        centre_cam = transform(self.predict(), self._centre_obj[None])
        if not centre_cam[0, 2] > 0.0:
            return
        # By a shift; turns about the centre do not move it.
        rows = np.zeros((2, 12))
        rows[:, 3:6] = image_directions(np.repeat(centre_cam, 2, axis=0), np.eye(2), camera)
        off_px = centre_px - camera.project(centre_cam)[0]
        spread = rows @ self._covariance @ rows.T + scatter_px**2 * np.eye(2)
        if off_px @ np.linalg.solve(spread, off_px) > doubt**2:
            return
        gain = self._covariance @ rows.T @ np.linalg.inv(spread)
        step = gain @ off_px
        self._pose = move_pose(self._pose, self._centre_obj, step[:6])
        self._velocity = self._velocity + step[6:]
        self._covariance, self._information = _symmetric(self._covariance - gain @ spread @ gain.T), None

    def accelerate(self, step: FloatArray) -> None:
        """The part is known to go by a pose step (6,) farther to the next frame than it went, and to go on so."""
        self._pose = move_pose(self.predict(), self._centre_obj, step)
        self._velocity = self._velocity + step

    def is_sure(self, camera: Camera) -> bool:
        """Whether the part is surely near the predicted pose: its motion went on as predicted, and is slow enough."""
        config = self._config
        if not (self._observed and self.innovation < config.sure_innovation and self._widening <= 1.0):
            return False
        depth = float(transform(self.predict(), self._centre_obj)[2])
        variance = max(self._covariance[3, 3], self._covariance[4, 4])
        return bool(camera.fx * math.sqrt(variance) < config.sure_px * depth)

    def coast(self) -> None:
        """A frame without an image: the motion goes on, less surely."""
        self._observed = False
        self._go_on(self.predict(), self._velocity, self._covariance)

    def elapse(self, step: TimeStep) -> None:
        """The next frame comes after another step than the one before.

        The velocity is per step, so it changes with it; accelerations act for as long. Where frames were left out the
        part is taken to have coasted over them. After a long step it rests where it was, for all that is known.
        """
        if step == TimeStep() or self._last is None:
            return
        if step.is_long:
            self.restart(self._last)
            return
        by = np.ones(12)
        by[6:] = step.of_last
        self._go_on(self._last, step.of_last * self._velocity, by[:, None] * self._posterior * by, step.of_usual)
        if step.of_usual > 1.0:
            self._coasted = move_pose(self._last, self._centre_obj, (1.0 - 1.0 / step.of_usual) * self._velocity)

    def repeat(self) -> None:
        """The next frame shows the last one's picture again: the part is expected where it was, with what smear it had.

        Found there, it goes on from there as it would have gone: by the next picture by one step, or by two if a
        picture was left out, so the prediction stays, and is unsure by a step.
        """
        self._ahead, self._pose = self._pose, self._seen.copy()

    def observe(self, cam_T_obj: FloatArray, quality: float = 1.0, information: FloatArray | None = None) -> None:
        """Take in a frame: the pose (4, 4) found with the prior, and the (6, 6) information of its image alone.

        Taken for a pose that was found with all of the prior; that with less of it is nearer to the image's (see
        `priors.MotionPrior`) makes the innovation, and what it widens, a little larger.
        """
        covariance = self._covariance
        stays = self._ahead is not None and self._stays_at(cam_T_obj)
        if self._ahead is not None:
            self._pose, self._ahead = self._ahead, None
        if quality <= self._config.hold_below:
            self._observed = False
            self._go_on(self._seen, np.zeros(6), covariance)
            return
        if stays:
            self._last, self._pose, self._information, self._coasted = cam_T_obj, np.empty((4, 4)), None, None
            self._posterior, self._of_usual = covariance, 1.0
            move(plain(cam_T_obj), self._centre_obj, self._velocity, self._pose)
            self._covariance = covariance.copy()
            self._covariance[:6, :6] += np.outer(self._velocity, self._velocity)
            return
        self._observed = True
        prior, off = self.information(), self._off(cam_T_obj)
        self.innovation = float(off @ prior @ off) / 6.0
        if self.innovation > 1.0:
            self._widening = min(self._widening * min(self.innovation, 4.0), self._config.most_widening)
        else:
            self._widening = max(1.0, 0.8 * self._widening)
        velocity, updated = self._velocity.copy(), np.empty((12, 12))
        take_in(covariance, prior, prior + (prior if information is None else information), off, velocity, updated)
        self._go_on(cam_T_obj, velocity, updated)

    def _stays_at(self, cam_T_obj: FloatArray) -> bool:
        """Whether a pose (4, 4) is off the predicted one by a small share of a step, as the covariance weighs both."""
        off, step, prior = self._off(cam_T_obj), self._velocity, self.information()
        return bool(off @ prior @ off <= _STAYED**2 * (step @ prior @ step))

    def _off(self, cam_T_obj: FloatArray) -> FloatArray:
        """(6,) the pose step from the predicted pose to another (4, 4)."""
        off = np.empty(6)
        step_between(plain(self.predict()), plain(cam_T_obj), self._centre_obj, off)
        return off

    def _go_on(
        self, cam_T_obj: FloatArray, velocity: FloatArray, covariance: FloatArray, of_usual: float = 1.0
    ) -> None:
        """To the next frame, from what is known in this one; of_usual: the step there, as a share of the usual one."""
        config, share = self._config, self._config.speed_share / of_usual
        turning, shifting = velocity[:3] @ velocity[:3], velocity[3:] @ velocity[3:]
        variance = np.empty(6)
        variance[:3] = self._widening * (math.radians(config.turn_deg) ** 2 + share**2 * turning)
        variance[3:] = self._widening * (config.shift_mm**2 + share**2 * shifting)
        # White noise of the acceleration: the variance of a velocity grows with the time, and here it is per step.
        variance *= of_usual**3
        self._posterior, self._of_usual = covariance, of_usual
        self._last, self._velocity, self._ahead, self._coasted = cam_T_obj, velocity, None, None
        self._pose, self._covariance, self._information = np.empty((4, 4)), np.empty((12, 12)), None
        move(plain(cam_T_obj), self._centre_obj, velocity, self._pose)
        go_on(covariance, variance, self._covariance)


def _symmetric(matrix: FloatArray) -> FloatArray:
    even: FloatArray = 0.5 * (matrix + matrix.T)
    return even
