"""Files from outside: what is no file, no JSON or too large is one line, and nothing waits for a pipe."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from acp_lab.cad.models_info import read_models_info
from acp_lab.cad.part import Part
from acp_lab.display.replay.file import check_replay
from acp_lab.errors import InputFileError
from acp_lab.geometry.camera import Camera
from acp_lab.input_file import LARGEST_BYTES, is_measure, read_bytes, read_json_object
from acp_lab.sequences.image_file import image_damage, read_rgb
from acp_lab.sequences.images import VideoFile, first_size
from acp_lab.sequences.json_file import read_pose
from acp_lab.sequences.pixel_coding import PixelCoding
from acp_lab.sequences.results_csv import read_results
from acp_lab.sequences.scene_truth import SceneTruth

READERS: dict[str, Callable[[Path], object]] = {
    "part.ply": Part.from_file,
    "part.obj": Part.from_file,
    "models_info.json": read_models_info,
    "CAMERA.json": Camera.from_json,
    "POSE.json": read_pose,
    "scene_gt.json": SceneTruth.from_file,
    "pixels.json": lambda path: PixelCoding.beside(path.parent),
    "results.csv": read_results,
    "run.rrd": check_replay,
    "image.png": read_rgb,
    "damage.png": image_damage,
    "clip.mp4": lambda path: VideoFile(path, Camera(64, 48, 60.0, 60.0, 31.5, 23.5)),
    "first.mp4": first_size,
}


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no pipes in folders")
@pytest.mark.parametrize("name", READERS)
def test_a_pipe_is_refused_and_not_waited_for(name: str, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / name)
    with pytest.raises(InputFileError) as caught:
        READERS[name](tmp_path / name)
    assert name in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="/dev/zero never ends on Linux")
@pytest.mark.parametrize("name", READERS)
def test_a_device_is_refused_and_not_read(name: str, tmp_path: Path) -> None:
    (tmp_path / name).symlink_to("/dev/zero")
    with pytest.raises(InputFileError, match=name):
        READERS[name](tmp_path / name)


def test_a_huge_file_is_not_read(tmp_path: Path) -> None:
    with (tmp_path / "part.ply").open("wb") as file:
        file.truncate(LARGEST_BYTES + 1)  # no bytes behind it
    with pytest.raises(InputFileError, match=r"part\.ply: has 2\.1 GB, 2\.1 is the most: check the path"):
        read_bytes(tmp_path / "part.ply")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[" * 100_000, "nested too deeply"),
        ('{"a": ' * 100_000, "nested too deeply"),
        ('{"a": ' + "9" * 10_000 + "}", "not valid JSON"),
        ('{"a": 1', "not valid JSON"),
        ("", "is empty"),
        ("[1]", "holds no JSON object"),
    ],
)
def test_what_is_no_json_object_is_one_line(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(InputFileError, match=f"a.json: .*{message}.*: mend it") as caught:
        read_json_object(tmp_path / "a.json", "mend it")
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 300


def test_a_byte_order_mark_does_no_harm(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_bytes(b'\xef\xbb\xbf{"a": 1}')
    assert read_json_object(tmp_path / "a.json", "mend it") == {"a": 1}


@pytest.mark.parametrize("value", [True, None, "1", [1], math.nan, math.inf, -math.inf, 10**400, 1e9 + 1])
def test_what_is_no_measure(value: object) -> None:
    assert not is_measure(value)


def test_what_is_a_measure() -> None:
    assert all(is_measure(value) for value in (0, -1, 1.5, 1e-300, 10**9))
    assert not is_measure(1001, 1000.0)
