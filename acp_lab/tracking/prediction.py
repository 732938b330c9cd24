"""Where the part is expected in the next frame: constant-velocity prediction, or where it was last."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np

from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import so3_exp, so3_log, transform
from acp_lab.geometry.pose_step import pose_step_between
from acp_lab.tracking.time_step import TimeStep


class Predictor(Protocol):
    """What a tracker asks about the motion of its part."""

    @property
    def last(self) -> FloatArray:
        """(4, 4) the last pose taken in; where frames were left out since, one usual step before the predicted one."""
        ...

    @property
    def moves(self) -> bool:
        """Whether a motion is known, so that `predict` differs from `last`."""
        ...

    def restart(self, cam_T_obj: FloatArray) -> None:
        """Forget the past; the part rests at `cam_T_obj` (4, 4)."""
        ...

    def observe(self, cam_T_obj: FloatArray, quality: float, information: FloatArray | None = None) -> None:
        """Take in the pose (4, 4) of a further frame, its quality in [0, 1] and the (6, 6) information of its image."""
        ...

    def coast(self) -> None:
        """A frame without an image: the part is where it was predicted."""
        ...

    def elapse(self, step: TimeStep) -> None:
        """The next frame comes after a step in time; without this call after one like the last."""
        ...

    def repeat(self) -> None:
        """The next frame shows the last one's picture again: the part is expected where it was."""
        ...

    def predict(self) -> FloatArray:
        """(4, 4) the pose expected in the next frame."""
        ...

    @property
    def motion(self) -> FloatArray | None:
        """(6,) the pose step (rad, mm) expected in a usual time step, see `frame_view.View`; None if unknown."""
        ...

    def information(self) -> FloatArray | None:
        """(6, 6) how sure that pose is, see `frame_view.View`; None where nobody knows."""
        ...

    @property
    def steps(self) -> float:
        """How many usual time steps the predicted one is."""
        ...

    def innovation_of(self, cam_T_obj: FloatArray) -> float:
        """How far a pose (4, 4) is from the predicted one: squared, normalised, per degree of freedom; 0 if unknown."""
        ...

    def sight(self, camera: Camera, centre_px: FloatArray, scatter_px: float, doubt: float) -> None:
        """Take in where the part's centre seems to be in the next frame, see `kalman.PoseKalman.sight`."""
        ...

    def is_sure(self, camera: Camera) -> bool:
        """Whether the part is surely near the predicted pose, so that nobody has to look for it."""
        ...


@dataclass(frozen=True)
class ConstantVelocityPrediction:
    """Configuration. rest_below: after a pose of less quality the part is taken to rest; the motion of a pose that fits
    nothing is noise, and extrapolating it runs away."""

    kind: ClassVar[str] = "constant-velocity"
    weighs_images: ClassVar[bool] = False
    rest_below: float = 0.2

    def predictor(self, centre_obj: FloatArray) -> ConstantVelocity:
        """For a part with its centre at (3,) mm."""
        return ConstantVelocity(centre_obj, self.rest_below)


@dataclass(frozen=True)
class LastPosePrediction:
    """Configuration: a frame starts where the last one ended (the paper)."""

    kind: ClassVar[str] = "last-pose"
    weighs_images: ClassVar[bool] = False

    def predictor(self, centre_obj: FloatArray) -> LastPose:
        """For any part."""
        return LastPose()


class _LastPose:
    def __init__(self) -> None:
        self._last: FloatArray | None = None

    @property
    def last(self) -> FloatArray:
        """(4, 4) the last pose observed."""
        if self._last is None:
            raise ValueError("no pose observed yet: call restart first")
        return self._last

    def restart(self, cam_T_obj: FloatArray) -> None:
        """Forget the past; the part rests at `cam_T_obj` (4, 4)."""
        self._last = cam_T_obj

    def elapse(self, step: TimeStep) -> None:
        """Nothing: no motion is known."""

    def repeat(self) -> None:
        """Nothing: only a prediction that is a prior does harm where it is wrong."""

    @property
    def motion(self) -> FloatArray | None:
        """None."""
        return None

    @property
    def steps(self) -> float:
        """1."""
        return 1.0

    def information(self) -> FloatArray | None:
        """None."""
        return None

    def innovation_of(self, cam_T_obj: FloatArray) -> float:
        """0."""
        return 0.0

    def sight(self, camera: Camera, centre_px: FloatArray, scatter_px: float, doubt: float) -> None:
        """Nothing: without a covariance it cannot be weighed; methods that combine the two are refused."""

    def is_sure(self, camera: Camera) -> bool:
        """False."""
        return False


class LastPose(_LastPose):
    """The part rests."""

    moves = False

    def observe(self, cam_T_obj: FloatArray, quality: float = 1.0, information: FloatArray | None = None) -> None:
        """Take in the pose (4, 4) of a further frame."""
        self.restart(cam_T_obj)

    def coast(self) -> None:
        """It still rests."""

    def predict(self) -> FloatArray:
        """(4, 4) the last pose."""
        return self.last.copy()


class ConstantVelocity(_LastPose):
    """Constant velocity of the part's centre and constant angular velocity about it, from the last two poses.

    The centre is extrapolated rather than the object frame's origin, which may lie far outside the part.
    """

    def __init__(self, centre_obj: FloatArray, rest_below: float = 0.0) -> None:
        super().__init__()
        self._centre_obj = centre_obj
        self._rest_below = rest_below
        self._before: FloatArray | None = None
        self._is_good = True  # the last pose
        self._step = TimeStep()

    def restart(self, cam_T_obj: FloatArray) -> None:
        """Forget the past; the part rests at `cam_T_obj` (4, 4)."""
        super().restart(cam_T_obj)
        self._before, self._is_good, self._step = None, True, TimeStep()

    @property
    def last(self) -> FloatArray:
        """(4, 4) the last pose observed; where frames were left out since, one usual step before the predicted one."""
        left_out = self._before is not None and self._step.of_usual > 1.0
        return self._after(self._step.of_last * (1.0 - 1.0 / self._step.of_usual)) if left_out else super().last

    def elapse(self, step: TimeStep) -> None:
        """The next frame comes after a step in time: the part goes as far as that lasts; after a long one it rests."""
        self._step = step
        if step.is_long:
            self._before = None

    def observe(self, cam_T_obj: FloatArray, quality: float = 1.0, information: FloatArray | None = None) -> None:
        """Take in the pose (4, 4) of a further frame."""
        before, is_good = self._last if self._is_good else None, quality > self._rest_below
        self.restart(cam_T_obj)
        # A velocity is a difference of two poses that both are believed.
        self._before, self._is_good = before if is_good else None, is_good

    def coast(self) -> None:
        """A frame without an image: the motion goes on."""
        if self._before is not None:
            self._before, self._last, self._step = self._last, self.predict(), TimeStep()

    @property
    def moves(self) -> bool:
        """Whether a motion is known, so that `predict` differs from `last`."""
        return self._before is not None

    @property
    def motion(self) -> FloatArray | None:
        """(6,) the last pose step (rad, mm), of a usual time step; None before there was one."""
        if self._before is None:
            return None
        step = pose_step_between(self._before, super().last, self._centre_obj)
        return self._step.of_last / self._step.of_usual * step

    @property
    def steps(self) -> float:
        """How many usual time steps the predicted one is."""
        return self._step.of_usual

    def predict(self) -> FloatArray:
        """(4, 4) pose expected in the next frame."""
        return self._after(self._step.of_last)

    def _after(self, steps: float) -> FloatArray:
        """(4, 4) so many steps like the last one after the last pose."""
        last, before = super().last, self._before
        if before is None:
            return last.copy()
        # Through the logarithm, which makes it a rotation again: as a bare product, rounding errors
        # would more than double from frame to frame.
        turn = so3_exp(steps * so3_log(last[:3, :3] @ before[:3, :3].T))
        now = transform(last, self._centre_obj)
        centre = (1.0 + steps) * now - steps * transform(before, self._centre_obj)
        predicted = np.eye(4)
        predicted[:3, :3] = turn @ last[:3, :3]
        predicted[:3, 3] = centre - predicted[:3, :3] @ self._centre_obj
        return predicted
