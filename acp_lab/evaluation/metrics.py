"""Pose errors and the scores made of them: pure functions on arrays.

Convention: poses are cam_T_obj (4, 4), points (n, 3) in the object frame, lengths mm, angles degrees. A frame
without an estimate has infinite errors, so it fails every threshold, and its time is NaN. Shares are in [0,
1]. A score of no frames is NaN.

Sources: ADD and ADD-S, S. Hinterstoisser et al., "Model based training, detection and pose estimation of
texture-less 3D objects in heavily cluttered scenes" (ACCV 2012), eq. 8 and 9; 5 cm 5 degrees, J. Shotton et
al., "Scene coordinate regression forests" (CVPR 2013); area under the accuracy curve, Y. Xiang et al.,
"PoseCNN" (2018).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from acp_lab.cad.models_info import Symmetries
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import inverse, make_pose, rotation_angle_deg, so3_exp, transform

LOST_SHARE = 0.3
"""Share of the diameter that ADD must exceed for an object to count as lost."""
AUC_SHARE = 0.1
"""Share of the diameter at which the accuracy curve ends."""


def add_mm(points_obj: FloatArray, cam_T_est: FloatArray, cam_T_true: FloatArray) -> float:
    """ADD: mean distance between each point (n, 3) under the estimate and the same point under the truth.

    Example:
        >>> points, true = np.random.default_rng(0).normal(size=(50, 3)), np.eye(4)
        >>> off = np.eye(4)
        >>> off[2, 3] = 3.0
        >>> round(add_mm(points, off, true), 6)  # a shift moves every point as far
        3.0
    """
    # (R x + t) - (R' x + t') in one product.
    difference = cam_T_est[:3] - cam_T_true[:3]
    return float(np.linalg.norm(points_obj @ difference[:, :3].T + difference[:, 3], axis=1).mean())


def adds_mm(
    points_obj: FloatArray, cam_T_est: FloatArray, cam_T_true: FloatArray, tree: cKDTree | None = None
) -> float:
    """ADD-S: mean distance from each point (n, 3) under the truth to the *nearest* point under the estimate.

    tree: a cKDTree of the points that may be nearest, to be made once when many frames are scored; of points_obj by
    default. The true points are brought into the estimate's object frame instead of moving the tree; distances stay
    what they are.
    """
    nearest = cKDTree(points_obj) if tree is None else tree
    distances, _ = nearest.query(transform(inverse(cam_T_est) @ cam_T_true, points_obj))
    return float(distances.mean())


@dataclass(frozen=True)
class PoseError:
    """How far an estimate is from the truth: the angle between the rotations, the distance of the origins."""

    rotation_deg: float
    translation_mm: float


def pose_error(cam_T_est: FloatArray, cam_T_true: FloatArray, symmetries: Symmetries | None = None) -> PoseError:
    """Rotation and translation error of an estimate.

    For a symmetric object the truth is any of cam_T_true @ S, and that with the smallest rotation error
    counts, for the translation too (S moves the origin when the axis of symmetry does not pass through it). S
    runs over the discrete symmetries, each followed by no turn or by the best turn about one continuous axis;
    that turn is exact, no step size limits it.

    Example:
        >>> off = np.eye(4)
        >>> off[0, 3] = 2.0
        >>> pose_error(off, np.eye(4))
        PoseError(rotation_deg=0.0, translation_mm=2.0)
    """
    return _plain_error(cam_T_est, closest_truth(cam_T_est, cam_T_true, symmetries))


def closest_truth(cam_T_est: FloatArray, cam_T_true: FloatArray, symmetries: Symmetries | None = None) -> FloatArray:
    """The true pose (4, 4) that an estimate is held against: the one that `pose_error` chooses."""
    if not symmetries:
        return cam_T_true

    def apart(candidate: FloatArray) -> tuple[float, float]:
        error = _plain_error(cam_T_est, candidate)
        return error.rotation_deg, error.translation_mm

    return min(_equivalent_truths(cam_T_est, cam_T_true, symmetries), key=apart)


def rotation_error_deg(cam_T_est: FloatArray, cam_T_true: FloatArray, symmetries: Symmetries | None = None) -> float:
    """Angle between the two rotations, 0 to 180 degrees; the smallest over the symmetries, see
    `pose_error`."""
    return pose_error(cam_T_est, cam_T_true, symmetries).rotation_deg


def translation_error_mm(cam_T_est: FloatArray, cam_T_true: FloatArray, symmetries: Symmetries | None = None) -> float:
    """Distance of the two object origins, mm; under the symmetry that `pose_error` chooses."""
    return pose_error(cam_T_est, cam_T_true, symmetries).translation_mm


def recall(errors: FloatArray, limit: float) -> float:
    """Share of the errors (n,) strictly below a limit of the same unit.

    Example:
        >>> recall(np.array([0.01, 0.015, 0.03, np.inf]), limit=0.02)
        0.5
    """
    return float((errors < limit).mean()) if len(errors) else math.nan


def area_under_curve(errors: FloatArray, limit: float) -> float:
    """Area under recall(errors, x) for x from 0 to limit, divided by limit: 1 when all errors are 0.

    Exact: an error e < limit adds 1 to the curve from e on, hence (limit - e) to the area.
    """
    return float(np.clip(1.0 - errors / limit, 0.0, 1.0).mean()) if len(errors) else math.nan


def frames_until_lost(errors: FloatArray, limit: float) -> int:
    """How many errors (n,), in the order of the frames, come before the first above the limit; n when none
    is.

    Example:
        >>> frames_until_lost(np.array([0.01, 0.02, 0.5, 0.01]), limit=0.3)
        2
    """
    lost = np.flatnonzero(~(errors <= limit))
    return int(lost[0]) if len(lost) else len(errors)


@dataclass(frozen=True, eq=False)
class FrameErrors:
    """The errors of one object in n evaluated frames, in their order; infinite where there is no estimate.

    frame_ids: (n,) image ids. distance: (n,) ADD or ADD-S as a share of the diameter. rotation_deg: (n,).
    translation_mm: (n,). time_s: (n,), NaN where it is unknown.
    """

    frame_ids: tuple[int, ...]
    distance: FloatArray
    rotation_deg: FloatArray
    translation_mm: FloatArray
    time_s: FloatArray


@dataclass(frozen=True)
class Scores:
    """Scores over `frames` frames; NaN where a score is undefined.

    recall_2, recall_5, recall_10: share of frames with ADD(-S) strictly below 2, 5, 10% of the diameter.
    auc_10pct: normalised area under the recall curve up to 10% of the diameter. cm5deg5: share of frames
    below 5 cm and 5 degrees. rot_deg_median, trans_mm_median: over all frames, so infinite when most have no
    estimate. frames_until_lost: frames before the first with ADD(-S) above 30% of the diameter or without
    estimate. time_s_median: over the frames whose time is known.
    """

    frames: int
    recall_2: float
    recall_5: float
    recall_10: float
    auc_10pct: float
    cm5deg5: float
    rot_deg_median: float
    trans_mm_median: float
    frames_until_lost: int
    time_s_median: float


def scores(errors: FrameErrors) -> Scores:
    """The scores of one object."""
    return pooled_scores([errors])


def pooled_scores(objects: Iterable[FrameErrors]) -> Scores:
    """The scores over the frames of several objects, each frame counting once.

    frames_until_lost is the sum over the objects; divided by `frames` it is the share of frames before
    the object was lost.
    """
    objects = list(objects)
    distance = _joined([errors.distance for errors in objects])
    rotation_deg = _joined([errors.rotation_deg for errors in objects])
    translation_mm = _joined([errors.translation_mm for errors in objects])
    time_s = _joined([errors.time_s for errors in objects])
    near = (translation_mm < 50.0) & (rotation_deg < 5.0)
    return Scores(
        frames=len(distance),
        recall_2=recall(distance, 0.02),
        recall_5=recall(distance, 0.05),
        recall_10=recall(distance, 0.10),
        auc_10pct=area_under_curve(distance, AUC_SHARE),
        cm5deg5=float(near.mean()) if len(near) else math.nan,
        rot_deg_median=_median(rotation_deg),
        trans_mm_median=_median(translation_mm),
        frames_until_lost=sum(frames_until_lost(errors.distance, LOST_SHARE) for errors in objects),
        time_s_median=_median(time_s[np.isfinite(time_s)]),
    )


def _plain_error(cam_T_est: FloatArray, cam_T_true: FloatArray) -> PoseError:
    """The error against one true pose, symmetries left aside."""
    return PoseError(
        rotation_angle_deg(cam_T_true[:3, :3], cam_T_est[:3, :3]),
        float(np.linalg.norm(cam_T_true[:3, 3] - cam_T_est[:3, 3])),
    )


def _equivalent_truths(cam_T_est: FloatArray, cam_T_true: FloatArray, symmetries: Symmetries) -> list[FloatArray]:
    """cam_T_true @ S (4, 4) for the symmetries S that can be nearest to the estimate."""
    truths = []
    for discrete in (np.eye(4), *symmetries.discrete):
        truths.append(cam_T_true @ discrete)
        # What a turn about a continuous axis, done after the discrete symmetry, has to make up for.
        needed = cam_T_true[:3, :3].T @ cam_T_est[:3, :3] @ discrete[:3, :3].T
        for axis, offset in symmetries.continuous:
            turn = _best_turn(needed, np.asarray(axis, dtype=np.float64))
            origin = np.asarray(offset, dtype=np.float64)
            truths.append(cam_T_true @ make_pose(turn, origin - turn @ origin) @ discrete)
    return truths


def _best_turn(rotation: FloatArray, axis: FloatArray) -> FloatArray:
    """The turn (3, 3) about an axis (3,) that is nearest to a rotation (3, 3).

    It maximises trace(turn^T rotation) = const + sin(angle) a.v + cos(angle) (trace - a.R a), where v holds
    the antisymmetric part of the rotation.
    """
    a = axis / np.linalg.norm(axis)
    v = np.array([rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]])
    return so3_exp(math.atan2(a @ v, np.trace(rotation) - a @ rotation @ a) * a)


def _joined(parts: list[FloatArray]) -> FloatArray:
    return np.concatenate(parts) if parts else np.zeros(0)


def _median(values: FloatArray) -> float:
    return float(np.median(values)) if len(values) else math.nan


def number_cell(value: float, digits: int) -> str:
    """A number in a table, "-" for one that is not finite."""
    return f"{value:.{digits}f}" if math.isfinite(value) else "-"
