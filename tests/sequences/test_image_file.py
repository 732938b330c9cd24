"""Image files: what is converted, what is refused, and that damage is always noticed."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from acp_lab.errors import InputFileError
from acp_lab.sequences.image_file import image_damage, read_rgb

RNG = np.random.default_rng(0)
COLOUR = RNG.integers(0, 256, (20, 30, 3), dtype=np.uint8)


def _write(path: Path, image: np.ndarray) -> Path:
    assert cv2.imwrite(str(path), image)
    return path


@pytest.mark.parametrize("suffix", [".png", ".bmp", ".tif"])
def test_lossless_colour_comes_back_as_rgb(tmp_path: Path, suffix: str) -> None:
    image = read_rgb(_write(tmp_path / f"a{suffix}", COLOUR[..., ::-1]))
    assert image.dtype == np.uint8
    np.testing.assert_array_equal(image, COLOUR)


def test_jpeg_channels_are_in_rgb_order(tmp_path: Path) -> None:
    red = np.zeros((16, 16, 3), np.uint8)
    red[..., 2] = 250  # BGR, as cv2 writes
    image = read_rgb(_write(tmp_path / "a.jpg", red))
    assert image[..., 0].min() > 240
    assert image[..., 1:].max() < 10


def test_grey_and_transparent_images_become_three_channels(tmp_path: Path) -> None:
    grey = read_rgb(_write(tmp_path / "grey.png", COLOUR[..., 0]))
    np.testing.assert_array_equal(grey, np.repeat(COLOUR[..., :1], 3, axis=2))
    rgba = np.dstack([COLOUR[..., ::-1], COLOUR[..., 0]])
    np.testing.assert_array_equal(read_rgb(_write(tmp_path / "rgba.png", rgba)), COLOUR)


def test_16_bit_images_are_scaled_from_their_full_range(tmp_path: Path) -> None:
    wide = COLOUR[..., ::-1].astype(np.uint16) * 257
    np.testing.assert_array_equal(read_rgb(_write(tmp_path / "wide.png", wide)), COLOUR)
    grey = read_rgb(_write(tmp_path / "grey.png", wide[..., 2]))
    np.testing.assert_array_equal(grey[..., 1], COLOUR[..., 0])


@pytest.mark.parametrize("bits", [10, 12, 14])
def test_fewer_bits_in_16_are_refused_with_the_mend(tmp_path: Path, bits: int) -> None:
    path = _write(tmp_path / "dark.png", COLOUR[..., 0].astype(np.uint16) << (bits - 8))
    mend = rf'16-bit image with values up to \d+ only: say how many bits .*, as {{"bits": {max(bits, 12)}}}'
    with pytest.raises(InputFileError, match=rf"dark\.png: {mend}"):
        read_rgb(path)


def _tiff(image: np.ndarray, turn: int, order: str) -> bytes:
    """An uncompressed TIFF file of an (h, w, 3) uint8 image with a note that has viewers turn it."""
    height, width = image.shape[:2]
    numbers = {256: width, 257: height, 258: 8, 259: 1, 262: 2, 273: 8, 274: turn, 277: 3, 278: height, 279: image.size}
    entries = b"".join(struct.pack(f"{order}HHII", tag, 4, 1, number) for tag, number in numbers.items())
    head = (b"II*\0" if order == "<" else b"MM\0*") + struct.pack(f"{order}I", 8 + image.size)
    return head + image.tobytes() + struct.pack(f"{order}H", len(numbers)) + entries + bytes(4)


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("turn", range(1, 9))
def test_a_tiff_is_read_as_it_is_stored(turn: int, order: str, tmp_path: Path) -> None:
    """As JPEG and PNG files are, whatever their notes say: the calibration belongs to those pixels."""
    path = tmp_path / "a.tif"
    path.write_bytes(_tiff(COLOUR, turn, order))
    np.testing.assert_array_equal(read_rgb(path), COLOUR)


def test_float_images_are_refused(tmp_path: Path) -> None:
    path = _write(tmp_path / "a.tif", COLOUR[..., 0].astype(np.float32))
    with pytest.raises(InputFileError, match="pixels are float32: convert"):
        read_rgb(path)


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
@pytest.mark.parametrize("kept", [0.02, 0.3, 0.6, 0.97])
def test_files_cut_short_are_noticed_without_a_word_on_stderr(
    tmp_path: Path, suffix: str, kept: float, capfd: pytest.CaptureFixture[str]
) -> None:
    path = _write(tmp_path / f"a{suffix}", COLOUR)
    data = path.read_bytes()
    path.write_bytes(data[: int(kept * len(data))])
    with pytest.raises(InputFileError, match=r"cut short|damaged|cannot be decoded"):
        read_rgb(path)
    assert capfd.readouterr().err == ""


def test_a_flipped_byte_in_a_png_is_noticed(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = _write(tmp_path / "a.png", COLOUR)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(data)
    with pytest.raises(InputFileError, match="check sum"):
        read_rgb(path)
    assert capfd.readouterr().err == ""


def test_a_jpeg_thumbnail_does_not_hide_that_the_picture_is_cut(tmp_path: Path) -> None:
    data = _write(tmp_path / "a.jpg", COLOUR).read_bytes()
    thumbnail = b"Exif\0\0" + data
    segment = b"\xff\xe1" + (len(thumbnail) + 2).to_bytes(2, "big") + thumbnail
    whole = tmp_path / "whole.jpg"
    whole.write_bytes(data[:2] + segment + data[2:])
    assert read_rgb(whole).shape == COLOUR.shape
    cut = tmp_path / "cut.jpg"
    cut.write_bytes(data[:2] + segment + data[2:-40])
    with pytest.raises(InputFileError, match="cut short"):
        read_rgb(cut)


@pytest.mark.parametrize("content", [b"", b"hello", b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff"])
def test_other_content_is_one_line_naming_the_file(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.png"
    path.write_bytes(content)
    with pytest.raises(InputFileError) as error:
        read_rgb(path)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


def test_missing_files_and_folders(tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match="no such image"):
        read_rgb(tmp_path / "none.png")
    with pytest.raises(InputFileError, match="cannot be read"):
        read_rgb(tmp_path)


def smooth(height: int = 120, width: int = 160) -> np.ndarray:
    return cv2.GaussianBlur(RNG.integers(0, 256, (height, width, 3), dtype=np.uint8), (0, 0), 2.0)


def jpeg(image: np.ndarray, *settings: int) -> bytes:
    return cv2.imencode(".jpg", image, settings)[1].tobytes()


JPEG_KINDS: dict[str, tuple[int, ...]] = {
    "one scan": (),
    "progressive": (cv2.IMWRITE_JPEG_PROGRESSIVE, 1),
    "restarts": (cv2.IMWRITE_JPEG_RST_INTERVAL, 4),
}


@pytest.mark.parametrize("settings", JPEG_KINDS.values(), ids=JPEG_KINDS)
@pytest.mark.parametrize("kept", [0.1, 0.5, 0.9])
def test_a_cut_jpeg_with_its_end_mark_put_back_is_noticed(
    tmp_path: Path, settings: tuple[int, ...], kept: float
) -> None:
    data = jpeg(smooth(), *settings)
    picture = data.index(b"\xff\xda")
    path = tmp_path / "a.jpg"
    path.write_bytes(data[: picture + int(kept * (len(data) - picture))] + b"\xff\xd9")
    with pytest.raises(InputFileError, match="JPEG is cut short"):
        read_rgb(path)


@pytest.mark.parametrize("settings", JPEG_KINDS.values(), ids=JPEG_KINDS)
def test_a_marker_that_ends_a_jpeg_in_its_middle_is_noticed(
    tmp_path: Path, settings: tuple[int, ...], capfd: pytest.CaptureFixture[str]
) -> None:
    data = bytearray(jpeg(smooth(), *settings))
    middle = (data.index(b"\xff\xda") + len(data)) // 2
    data[middle : middle + 2] = b"\xff\x37"
    path = tmp_path / "a.jpg"
    path.write_bytes(data)
    with pytest.raises(InputFileError, match="JPEG is cut short or damaged"):
        read_rgb(path)
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("settings", JPEG_KINDS.values(), ids=JPEG_KINDS)
@pytest.mark.parametrize("grey", [True, False])
def test_whole_jpegs_are_read_even_if_they_end_in_grey(
    tmp_path: Path, settings: tuple[int, ...], grey: bool, capfd: pytest.CaptureFixture[str]
) -> None:
    image = smooth()
    if grey:
        image[-40:] = 128
    path = tmp_path / "a.jpg"
    path.write_bytes(jpeg(image, *settings))
    assert read_rgb(path).shape == image.shape
    path.write_bytes(jpeg(image[..., 0], *settings) + b"something behind it")
    assert read_rgb(path).shape == image.shape
    assert capfd.readouterr().err == ""


def test_a_small_file_of_a_huge_picture_is_not_decoded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("acp_lab.sequences.image_file._decode", lambda data: pytest.fail("was decoded"))
    for suffix in (".jpg", ".png", ".bmp", ".tif"):
        path = tmp_path / f"a{suffix}"
        path.write_bytes(enlarged(cv2.imencode(suffix, smooth())[1].tobytes(), 20_000, 20_000))
        with pytest.raises(InputFileError, match=r"has 20000 x 20000 px, 120 million is the most"):
            read_rgb(path)
        assert "20000" in str(image_damage(path))


def test_other_kinds_of_images_are_refused(tmp_path: Path) -> None:
    """What OpenCV would decode by its content, whatever its name."""
    for suffix in (".webp", ".ppm", ".jp2"):
        found, data = cv2.imencode(suffix, smooth())
        if found:
            (tmp_path / "a.png").write_bytes(data.tobytes())
            with pytest.raises(InputFileError, match="is no PNG, JPEG, BMP or TIFF image"):
                read_rgb(tmp_path / "a.png")


def enlarged(data: bytes, width: int, height: int) -> bytes:
    """The file with another size in its header."""
    old = {code: struct.pack(code, *((160, 120) if code[1] != "H" else (120, 160))) for code in ("<ii", ">II", ">HH")}
    new = {code: struct.pack(code, *((width, height) if code[1] != "H" else (height, width))) for code in old}
    if data.startswith(b"\x89PNG"):
        start, chunk = data[:16], new[">II"] + data[24:29]
        return start + chunk + zlib.crc32(b"IHDR" + chunk).to_bytes(4, "big") + data[33:]
    if data.startswith(b"BM"):
        return data.replace(old["<ii"], new["<ii"], 1)
    if data.startswith(b"\xff\xd8"):
        return data.replace(old[">HH"], new[">HH"], 1)
    size_of = {256: width, 257: height}
    at = int.from_bytes(data[4:8], "little")
    changed = bytearray(data)
    for entry in range(at + 2, at + 2 + 12 * int.from_bytes(data[at : at + 2], "little"), 12):
        tag = int.from_bytes(data[entry : entry + 2], "little")
        if tag in size_of:
            changed[entry + 2 : entry + 12] = struct.pack("<HII", 4, 1, size_of[tag])
    return bytes(changed)
