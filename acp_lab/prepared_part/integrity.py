"""Checksums: a prepared part is, byte for byte, what `prepare` wrote.

Nothing else notices a part that was changed: with its edge points scaled by 5% a tracker follows the image with the
same confidence, at a wrong distance. part.json holds the SHA-256 of every other file under "files" and, under
"checksum", that of all its own values.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from safetensors.numpy import load as deserialise

from acp_lab.errors import PreparationError
from acp_lab.files import write_changed
from acp_lab.input_file import read_bytes

SUFFIX = ".safetensors"
_FILES, _OWN = "files", "checksum"
_OF_PREPARATION = ("options", "cpu_s", "generators", "control_points")
"""What part.json tells of how the part was prepared, how long that took and how good it became; of what was trained,
the files themselves count."""


def checksum(content: bytes) -> str:
    """The SHA-256 of a file's content, in hexadecimal digits."""
    return hashlib.sha256(content).hexdigest()


def checksum_of_values(values: Any) -> str:
    """The checksum of anything that JSON can hold: not of a text, as spaces and order are no change."""
    return checksum(json.dumps(values, sort_keys=True).encode())


def sealed(header: Mapping[str, Any], contents: Mapping[str, bytes]) -> dict[str, Any]:
    """The values of part.json with the checksums of all files, `contents` by name, and of the values themselves."""
    files = {name: checksum(content) for name, content in sorted(contents.items())}
    values = {**_without_own(header), _FILES: files}
    return {**values, _OWN: checksum_of_values(values)}


def check_sealed(header: Mapping[str, Any]) -> None:
    """PreparationError when values of part.json were changed."""
    if header.get(_OWN) != checksum_of_values(_without_own(header)):
        raise PreparationError("part.json has changed since it was prepared: its checksum differs")


def checksum_for_poses(header: Mapping[str, Any]) -> str:
    """The checksum of all that poses depend on in a part.json: its files and measures, not how they were asked for."""
    return checksum_of_values({k: v for k, v in _without_own(header).items() if k not in _OF_PREPARATION})


def changes(header: Mapping[str, Any], contents: Mapping[str, bytes]) -> bool:
    """Whether files that a part.json names would get another content."""
    stored = header.get(_FILES, {})
    return any(name in stored and stored[name] != checksum(content) for name, content in contents.items())


def add_checksums(folder: Path, header: Mapping[str, Any], version: int) -> None:
    """Take the files of a part without checksums for what they are, and write its part.json anew, of `version`."""
    contents = {path.name: read_bytes(path) for path in folder.glob(f"*{SUFFIX}")}
    write_header(folder, {**header, "version": version}, contents)


def write_header(folder: Path, header: Mapping[str, Any], contents: Mapping[str, bytes]) -> None:
    """Write part.json, sealed; see `sealed`. InputFileError when it cannot be written."""
    write_changed(folder / "part.json", header_bytes(header, contents))


def header_bytes(header: Mapping[str, Any], contents: Mapping[str, bytes]) -> bytes:
    """What part.json holds, sealed; see `sealed`."""
    return (json.dumps(sealed(header, contents), indent=2) + "\n").encode()


def read_arrays(folder: Path, header: Mapping[str, Any], stem: str) -> dict[str, np.ndarray]:
    """The arrays of one file of a prepared part.

    Raises:
        PreparationError: its checksum is not that in part.json, or it holds NaN or infinity.
        AcpLabError, OSError, SafetensorError: it cannot be read.
    """
    name = stem + SUFFIX
    content = read_bytes(folder / name)
    if header[_FILES].get(name) != checksum(content):
        raise PreparationError(f"{name} has changed since it was prepared: its checksum differs")
    arrays: dict[str, np.ndarray] = deserialise(content)
    for key, values in arrays.items():
        if values.dtype.kind == "f" and not np.isfinite(values).all():
            raise PreparationError(f"{name}: {key} holds NaN or infinity")
    return arrays


def _without_own(header: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in header.items() if key != _OWN}
