"""Whose error is it? What two trackers have in common beside the truth.

Trackers that go by different cues, one by edges and one by regions, err each in its own way. Where they err alike, in
the same frames and to the same side, and agree with each other better than either does with the truth, the cause is
what they share: the image, the mesh, the camera's parameters, or the truth itself. An error that grows with the speed
along one axis of the camera, and along no other, is one of time: of the truth's depth, say, where another camera told
it. What one tracker's errors say of the truth's depth can be tried on the other's, which had no part in it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from acp_lab.cad.part import Part
from acp_lab.errors import ParameterError
from acp_lab.evaluation.part_metric import PartMetric
from acp_lab.geometry.arrays import FloatArray, IntArray
from acp_lab.geometry.pose import transform

_FEWEST = 3


@dataclass(frozen=True)
class DepthShift:
    """A shift of poses along the camera's axis: by the same in every frame, and by some frames in time.

    Attributes:
        offset_mm: away from the camera. frames: of motion in depth, ahead; negative for late.
    """

    offset_mm: float
    frames: float


@dataclass(frozen=True, eq=False)
class SharedErrors:
    """Two trackers beside the truth, in the n frames in which all three are known.

    Attributes:
        frame_ids: (n,) their numbers.
        first, second: (n,) ADD (ADD-S for a symmetric part) of each from the truth, as shares of the diameter.
        apart: (n,) of the first from the second.
        first_mm, second_mm: (n, 3) where the box's centre is beside its true place, along the camera's axes.
        motion_mm: (n, 3) how far it truly moves per frame there, from the frames before and after; NaN where one of
            these is unknown.
    """

    frame_ids: IntArray
    first: FloatArray
    second: FloatArray
    apart: FloatArray
    first_mm: FloatArray
    second_mm: FloatArray
    motion_mm: FloatArray

    @property
    def correlation(self) -> FloatArray:
        """(3,) correlation of the two's errors along the camera's x, y and z; NaN where one of them never varies."""
        pairs = zip(self.first_mm.T, self.second_mm.T, strict=True)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.array([np.corrcoef(first, second)[0, 1] for first, second in pairs])

    @property
    def first_lead(self) -> FloatArray:
        """(3,) frames by which the first runs ahead of the truth along the camera's x, y and z, by least squares.

        NaN along an axis along which the part never changes its speed.
        """
        return _lead(self.first_mm, self.motion_mm)

    @property
    def second_lead(self) -> FloatArray:
        """(3,) the same of the second."""
        return _lead(self.second_mm, self.motion_mm)

    @property
    def depth_shifts(self) -> tuple[DepthShift, DepthShift]:
        """From the truth's depth to the first's, and to the second's, by least squares."""
        return _depth_shift(self.first_mm, self.motion_mm), _depth_shift(self.second_mm, self.motion_mm)


def shared_errors(
    part: Part, truth: Mapping[int, FloatArray], first: Mapping[int, FloatArray], second: Mapping[int, FloatArray]
) -> SharedErrors:
    """Compare two trackers' poses (4, 4) with the truth and with each other; all by frame number.

    Raises ParameterError where fewer than three frames are known of all three.
    """
    frames = sorted(set(truth) & set(first) & set(second))
    if len(frames) < _FEWEST:
        raise ParameterError(f"{part.name}: {len(frames)} frames have a true pose and one of each tracker: give three")
    metric = PartMetric(part)

    def centres(poses: Mapping[int, FloatArray]) -> FloatArray:
        return np.array([transform(poses[k], part.box_centre) for k in frames])

    def errors(of: Mapping[int, FloatArray], beside: Mapping[int, FloatArray]) -> FloatArray:
        return np.array([metric.share(of[k], beside[k]) for k in frames])

    true_places = centres(truth)
    return SharedErrors(
        np.array(frames),
        errors(first, truth),
        errors(second, truth),
        errors(first, second),
        centres(first) - true_places,
        centres(second) - true_places,
        np.array([_motion_mm(truth, k, part) for k in frames]),
    )


def shifted_in_depth(poses: Mapping[int, FloatArray], shift: DepthShift, part: Part) -> dict[int, FloatArray]:
    """Poses (4, 4) by frame number, shifted in depth; frames whose neighbours are unknown are left out."""
    shifted = {}
    for number, pose in poses.items():
        depth_mm = _motion_mm(poses, number, part)[2]
        if np.isfinite(depth_mm):
            shifted[number] = pose.copy()
            shifted[number][2, 3] += shift.offset_mm + shift.frames * depth_mm
    return shifted


def joined(studies: list[SharedErrors]) -> SharedErrors:
    """Those of several sequences as one."""
    names = ("frame_ids", "first", "second", "apart", "first_mm", "second_mm", "motion_mm")
    return SharedErrors(*(np.concatenate([getattr(study, name) for study in studies]) for name in names))


def _motion_mm(poses: Mapping[int, FloatArray], number: int, part: Part) -> FloatArray:
    """(3,) how far the box's centre moves per frame there, along the camera's axes; NaN beside unknown frames."""
    if number - 1 not in poses or number + 1 not in poses:
        return np.full(3, np.nan)
    before, after = (transform(poses[number + step], part.box_centre) for step in (-1, 1))
    return (after - before) / 2.0


def _depth_shift(errors_mm: FloatArray, motion_mm: FloatArray) -> DepthShift:
    lead = float(_lead(errors_mm, motion_mm)[2])
    known = np.isfinite(motion_mm).all(1)
    # Where the speed never changes an offset says it all.
    lead = lead if np.isfinite(lead) else 0.0
    offset = (errors_mm - lead * motion_mm)[known, 2] if known.any() else errors_mm[:, 2]
    return DepthShift(float(offset.mean()), lead)


def _lead(errors_mm: FloatArray, motion_mm: FloatArray) -> FloatArray:
    known = np.isfinite(motion_mm).all(1)
    errors_mm, motion_mm = errors_mm[known], motion_mm[known]
    if not len(errors_mm):
        return np.full(3, np.nan)
    motion_mm = motion_mm - motion_mm.mean(0)
    power = (motion_mm**2).sum(0)
    shared = (motion_mm * (errors_mm - errors_mm.mean(0))).sum(0)
    return np.divide(shared, power, out=np.full(3, np.nan), where=power > 0.0)
