"""`acp-lab replay` and `acp-lab lab`: what they would start, and bad input; nothing is started here."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import acp_lab
from acp_lab.commands.lab import notebooks_folder
from tests.cli_runner import assert_one_error, run


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[tuple[list[str], dict[str, Any]]]:
    """What was to be started; each program ends with status 0."""
    calls: list[tuple[list[str], dict[str, Any]]] = []

    class Process:
        def __init__(self, command: list[str], **options: Any) -> None:
            calls.append((command, options))

        def wait(self) -> int:
            return 0

    def start(command: list[str], **options: Any) -> subprocess.CompletedProcess[str]:
        calls.append((command, options))
        return subprocess.CompletedProcess(command, 0)

    monkeypatch.setattr(subprocess, "Popen", Process)
    monkeypatch.setattr(subprocess, "run", start)
    monkeypatch.setenv("DISPLAY", ":0")
    return calls


@pytest.fixture
def replay(tmp_path: Path) -> Path:
    path = tmp_path / "run.rrd"
    path.write_bytes(b"RRF2 and more")
    return path


def test_the_viewer_listens_on_this_machine_only(
    capsys: pytest.CaptureFixture[str], started: list[tuple[list[str], dict[str, Any]]], replay: Path
) -> None:
    assert run(capsys, "replay", replay).status == 0
    command = started[0][0]
    assert command[:4] == [sys.executable, "-m", "rerun", str(replay)]
    assert command[command.index("--bind") + 1] == "127.0.0.1"


def test_bad_replays(
    capsys: pytest.CaptureFixture[str],
    started: list[tuple[list[str], dict[str, Any]]],
    replay: Path,
    tmp_path: Path,
) -> None:
    (tmp_path / "empty.rrd").write_bytes(b"")
    (tmp_path / "other.rrd").write_text("hello")
    for name in ("none.rrd", "empty.rrd", "other.rrd"):
        assert_one_error(run(capsys, "replay", tmp_path / name), name)
    assert_one_error(run(capsys, "replay", tmp_path), str(tmp_path))
    assert_one_error(run(capsys, "replay", replay, replay, replay), "two")
    assert_one_error(run(capsys, "replay", replay, "--mp4", tmp_path / "film.mp4"), "--mp4")
    assert started == []


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems always have a display")
def test_without_a_display(capsys: pytest.CaptureFixture[str], replay: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    assert_one_error(run(capsys, "replay", replay), "display", "--web-viewer")


def test_lab_opens_the_notebooks(
    capsys: pytest.CaptureFixture[str], started: list[tuple[list[str], dict[str, Any]]]
) -> None:
    assert run(capsys, "lab", "--no-browser").status == 0
    command, options = started[0]
    assert str(notebooks_folder()) in command
    assert "--ip=127.0.0.1" in command
    assert not any("token" in word for word in command)
    assert options["env"]["RERUN_NOTEBOOK_ASSET"] == "serve-local"


def test_lab_without_notebooks(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(acp_lab, "__file__", str(tmp_path / "acp_lab" / "__init__.py"))
    assert_one_error(run(capsys, "lab"), "notebooks")
