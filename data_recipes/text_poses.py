"""Poses as tracking benchmarks write them: a line of text per frame, R row by row and then t, in mm."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from acp_lab.errors import GeometryError, InputFileError
from acp_lab.geometry.pose import check_rotation, make_pose
from acp_lab.input_file import LARGEST_NUMBER

_AGAIN = "unpack or download it again"


def read_poses(path: Path, heading: bool = False) -> list[np.ndarray]:
    """cam_T_obj (4, 4) of each line, mm. heading: whether the first line holds words.

    Raises InputFileError, one line naming file and line, for a file that is missing, empty or malformed and for a
    rotation that is none.
    """
    poses = []
    for number, row in enumerate(table_of(path, heading, columns=12), start=2 if heading else 1):
        try:
            rotation = check_rotation(np.array(row[:9]).reshape(3, 3), f"{path}: line {number}")
        except GeometryError as error:
            raise InputFileError(str(error)) from None
        poses.append(make_pose(rotation, np.array(row[9:])))
    return poses


def table_of(path: Path, heading: bool, columns: int | None) -> list[list[float]]:
    """The numbers of each line; columns: how many there must be, None for at least four. Errors as `read_poses`."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except FileNotFoundError:
        raise InputFileError(f"{path}: no such file: {_AGAIN}") from None
    except UnicodeDecodeError:
        raise InputFileError(f"{path}: no text: {_AGAIN}") from None
    rows = []
    for number, line in enumerate(lines, start=1):
        if not line.strip() or (heading and number == 1):
            continue
        try:
            row = [float(word) for word in line.split()]
        except ValueError:
            row = []
        right = len(row) == columns if columns else len(row) >= 4
        if not right or not (np.abs(row) <= LARGEST_NUMBER).all():
            raise InputFileError(
                f"{path}: line {number} is '{line.strip()[:50]}': must hold {columns or 'at least 4'} numbers: {_AGAIN}"
            )
        rows.append(row)
    if not rows:
        raise InputFileError(f"{path}: holds no numbers: {_AGAIN}")
    return rows
