"""The ten lines of the README run on the sample as they stand, and its pictures are small."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import Any

import cv2
import pytest

import acp_lab
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences import write_pose
from acp_lab.sequences.frame import Frame
from tests.prepared_sample import sample_model, sample_scene

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def example(number: int = 0) -> str:
    code: str = re.findall(r"^```python\n(.*?)^```", README, re.MULTILINE | re.DOTALL)[number]
    return code


def test_the_example_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Only the training is left out: the part that the tests prepared stands in for the part's networks."""
    asked: list[tuple[str, str]] = []

    def prepare(part, out):  # type: ignore[no-untyped-def]
        asked.append((part.name, out))
        return sample_model()

    monkeypatch.setattr(acp_lab, "prepare", prepare)
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    exec(compile(example(), "README.md", "exec"), names)
    assert asked == [("obj_000001", "parts")]
    assert isinstance(names["model"], PreparedPart)
    assert len(names["run"].results[1]) == 40  # type: ignore[attr-defined]
    assert (tmp_path / "run.rrd").is_file()
    printed = capsys.readouterr().out
    assert "until lost" in printed
    assert "Frame 39" in printed


def test_the_example_with_a_video_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On the sample's first frames, as a film of the camera that took them."""
    scene, model = sample_scene(), sample_model()
    camera, part = scene.camera(0), scene.dataset.part_path(1)
    film = cv2.VideoWriter(
        str(tmp_path / "clip.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 30.0, (camera.width, camera.height)
    )
    for index in range(3):
        frame = scene.frame(index)
        assert isinstance(frame, Frame)
        film.write(frame.image[..., ::-1])
    film.release()
    camera.to_json(tmp_path / "CAMERA.json")
    write_pose(tmp_path / "POSE.json", scene.first_pose)
    shutil.copy(part, tmp_path / "bracket.ply")
    monkeypatch.setattr(acp_lab, "prepare", lambda *_, **__: model)
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {"acp": acp_lab}
    exec(compile(example(1), "README.md", "exec"), names)
    assert [result.state for result in names["run"].results[1]] == ["tracking"] * 3
    assert len((tmp_path / "results.csv").read_text(encoding="utf-8").splitlines()) == 4


def test_the_example_is_short() -> None:
    assert len(example().strip().splitlines()) <= 10


def test_the_moving_picture_moves_and_is_small() -> None:
    from PIL import Image

    path = ROOT / "docs" / "images" / "tracking.webp"
    assert path.name in README
    assert path.stat().st_size < 3e6
    with Image.open(path) as picture:
        assert getattr(picture, "n_frames", 1) > 20
