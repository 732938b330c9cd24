"""Messages over a pipe: a line of JSON, then the bytes of some arrays. Nothing in them can run code.

Imported on both sides, and by the worker without this package: standard library and NumPy alone.
"""

from __future__ import annotations

import json
from typing import IO, Any

import numpy as np


def send(stream: IO[bytes], said: dict[str, Any], *arrays: np.ndarray) -> None:
    """Write one message."""
    plain = [np.ascontiguousarray(array) for array in arrays]
    head = {**said, "arrays": [[array.dtype.str, list(array.shape)] for array in plain]}
    stream.write(json.dumps(head).encode() + b"\n")
    for array in plain:
        stream.write(array.tobytes())
    stream.flush()


def receive(stream: IO[bytes]) -> tuple[dict[str, Any], list[np.ndarray]] | None:
    """Read one message; None where the other side is gone."""
    line = stream.readline()
    if not line.endswith(b"\n"):
        return None
    said = json.loads(line)
    arrays = []
    for kind, shape in said.pop("arrays"):
        dtype = np.dtype(kind)
        content = stream.read(dtype.itemsize * int(np.prod(shape)))
        arrays.append(np.frombuffer(content, dtype).reshape(shape))
    return said, arrays
