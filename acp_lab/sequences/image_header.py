"""The size of an image, from the first bytes of its file: what it will take is known before it is decoded.

PNG, JPEG, BMP and TIFF, as far as their headers go. A decoder would make the whole picture first: 62 kB of JPEG can
be 20000 x 20000 px, which are 1.2 GB. And whether a note of the camera has viewers turn it, which nothing here does.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator

PNG_START = b"\x89PNG\r\n\x1a\n"
JPEG_START = b"\xff\xd8"
_TIFF_STARTS = {b"II*\0": "<", b"MM\0*": ">"}
_JPEG_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_JPEG_PROGRESSIVE = frozenset((0xC2, 0xC6, 0xCA, 0xCE))
_JPEG_NOTES, _EXIF_START = 0xE1, b"Exif\0\0"
_TIFF_WIDTH, _TIFF_HEIGHT, _TIFF_ORIENTATION = _TIFF_TAGS = 256, 257, 274
_UPRIGHT = 1
_TIFF_FORMATS = {1: "B", 3: "H", 4: "I"}


def pixel_size(data: bytes) -> tuple[int, int] | None:
    """(width, height) px that the bytes of an image file announce; None for other files and for torn headers."""
    try:
        if data.startswith(PNG_START):
            return struct.unpack_from(">II", data, 16)
        if data.startswith(JPEG_START):
            frame = _jpeg_frame(data)
            return None if frame is None else frame[1]
        if data.startswith(b"BM"):
            return _bmp_size(data)
        if data[:4] in _TIFF_STARTS:
            return _tiff_size(data, _TIFF_STARTS[data[:4]])
    except struct.error:
        return None
    return None


def is_progressive(data: bytes) -> bool:
    """Whether a JPEG file keeps its picture in several scans, coarse to fine."""
    frame = _jpeg_frame(data)
    return frame is not None and frame[0] in _JPEG_PROGRESSIVE


def is_turned(data: bytes) -> bool:
    """Whether a JPEG file has a note (EXIF) by which viewers turn or mirror it, or one that cannot be read."""
    for marker, at, end in _jpeg_segments(data):
        note = data[at:end].removeprefix(_EXIF_START)
        if marker != _JPEG_NOTES or len(note) == end - at:
            continue
        try:
            turn = _tiff_values(note, _TIFF_STARTS[note[:4]]).get(_TIFF_ORIENTATION, _UPRIGHT)
        except (KeyError, struct.error):
            return True
        if turn != _UPRIGHT:
            return True
    return False


def upright(data: bytes) -> bytes:
    """An image file that OpenCV reads as it is stored: a TIFF file whose note says that nothing is turned.

    OpenCV leaves the notes of other files alone when it is told so, and they come back as they are. To be asked of
    files whose `pixel_size` is known: raises struct.error for a torn TIFF header.
    """
    order = _TIFF_STARTS.get(data[:4])
    if order is None or _tiff_values(data, order).get(_TIFF_ORIENTATION, _UPRIGHT) == _UPRIGHT:
        return data
    changed = bytearray(data)
    for entry, tag, kind in _tiff_entries(data, order):
        if tag == _TIFF_ORIENTATION:
            struct.pack_into(f"{order}{_TIFF_FORMATS[kind]}", changed, entry + 8, _UPRIGHT)
    return bytes(changed)


def _jpeg_frame(data: bytes) -> tuple[int, tuple[int, int]] | None:
    """The marker that begins the picture, and its size."""
    for marker, at, _ in _jpeg_segments(data):
        if marker in _JPEG_FRAMES and at + 5 <= len(data):
            height, width = struct.unpack_from(">HH", data, at + 1)
            return marker, (width, height)
    return None


def _jpeg_segments(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Marker, begin and end of what stands before the picture itself."""
    at = len(JPEG_START)
    while at + 4 <= len(data) and data[at] == 0xFF and data[at + 1] != 0xDA:
        marker = data[at + 1]
        # 0xFF before a marker is padding; the others have a length.
        if marker == 0xFF:
            at += 1
            continue
        end = at + 2 + int.from_bytes(data[at + 2 : at + 4], "big")
        yield marker, at + 4, end
        at = end


def _bmp_size(data: bytes) -> tuple[int, int]:
    (header_bytes,) = struct.unpack_from("<I", data, 14)
    width, height = struct.unpack_from("<HH" if header_bytes == 12 else "<ii", data, 18)
    return abs(width), abs(height)  # a negative height: rows from the top


def _tiff_size(data: bytes, order: str) -> tuple[int, int] | None:
    found = _tiff_values(data, order)
    return (found[_TIFF_WIDTH], found[_TIFF_HEIGHT]) if found.keys() >= {_TIFF_WIDTH, _TIFF_HEIGHT} else None


def _tiff_values(data: bytes, order: str) -> dict[int, int]:
    """The whole numbers in the first directory, by their tags."""
    return {
        tag: struct.unpack_from(f"{order}{_TIFF_FORMATS[kind]}", data, entry + 8)[0]
        for entry, tag, kind in _tiff_entries(data, order)
    }


def _tiff_entries(data: bytes, order: str) -> Iterator[tuple[int, int, int]]:
    """Place, tag and format of the whole numbers in the first directory that are asked for here."""
    (at,) = struct.unpack_from(f"{order}I", data, 4)
    (count,) = struct.unpack_from(f"{order}H", data, at)
    for entry in range(at + 2, at + 2 + 12 * count, 12):
        tag, kind = struct.unpack_from(f"{order}HH", data, entry)
        if tag in _TIFF_TAGS and kind in _TIFF_FORMATS:
            yield entry, tag, kind
