"""The ten lines of the README run on the sample as they stand, and its pictures are small."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from acp_lab.prepared_part import PreparedPart
from tests.prepared_sample import sample_model

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def example() -> str:
    (code,) = re.findall(r"^```python\n(.*?)^```", README, re.MULTILINE | re.DOTALL)
    return code


def test_the_example_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Only the training is left out: the part that the tests prepared stands in for the part's networks."""
    asked: list[tuple[str, str]] = []

    def prepare(part, out):  # type: ignore[no-untyped-def]
        asked.append((part.name, out))
        return sample_model()

    monkeypatch.setattr("acp_lab.preparation.prepare", prepare)
    monkeypatch.delitem(__import__("acp_lab").__dict__, "prepare", raising=False)
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


def test_the_example_is_short() -> None:
    assert len(example().strip().splitlines()) <= 10


def test_the_moving_picture_moves_and_is_small() -> None:
    from PIL import Image

    path = ROOT / "docs" / "images" / "tracking.webp"
    assert path.name in README
    assert path.stat().st_size < 3e6
    with Image.open(path) as picture:
        assert getattr(picture, "n_frames", 1) > 20
