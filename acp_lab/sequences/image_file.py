"""One image file to one RGB array, or one line that says why not.

Convention: the result is (h, w, 3) uint8 RGB. Grey images get three equal channels, transparency is dropped,
16-bit images are scaled to 8 bits, from the range that `PixelCoding` tells or else the full one. Rotation notes of
cameras (EXIF, and the one of TIFF) are not obeyed: a calibration belongs to the pixels as they are stored.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np

from acp_lab.errors import InputFileError
from acp_lab.geometry.arrays import ByteImage
from acp_lab.input_file import read_bytes
from acp_lab.quiet import native_output_silenced
from acp_lab.sequences.image_header import JPEG_START, PNG_START, is_progressive, pixel_size, upright
from acp_lab.sequences.pixel_coding import PixelCoding

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")

LARGEST_PIXELS = 120_000_000
"""Of one image, width times height; decoding that takes some 0.7 GB. No area-scan camera of a cell has more."""
_JPEG_END = b"\xff\xd9"
_JPEG_MARKER = re.compile(rb"\xff[^\x00\xff\xd0-\xd7]")
"""Behind the picture's own bytes: in these 0 follows a 0xFF, and numbered restarts (0xD0 to 0xD7) stand between."""
_MISSING = 128
_MORE = b"\x55" * 64
_UNTOLD = PixelCoding()


def read_rgb(path: Path, coding: PixelCoding = _UNTOLD) -> ByteImage:
    """Decode an image file into (h, w, 3) uint8 RGB. coding: how its values are meant.

    Raises InputFileError for a file that is missing, empty, cut short or damaged, for one of more than
    LARGEST_PIXELS, and for pixels that are neither 8 nor 16 bits or that `coding` does not fit.
    """
    return coding.rgb(_pixels(path), str(path))


def read_first(path: Path, coding: PixelCoding) -> tuple[ByteImage, PixelCoding]:
    """As `read_rgb`, for the first of several images of one kind, with the coding for those behind it."""
    pixels = _pixels(path)
    return coding.rgb(pixels, str(path)), coding.behind(pixels)


def _pixels(path: Path) -> np.ndarray:
    """As OpenCV decodes them; InputFileError for a file that `read_rgb` refuses."""
    data = _bytes_of(path)
    damage = _damage(data)
    pixels = None
    if damage is None:
        with quiet_cv2():
            pixels = _decode(upright(data))
    if pixels is not None and data.startswith(JPEG_START) and _is_jpeg_short(data, pixels):
        damage, pixels = "JPEG is cut short (its end was put back)", None
    if pixels is None:
        raise InputFileError(f"{path}: {damage or 'cannot be decoded as an image'}: replace or remove it")
    return pixels


def image_damage(path: Path) -> str | None:
    """What is wrong with a file as a container of an image, None when nothing is: cheaper than decoding it.

    Raises InputFileError when the file is missing or cannot be read.
    """
    return _damage(_bytes_of(path))


def _bytes_of(path: Path) -> bytes:
    return read_bytes(path, "put it back, or remove what refers to it", "image")


@contextmanager
def quiet_cv2() -> Iterator[None]:
    """Keep OpenCV's own warnings off stderr: what matters in them is said in our errors, in one line."""
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        yield
    finally:
        cv2.utils.logging.setLogLevel(level)


def _decode(data: bytes) -> np.ndarray | None:
    try:
        # Typed as never None, but None is how imdecode says "no image".
        pixels: np.ndarray | None = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        return None
    return pixels


def _damage(data: bytes) -> str | None:
    """What is wrong with the bytes of an image file, as far as its container tells; None when nothing is.

    The decoders find most of it too, but their C code prints to stderr on the way, and for some damage
    hands back a half grey picture as if all were well.
    """
    if not data:
        return "the file is empty"
    size = pixel_size(data)
    if size is not None and size[0] * size[1] > LARGEST_PIXELS:
        return f"has {size[0]} x {size[1]} px, {LARGEST_PIXELS // 1_000_000} million is the most"
    if data.startswith(PNG_START):
        return _png_damage(data)
    if data.startswith(JPEG_START):
        return _jpeg_damage(data)
    # Decoders know more kinds than these, and some of them no bounds.
    return "is no PNG, JPEG, BMP or TIFF image" if size is None else None


def _png_damage(data: bytes) -> str | None:
    # Chunks: length (4), name (4), content, CRC-32 of name and content (4).
    at = len(PNG_START)
    while at + 12 <= len(data):
        end = at + 8 + int.from_bytes(data[at : at + 4], "big")
        if end + 4 > len(data):
            break
        if zlib.crc32(memoryview(data)[at + 4 : end]) != int.from_bytes(data[end : end + 4], "big"):
            return "damaged PNG (a check sum is wrong)"
        if data[at + 4 : at + 8] == b"IEND":
            return None
        at = end + 4
    return "PNG is cut short"


def _jpeg_damage(data: bytes) -> str | None:
    # Headers are skipped segment by segment: a thumbnail inside them has an end mark of its own.
    at = 2
    while at + 4 <= len(data) and data[at] == 0xFF:
        marker = data[at + 1]
        # 0xFF before a marker is padding; the others have a length.
        at += 1 if marker == 0xFF else 2 + int.from_bytes(data[at + 2 : at + 4], "big")
        if marker != 0xDA:
            continue
        # Decoders end the picture at a marker that damage made, and fill the rest with mid grey. Where it is no
        # real one, no other stands where its length would have it.
        behind = _JPEG_MARKER.search(data, at)
        if behind is None:
            return "JPEG is cut short"
        if behind.group() == _JPEG_END:
            return None
        at = behind.start()
    return "JPEG is cut short or damaged"


def _is_jpeg_short(data: bytes, pixels: np.ndarray) -> bool:
    """Whether the picture of a JPEG file ends before its end mark does, as after a repair of a torn file.

    Decoders fill what is missing with mid grey and say nothing. Bytes more before the end mark change nothing in
    a whole picture; in a short one they are taken for what is missing.
    """
    # Of a file in one scan, the last pixel tells that something may be missing: nearly all are whole.
    if (pixels[-1, -1] != _MISSING).any() and not is_progressive(data):
        return False
    end = data.rfind(_JPEG_END)
    with native_output_silenced():  # libjpeg remarks on the bytes
        longer = _decode(data[:end] + _MORE + data[end:])
    return longer is None or not np.array_equal(longer, pixels)
