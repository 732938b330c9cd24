"""The size of an image is known from its first bytes."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from acp_lab.sequences.image_header import is_progressive, is_turned, pixel_size
from tests.sequences.turned_jpeg import turned

SUFFIXES = (".png", ".jpg", ".bmp", ".tif")


def encoded(suffix: str, shape: tuple[int, ...], *settings: int) -> bytes:
    return cv2.imencode(suffix, np.zeros(shape, np.uint8), settings)[1].tobytes()


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("shape", [(7, 300, 3), (300, 7), (1, 1, 3)])
def test_the_size_is_that_of_the_picture(suffix: str, shape: tuple[int, ...]) -> None:
    assert pixel_size(encoded(suffix, shape)) == (shape[1], shape[0])


def test_progressive_files_say_so() -> None:
    assert not is_progressive(encoded(".jpg", (8, 8)))
    data = encoded(".jpg", (8, 9), cv2.IMWRITE_JPEG_PROGRESSIVE, 1)
    assert is_progressive(data)
    assert pixel_size(data) == (9, 8)


@pytest.mark.parametrize("order", ["<", ">"])
def test_notes_that_turn_a_picture_are_seen(order: str) -> None:
    data = encoded(".jpg", (8, 9))
    assert not is_turned(data)
    assert not is_turned(turned(data, 1, order))
    for turn in (3, 6, 8):
        noted = turned(data, turn, order)
        assert is_turned(noted)
        assert pixel_size(noted) == (9, 8)
    # OpenCV means the same by it.
    assert cv2.imdecode(np.frombuffer(turned(data, 6, order), np.uint8), cv2.IMREAD_COLOR).shape[:2] == (9, 8)
    note = turned(data, 1, order)
    assert is_turned(note[:12] + b"XX" + note[14:]), "what cannot be read may say anything"
    assert not is_turned(encoded(".png", (8, 9)))


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_torn_headers_tell_nothing(suffix: str) -> None:
    data = encoded(suffix, (7, 300, 3))
    for length in range(16):
        assert pixel_size(data[:length]) is None


@given(st.binary(max_size=80), st.sampled_from([b"", b"II*\0", b"MM\0*", b"BM", b"\xff\xd8\xff", b"\x89PNG\r\n\x1a\n"]))
def test_any_bytes_give_a_size_or_none(rest: bytes, start: bytes) -> None:
    size = pixel_size(start + rest)
    assert size is None or min(size) >= 0
    is_progressive(b"\xff\xd8" + rest)
    is_turned(b"\xff\xd8" + rest)
