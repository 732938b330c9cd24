"""The true poses of a BOP scene: scene_gt.json, read and checked once.

Convention: BOP's cam_R_m2c and cam_t_m2c (model to camera, mm) are our cam_T_obj.
Source of the format: BOP toolkit, docs/bop_datasets_format.md.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from pathlib import Path

import numpy as np

from acp_lab.errors import InputFileError, SequenceError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.input_file import read_json_object
from acp_lab.sequences.json_file import pose_of, shown

_MEND = 'it lists per image the poses [{"cam_R_m2c": [9], "cam_t_m2c": [3], "obj_id": 1}]'


class SceneTruth:
    """True poses by (image id, object id); at most one instance of an object in an image."""

    def __init__(self, poses: Mapping[tuple[int, int], FloatArray]) -> None:
        self._poses = dict(poses)
        self.object_ids: tuple[int, ...] = tuple(sorted({object_id for _, object_id in self._poses}))
        """Every object that some image shows."""

    @classmethod
    def from_file(cls, path: Path, asked: Collection[int] | None = None) -> SceneTruth:
        """Read scene_gt.json whole.

        asked: objects whose poses are asked for, None for all; of others only their ids are to be relied on.
        Raises InputFileError when it is missing or malformed, SequenceError when an image shows two instances
        of an object that is asked for: nothing could tell their tracks apart.
        """
        poses: dict[tuple[int, int], FloatArray] = {}
        for frame_id, object_id, pose in _entries(path):
            if (frame_id, object_id) in poses and (asked is None or object_id in asked):
                raise SequenceError(
                    f"{path}: image {frame_id} shows object {object_id} more than once: give the instances different "
                    "ids, or drop one"
                )
            poses[frame_id, object_id] = pose
        return cls(poses)

    def pose(self, frame_id: int, object_id: int) -> FloatArray | None:
        """cam_T_obj (4, 4), a copy, or None when the file has none."""
        pose = self._poses.get((frame_id, object_id))
        return None if pose is None else pose.copy()

    def in_frame(self, frame_id: int) -> dict[int, FloatArray]:
        """cam_T_obj (4, 4) by object id, ids rising; empty when the image has no truth."""
        found = {object_id: self.pose(frame_id, object_id) for object_id in self.object_ids}
        return {object_id: pose for object_id, pose in found.items() if pose is not None}


def instance_truths(path: Path) -> dict[int, tuple[SceneTruth, ...]]:
    """The truth of each instance of each object of a scene_gt.json, in the order of the first image that shows it.

    From image to image an instance is the one whose origin is nearest to where it was last, all instances together
    (Hungarian assignment); two parts cannot be in one place. One that appears later than the others is left out: no
    start pose tells it apart. Raises InputFileError as `SceneTruth.from_file`.
    """
    # Here, as it takes a while, and who tracks one part never gets here.
    from scipy.optimize import linear_sum_assignment

    by_frame: dict[int, dict[int, list[FloatArray]]] = {}
    for frame_id, object_id, pose in _entries(path):
        by_frame.setdefault(object_id, {}).setdefault(frame_id, []).append(pose)
    found = {}
    for object_id, frames in sorted(by_frame.items()):
        first = min(frames)
        last = dict(enumerate(frames[first]))
        poses: list[dict[tuple[int, int], FloatArray]] = [{} for _ in last]
        for frame_id, seen in sorted(frames.items()):
            apart_mm = [[np.linalg.norm(pose[:3, 3] - before[:3, 3]) for pose in seen] for before in last.values()]
            for instance, entry in zip(*linear_sum_assignment(np.array(apart_mm)), strict=True):
                poses[instance][frame_id, object_id] = last[int(instance)] = seen[entry]
        found[object_id] = tuple(SceneTruth(of_instance) for of_instance in poses)
    return found


def _entries(path: Path) -> Iterator[tuple[int, int, FloatArray]]:
    """(image id, object id, cam_T_obj) of every entry of a scene_gt.json, in its order."""
    for key, entries in read_json_object(path, _MEND).items():
        frame_id = as_id(key, f"{path}: the image id")
        if not isinstance(entries, list):
            raise InputFileError(f"{path}: image {frame_id} has no list of poses: {_MEND}")
        for entry in entries:
            where = f"{path}: image {frame_id}"
            if not isinstance(entry, dict) or "obj_id" not in entry:
                raise InputFileError(f"{where} has a pose without obj_id: {_MEND}")
            object_id = as_id(entry["obj_id"], f"{where}: obj_id")
            yield frame_id, object_id, pose_of(entry, f"{where}, object {object_id}")


def as_id(value: object, where: str) -> int:
    """A whole number from 0 of a JSON key or value; InputFileError naming `where` otherwise."""
    if isinstance(value, int) and not isinstance(value, bool) and 0 <= value < 10**18:
        return value
    if isinstance(value, str) and value.isascii() and value.isdigit() and len(value) < 19:
        return int(value)
    raise InputFileError(f"{where} is {shown(value)}: give a whole number from 0")
