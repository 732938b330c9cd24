"""Quadratic priors beside what the image says; each is bound at the start of a level.

No balance between radians and millimetres has to be chosen (the unit problem of paper Fig. 1): damping and rigidity are
in px of the control points, the motion prior in standard deviations of the prediction.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from acp_lab.errors import TrackingError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose_step import pose_step_between
from acp_lab.tracking.frame_view import Estimate
from acp_lab.tracking.motions import ControlPointVariables, PoseVariables
from acp_lab.tracking.solvers import NormalEquations, Prior


@dataclass(frozen=True)
class ControlPointDamping:
    """Configuration: each step is damped by how far it moves the control points. weight: per squared px of their mean
    motion."""

    kind: ClassVar[str] = "control-point-damping"
    weight: float = 2e-3

    def __post_init__(self) -> None:
        _check(self.weight)

    def bind(self, variables: ControlPointVariables | PoseVariables, at: Estimate) -> Prior:
        """The prior of a level that starts at an estimate."""
        # Half of the Jacobian: the mean over four points, so that the weight is per px of one.
        return _StepDamping(self.weight, 0.5 * variables.control_jacobian(at))


@dataclass(frozen=True)
class MotionPrior:
    """Configuration: the pose stays near the predicted one, the nearer the surer the prediction is.

    Control points as variables are held by the pose next to them; what no rigid motion makes of them stays free.

    Attributes:
        weight: of the prediction's information. Less than 1, as its error is no new one in each frame: a motion that
            changes is predicted wrongly for several frames in the same direction.
    """

    kind: ClassVar[str] = "motion"
    weight: float = 0.35

    def __post_init__(self) -> None:
        _check(self.weight)

    def bind(self, variables: ControlPointVariables | PoseVariables, at: Estimate) -> Prior | None:
        """The prior of a level; None where the prediction does not know how sure it is."""
        information = at.view.prior_information
        if information is None:
            return None
        return _MotionPrior(self.weight * information, variables.pose_jacobian(at))


@dataclass(frozen=True)
class TikhonovPrior:
    """Configuration: each step is damped by fixed amounts, as in SRT3D; what the image sees clearly is hardly held.

    Attributes:
        rotation: information per squared radian; translation: per squared mm, about the part's centre, of parts of
            usual size, see `part_size`.
    """

    kind: ClassVar[str] = "tikhonov"
    in_mm: ClassVar[Mapping[str, int]] = {"translation": -2}
    rotation: float = 2000.0
    translation: float = 0.1

    def __post_init__(self) -> None:
        for name in ("rotation", "translation"):
            if not 0.0 <= getattr(self, name) < float("inf"):
                raise TrackingError(f"priors.{name} = {getattr(self, name):g}: give 0 or more")

    def bind(self, variables: ControlPointVariables | PoseVariables, at: Estimate) -> Prior:
        """The prior of a level that starts at an estimate."""
        jacobian = variables.pose_jacobian(at)
        information = np.repeat([self.rotation, self.translation], 3)
        return _Tikhonov(jacobian.T @ (information[:, None] * jacobian))


@dataclass(frozen=True)
class RigidityPrior:
    """Configuration: I stays near what a rigid part can show; for control points as variables. weight: per px^2."""

    kind: ClassVar[str] = "rigidity"
    weight: float = 0.05

    def __post_init__(self) -> None:
        _check(self.weight)

    def bind(self, variables: ControlPointVariables | PoseVariables, at: Estimate) -> Prior:
        """The prior of a level that starts at an estimate; GeometryError where I is degenerate."""
        view = at.view
        basis, _ = np.linalg.qr(view.control_jacobian(at.cam_T_obj), mode="complete")
        rigid = view.at_pose(at.cam_T_obj).control_points.reshape(8)
        return _Rigidity(self.weight, rigid, basis[:, 6:].T)


class PosePrior:
    """A prior of k variables that is known by its information alone.

    relative: (k, k), against what the image says in all; absolute: (k, k), as it is; towards: (k, 6), how it pulls by
    the pose step to the view's prior pose. See `pose_descent.PoseLevel`.
    """

    def __init__(self, relative: FloatArray, absolute: FloatArray, towards: FloatArray) -> None:
        self.relative, self.absolute, self.towards = relative, absolute, towards


def sum_of(priors: Sequence[Prior]) -> PosePrior | None:
    """The priors of a pose's six variables as one; None where one is known by more than its information."""
    relative, absolute, towards = np.zeros((3, 6, 6))
    for prior in priors:
        if not isinstance(prior, PosePrior):
            return None
        relative, absolute = relative + prior.relative, absolute + prior.absolute
        towards = towards + prior.towards
    return PosePrior(relative, absolute, towards)


class _StepDamping(PosePrior):
    """Zero residual wherever the estimate is: moving on costs. jacobian: (8, k) of the control points."""

    def __init__(self, weight: float, jacobian: FloatArray) -> None:
        hessian: FloatArray = weight * jacobian.T @ jacobian
        super().__init__(hessian, np.zeros_like(hessian), np.zeros((len(hessian), 6)))

    def equations(self, at: Estimate, total: float) -> NormalEquations:
        """The same at every step."""
        return NormalEquations(self.relative, np.zeros(len(self.relative)))

    def loss(self, at: Estimate, total: float) -> float:
        """0."""
        return 0.0


class _Tikhonov(PosePrior):
    """Zero residual wherever the estimate is. hessian: (k, k) information of the variables."""

    def __init__(self, hessian: FloatArray) -> None:
        super().__init__(np.zeros_like(hessian), hessian, np.zeros((len(hessian), 6)))

    def equations(self, at: Estimate, total: float) -> NormalEquations:
        """The same at every step, against what the image says in all."""
        return NormalEquations(self.absolute / total, np.zeros(len(self.absolute)))

    def loss(self, at: Estimate, total: float) -> float:
        """0."""
        return 0.0


class _Rigidity:
    """The two directions of I that no rigid motion makes.

    rigid: (8,) I of the pose of the level's start; jacobian: (2, 8) unit rows across all rigid motions there.
    """

    def __init__(self, weight: float, rigid: FloatArray, jacobian: FloatArray) -> None:
        self._weight, self._rigid, self._jacobian = weight, rigid, jacobian
        self._hessian: FloatArray = weight * jacobian.T @ jacobian

    def equations(self, at: Estimate, total: float) -> NormalEquations:
        """Towards the rigid I."""
        return NormalEquations(self._hessian, self._weight * self._jacobian.T @ self._residual(at))

    def loss(self, at: Estimate, total: float) -> float:
        """Half the weighted squared distance, px."""
        return 0.5 * self._weight * float((self._residual(at) ** 2).sum())

    def _residual(self, at: Estimate) -> FloatArray:
        rest: FloatArray = self._jacobian @ (self._rigid - at.control_points.reshape(8))
        return rest


class _MotionPrior(PosePrior):
    """information: (6, 6) of the predicted pose, by a pose step about the part's centre (rad, mm).

    jacobian: (6, k) of a pose step by the variables.
    """

    def __init__(self, information: FloatArray, jacobian: FloatArray) -> None:
        towards: FloatArray = jacobian.T @ information
        hessian: FloatArray = towards @ jacobian
        super().__init__(np.zeros_like(hessian), hessian, towards)
        self._information = information

    def equations(self, at: Estimate, total: float) -> NormalEquations:
        """Towards the predicted pose, against what the image says in all."""
        return NormalEquations(self.absolute / total, self.towards @ self._residual(at) / total)

    def loss(self, at: Estimate, total: float) -> float:
        """Half the normalised squared distance, against what the image says in all, px^2."""
        rest = self._residual(at)
        return 0.5 * float(rest @ self._information @ rest) / total

    def _residual(self, at: Estimate) -> FloatArray:
        view = at.view
        return pose_step_between(at.cam_T_obj, view.prior, view.part.box_centre)


def _check(weight: float) -> None:
    if not 0.0 < weight < float("inf"):
        raise TrackingError(f"priors.weight = {weight:g}: give a number above 0, or leave the prior out")
