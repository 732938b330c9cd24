"""Bits and colour filters: obeyed when told, refused when they must be told, never guessed."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from acp_lab.errors import InputFileError
from acp_lab.geometry.camera import Camera
from acp_lab.sequences import BopScene, Frame, ImageFolder, PixelCoding, UnreadableFrame
from acp_lab.sequences.image_file import image_damage, read_rgb
from acp_lab.sequences.pixel_coding import BAYER_CODES, looks_raw
from tests.sequences.tiny_dataset import HEIGHT, WIDTH, write_scene

SITES = {"r": 0, "g": 1, "b": 2}


def scene_colours(height: int = 96, width: int = 128) -> np.ndarray:
    """A smooth colour picture (h, w, 3) uint8, redder than it is blue, with soft blobs."""
    rng = np.random.default_rng(5)
    blobs = cv2.GaussianBlur(rng.standard_normal((height, width, 3)).astype(np.float32), (0, 0), 9.0)
    picture = np.array([150.0, 110.0, 70.0]) * (1.0 + 0.6 * blobs / blobs.std() * 0.25)
    return np.clip(picture, 0, 255).astype(np.uint8)


def mosaic(picture: np.ndarray, bayer: str) -> np.ndarray:
    """What a sensor behind a colour filter records of a picture: (h, w)."""
    raw = np.zeros(picture.shape[:2], picture.dtype)
    for place, letter in enumerate(bayer):
        i, j = divmod(place, 2)
        raw[i::2, j::2] = picture[i::2, j::2, SITES[letter]]
    return raw


def write(path: Path, image: np.ndarray) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), image)
    return path


@pytest.mark.parametrize("bayer", sorted(BAYER_CODES))
@pytest.mark.parametrize("bits", [8, 12, 16])
def test_a_declared_filter_is_undone(tmp_path: Path, bayer: str, bits: int) -> None:
    picture = scene_colours()
    raw = mosaic(picture, bayer)
    if bits > 8:
        raw = (raw.astype(np.float64) / 255.0 * (2**bits - 1)).round().astype(np.uint16)
    coding = PixelCoding(bits if bits > 8 else None, bayer)
    image = read_rgb(write(tmp_path / "raw.png", raw), coding)
    difference = np.abs(image.astype(int) - picture)[4:-4, 4:-4]
    assert image.shape == picture.shape
    assert np.median(difference) <= 1
    assert np.quantile(difference, 0.99) < 12


@pytest.mark.parametrize("bayer", sorted(BAYER_CODES))
def test_an_undeclared_filter_is_noticed(tmp_path: Path, bayer: str) -> None:
    path = write(tmp_path / "raw.png", mosaic(scene_colours(), bayer))
    with pytest.raises(InputFileError, match=r"raw\.png: looks like a raw picture .* name the filter in pixels\.json"):
        read_rgb(path)


def test_grey_pictures_are_not_taken_for_raw_ones() -> None:
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:200, :300]
    for grey in (
        scene_colours()[..., 0],
        rng.integers(0, 256, (96, 96), dtype=np.uint8),
        (127 + 100 * np.sin(0.7 * x + 0.2 * y)).astype(np.uint8),  # fine stripes
        np.where(x % 4 < 2, 30, 220).astype(np.uint8),
        np.zeros((96, 96), np.uint8),
        np.full((20, 20), 7, np.uint8),
    ):
        assert not looks_raw(grey)
    assert not looks_raw(scene_colours())


@pytest.mark.parametrize("bits", [10, 12, 14])
def test_declared_bits_are_scaled_from_their_own_range(tmp_path: Path, bits: int) -> None:
    levels = np.linspace(0, 2**bits - 1, 256).round().astype(np.uint16).reshape(16, 16)
    image = read_rgb(write(tmp_path / "grey.png", levels), PixelCoding(bits))
    np.testing.assert_array_equal(image[..., 0].ravel(), np.arange(256))


def test_values_beyond_the_declared_bits_are_an_error(tmp_path: Path) -> None:
    path = write(tmp_path / "grey.png", np.full((8, 8), 5000, np.uint16))
    with pytest.raises(InputFileError, match=r"values up to 5000, but 12 bits end at 4095: correct pixels\.json"):
        read_rgb(path, PixelCoding(12))


def test_a_filter_declared_for_colour_files_is_an_error(tmp_path: Path) -> None:
    path = write(tmp_path / "colour.png", scene_colours())
    with pytest.raises(InputFileError, match="is no raw picture: take bayer rggb out"):
        read_rgb(path, PixelCoding(bayer="rggb"))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('{"bits": 7}', "bits is 7: give"),
        ('{"bits": true}', "bits is True"),
        ('{"bits": "12"}', "bits is '12'"),
        ('{"bayer": "rgbg"}', "bayer is 'rgbg': give one of rggb"),
        ('{"bayer": ["rggb"]}', "bayer is"),
        ('{"depth": 12}', "unknown key depth"),
        ("[12]", "holds no JSON object"),
        ("", "is empty"),
    ],
)
def test_malformed_declarations_are_one_line(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "pixels.json").write_text(text)
    with pytest.raises(InputFileError, match=words) as error:
        PixelCoding.beside(tmp_path)
    assert "pixels.json" in str(error.value)
    assert "\n" not in str(error.value)
    assert PixelCoding.beside(tmp_path / "elsewhere") == PixelCoding()


def test_folders_and_scenes_obey_the_file_beside_their_images(tmp_path: Path) -> None:
    raw = mosaic(scene_colours(HEIGHT, WIDTH), "gbrg").astype(np.uint16) * 16
    camera = Camera(WIDTH, HEIGHT, 80.0, 80.0, 31.5, 23.5)
    scene = write_scene(tmp_path / "set" / "test" / "000001")
    for i in range(3):
        write(scene / "rgb" / f"{i:06d}.png", raw)
        write(tmp_path / "clip" / f"{i}.png", raw)
    for folder in (scene / "rgb", tmp_path / "clip"):
        (folder / "pixels.json").write_text('{"bits": 12, "bayer": "gbrg"}')
    write(tmp_path / "clip" / "1.png", np.full_like(raw, 60000))
    expected = read_rgb(scene / "rgb" / "000000.png", PixelCoding(12, "gbrg"))
    frame = BopScene(scene).frame(2)
    assert isinstance(frame, Frame)
    np.testing.assert_array_equal(frame.image, expected)
    first, second, _ = ImageFolder(tmp_path / "clip", camera).frames()
    assert isinstance(first, Frame)
    np.testing.assert_array_equal(first.image, expected)
    assert isinstance(second, UnreadableFrame)
    assert "12 bits end at 4095" in second.reason
    with pytest.raises(InputFileError, match="only: say how many bits"):
        ImageFolder(tmp_path / "clip", camera, PixelCoding())


def test_a_dark_image_behind_a_first_one_of_16_bits_is_read(tmp_path: Path) -> None:
    camera = Camera(WIDTH, HEIGHT, 80.0, 80.0, 31.5, 23.5)
    scene = write_scene(tmp_path / "set" / "test" / "000001")
    for i, value in enumerate((60_000, 0, 2570)):
        for path in (scene / "rgb" / f"{i:06d}.png", tmp_path / "clip" / f"{i}.png"):
            write(path, np.full((HEIGHT, WIDTH), value, np.uint16))
    for sequence in (BopScene(scene), ImageFolder(tmp_path / "clip", camera)):
        frames = list(sequence.frames())
        assert [frame.image.max() for frame in frames if isinstance(frame, Frame)] == [233, 0, 10]


def test_fewer_bits_behind_a_first_image_of_8_are_not_guessed(tmp_path: Path) -> None:
    write(tmp_path / "0.png", scene_colours(HEIGHT, WIDTH))
    write(tmp_path / "1.png", np.full((HEIGHT, WIDTH), 4000, np.uint16))
    _, second = ImageFolder(tmp_path, Camera(WIDTH, HEIGHT, 80.0, 80.0, 31.5, 23.5)).frames()
    assert isinstance(second, UnreadableFrame)
    assert "say how many bits" in second.reason


def test_damage_is_seen_without_decoding(tmp_path: Path) -> None:
    path = write(tmp_path / "a.png", scene_colours())
    assert image_damage(path) is None
    path.write_bytes(path.read_bytes()[:-20])
    assert image_damage(path) == "PNG is cut short"
    with pytest.raises(InputFileError, match="no such image"):
        image_damage(tmp_path / "none.png")
