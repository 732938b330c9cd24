"""A JPEG file with a note (EXIF) that has viewers turn it."""

from __future__ import annotations

import struct

_ORIENTATION, _SHORT = 274, 3


def turned(jpeg: bytes, turn: int, order: str = "<") -> bytes:
    """The file with a note; turn: as EXIF counts, 1 upright, 6 a quarter turn. order: of the note's bytes."""
    head = b"II*\0" if order == "<" else b"MM\0*"
    entry = struct.pack(f"{order}HHIHH", _ORIENTATION, _SHORT, 1, turn, 0)
    note = b"Exif\0\0" + head + struct.pack(f"{order}IH", 8, 1) + entry + struct.pack(f"{order}I", 0)
    return jpeg[:2] + b"\xff\xe1" + struct.pack(">H", len(note) + 2) + note + jpeg[2:]
