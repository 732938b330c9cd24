"""Files that come from outside, read whole: regular files of a size that memory holds, and JSON objects.

Pipes and devices are refused before they are opened: reading one could wait for ever, or never end.
"""

from __future__ import annotations

import json
import stat
from os import PathLike
from pathlib import Path
from typing import Any

from acp_lab.errors import InputFileError

LARGEST_BYTES = 2 * 1024**3
"""No mesh, image or table of this field comes near it."""
LARGEST_NUMBER = 1e9
"""No pose, camera or mesh holds a larger one (in mm: 1000 km); such a number is as wrong as infinity."""


def path_of(value: object, what: str, example: str) -> Path:
    """The path that an argument is; InputFileError for another kind. what: such as "a mesh file"; example: of one."""
    if not isinstance(value, str | PathLike):
        raise InputFileError(f"{repr(value)[:80]}: is no path of {what}: give one, such as {example!r}")
    return Path(value)


def check_regular(path: Path, fix: str, largest_bytes: float = LARGEST_BYTES) -> None:
    """InputFileError, ending in `fix`, for a pipe, a device or a socket, and for a file beyond largest_bytes.

    A folder and a missing file pass: whoever opens them knows better what was wanted. OSError as `Path.stat`.
    """
    found = path.stat()
    if not (stat.S_ISREG(found.st_mode) or stat.S_ISDIR(found.st_mode)):
        raise InputFileError(f"{path}: is a pipe, a device or a socket, not a file: {fix}")
    if found.st_size > largest_bytes:
        raise InputFileError(f"{path}: has {found.st_size / 1e9:.1f} GB, {largest_bytes / 1e9:.1f} is the most: {fix}")


def read_bytes(path: Path, fix: str = "check the path", what: str = "file") -> bytes:
    """All bytes of a file; InputFileError, ending in `fix`, where that cannot be. what: such as "mesh file"."""
    try:
        check_regular(path, fix)
        return path.read_bytes()
    except FileNotFoundError:
        raise InputFileError(f"{path}: no such {what}: {fix}") from None
    except OSError as error:
        raise InputFileError(f"{path}: cannot be read ({error.strerror}): {fix}") from None


def read_json_object(path: Path, fix: str, what: str = "file") -> dict[str, Any]:
    """The JSON object that a file holds; InputFileError, ending in `fix`, when it holds none."""
    data = read_bytes(path, fix, what)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputFileError(f"{path}: no text in UTF-8: {fix}") from None
    if not text.strip():
        raise InputFileError(f"{path}: the file is empty: {fix}")
    try:
        values = json.loads(text)
    except RecursionError:
        raise InputFileError(f"{path}: not valid JSON (nested too deeply): {fix}") from None
    except ValueError as error:
        # A whole number of more digits than Python reads is told at length.
        raise InputFileError(f"{path}: not valid JSON ({str(error).splitlines()[0][:80]}): {fix}") from None
    if not isinstance(values, dict):
        raise InputFileError(f"{path}: holds no JSON object: {fix}")
    return values


def is_measure(value: object, largest: float = LARGEST_NUMBER) -> bool:
    """Whether a value of a JSON file is a number within +-largest.

    bool is an int in Python, NaN and Infinity are numbers to its JSON reader, and a whole number can be too long for
    a float: none of them is a measure.
    """
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= largest
