"""Reading and writing the small JSON files around a sequence, with errors that name file, value and fix.

Convention: poses are named as in BOP, `cam_R_m2c` (nine numbers, row by row) and `cam_t_m2c` (mm), which
are the rotation and translation of cam_T_obj.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from acp_lab.errors import GeometryError, InputFileError
from acp_lab.files import check_place, write_whole
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import check_rotation, make_pose
from acp_lab.input_file import is_measure, path_of, read_json_object

_POSE_EXAMPLE = '{"cam_R_m2c": [1, 0, 0, 0, 1, 0, 0, 0, 1], "cam_t_m2c": [0, 0, 500]}'


def numbers(values: object, count: int, where: str) -> FloatArray:
    """(count,) float64 of a JSON list of finite numbers; InputFileError naming `where` otherwise."""
    if not isinstance(values, list) or len(values) != count:
        raise InputFileError(f"{where} is {shown(values)}: give a list of {count} numbers")
    for value in values:
        if not is_measure(value):
            raise InputFileError(f"{where} holds {shown(value)}: give {count} finite numbers")
    return np.array(values, dtype=np.float64)


def pose_of(values: object, where: str) -> FloatArray:
    """cam_T_obj (4, 4) of {"cam_R_m2c": [9], "cam_t_m2c": [3]}; InputFileError naming `where` otherwise."""
    if not isinstance(values, dict):
        raise InputFileError(f"{where} is {shown(values)}: write a pose as {_POSE_EXAMPLE}")
    missing = [key for key in ("cam_R_m2c", "cam_t_m2c") if key not in values]
    if missing:
        raise InputFileError(f"{where} lacks {' and '.join(missing)}: write a pose as {_POSE_EXAMPLE}")
    matrix = numbers(values["cam_R_m2c"], 9, f"{where}: cam_R_m2c").reshape(3, 3)
    translation = numbers(values["cam_t_m2c"], 3, f"{where}: cam_t_m2c")
    try:
        return make_pose(check_rotation(matrix, f"{where}: cam_R_m2c"), translation)
    except GeometryError as error:
        raise InputFileError(str(error)) from None


def read_pose(path: str | Path) -> FloatArray:
    """cam_T_obj (4, 4) of a POSE.json; raises InputFileError, one line, for whatever is wrong with the
    file."""
    path = path_of(path, "a pose file", "POSE.json")
    return pose_of(_pose_object(path), f"{path}: the pose")


def was_found(path: str | Path) -> bool:
    """Whether a POSE.json says that its pose was found in the image, as by snap: `"found": true`.

    InputFileError for a file that holds no JSON object.
    """
    return _pose_object(Path(path)).get("found") is True


def write_pose(path: str | Path, cam_T_obj: FloatArray, found: bool = False) -> None:
    """Write a pose (4, 4), mm, as the POSE.json that `read_pose` reads, also in place of an older one.

    found: whether it was found in the image, see `Tracker.start`; the file says so.
    InputFileError when that cannot be, and rather than replace a file that holds no pose.
    """
    path = Path(path)
    check_place(path, "the pose")
    if path.is_file() and path.stat().st_size and not _is_pose(path):
        raise InputFileError(f"{path}: the pose would replace a file that is not a pose: choose another name")
    values = {"cam_R_m2c": cam_T_obj[:3, :3].ravel().tolist(), "cam_t_m2c": cam_T_obj[:3, 3].tolist()}
    write_json(path, values | {"found": True} if found else values)


def _pose_object(path: Path) -> dict[str, Any]:
    return read_json_object(path, f"write the start pose as {_POSE_EXAMPLE}")


def _is_pose(path: Path) -> bool:
    try:
        read_pose(path)
    except InputFileError:
        return False
    return True


def write_json(path: str | Path, values: Mapping[str, Any]) -> None:
    """Write a JSON object whole or not at all; InputFileError when the place cannot be written; see `json_bytes`."""
    write_whole(Path(path), json_bytes(values))


def json_bytes(values: Mapping[str, Any]) -> bytes:
    """What a JSON file of these values holds.

    NaN and infinity are not JSON: they raise ValueError, for the caller to say what stands for them.
    """
    return (json.dumps(values, indent=2, allow_nan=False) + "\n").encode()


def shown(value: object) -> str:
    """A value as a message shows it: on one line, cut when long."""
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # a number of thousands of digits, brackets in brackets
        text = f"a {type(value).__name__} too long to show"
    return text if len(text) <= 60 else text[:57] + "..."
