"""`acp-lab replay` and `acp-lab lab`: what they would start, films, and bad input; nothing is started here."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import urllib.error
import urllib.parse
import urllib.request
from pathlib import Path
from typing import Any

import pytest

import acp_lab
from acp_lab.commands import course_copy, installation
from acp_lab.commands.lab import SETTINGS, course_folder
from acp_lab.commands.replay_web import address_in, without_telemetry
from acp_lab.display.replay.file import check_replay
from acp_lab.display.replay.recorder import Replay
from tests.cli_runner import assert_one_error, run
from tests.display.made_run import play


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
        # What is shown may be a copy that is gone afterwards.
        shown = Path(command[3]).read_bytes() if "rerun" in command else b""
        calls.append((command, {**options, "shown": shown}))
        return subprocess.CompletedProcess(command, 0)

    monkeypatch.setattr(subprocess, "Popen", Process)
    monkeypatch.setattr(subprocess, "run", start)
    monkeypatch.setenv("DISPLAY", ":0")
    return calls


@pytest.fixture
def replay(tmp_path: Path) -> Path:
    path = tmp_path / "run.rrd"
    play([Replay(path)])
    return path


def test_the_viewer_listens_on_this_machine_only(
    capsys: pytest.CaptureFixture[str], started: list[tuple[list[str], dict[str, Any]]], replay: Path
) -> None:
    assert run(capsys, "replay", replay).status == 0
    command, _ = started[0]
    assert command[:4] == [sys.executable, "-m", "rerun", str(replay)]
    assert command[command.index("--bind") + 1] == "127.0.0.1"


def test_the_viewer_sends_no_usage_statistics(
    capsys: pytest.CaptureFixture[str],
    started: list[tuple[list[str], dict[str, Any]]],
    replay: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("CI", raising=False)
    monkeypatch.setenv("FORCE_RERUN_ANALYTICS", "1")
    assert run(capsys, "replay", replay).status == 0
    ((_, options),) = started
    assert options["env"]["CI"]
    assert "FORCE_RERUN_ANALYTICS" not in options["env"]
    assert options["env"]["PATH"]


def test_rerun_keeps_that_promise(replay: Path, tmp_path: Path) -> None:
    """Its program, started as ours starts it, leaves nothing behind; without our word it would."""
    home = tmp_path / "home"
    home.mkdir()
    command = [sys.executable, "-m", "rerun", "rrd", "verify", str(replay)]
    for environment, leaves_something in ((without_telemetry(), False), ({**os.environ}, True)):
        own = {name: value for name, value in environment.items() if not name.startswith("XDG_")}
        if leaves_something:
            own.pop("CI", None)
        subprocess.run(command, env={**own, "HOME": str(home)}, check=True, capture_output=True)
        if sys.platform.startswith("linux"):
            assert any(home.rglob("analytics*")) == leaves_something


def test_films_say_what_they_need(
    capsys: pytest.CaptureFixture[str], replay: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "av", None)
    outcome = run(capsys, "replay", replay, "--mp4", tmp_path / "film.mp4")
    assert_one_error(outcome, "film.mp4", "films need PyAV")


def test_two_replays_are_shown_as_one(
    capsys: pytest.CaptureFixture[str], started: list[tuple[list[str], dict[str, Any]]], replay: Path, tmp_path: Path
) -> None:
    other = tmp_path / "other.rrd"
    play([Replay(other)], with_truth=False)
    done = run(capsys, "replay", replay, other)
    assert done.status == 0
    assert done.err == ""
    ((command, options),) = started
    assert command[3].endswith(".rrd")
    assert command[command.index("--bind") + 1] == "127.0.0.1"
    assert options["shown"].startswith(b"RRF2")
    assert not Path(command[3]).exists()


@pytest.mark.parametrize(
    ("name", "begin", "told", "told_of_films"),
    [
        ("made/test/000001", 0, "", ""),
        ("made/test/000001", 1, "do not show the same images in the same frames", ""),
        ("made/test/000002", 0, "show different sequences", "show different sequences"),
    ],
)
def test_other_images_beside_each_other_are_told(
    capsys: pytest.CaptureFixture[str],
    started: list[tuple[list[str], dict[str, Any]]],
    replay: Path,
    tmp_path: Path,
    name: str,
    begin: int,
    told: str,
    told_of_films: str,
) -> None:
    pytest.importorskip("av")
    other = tmp_path / "other.rrd"
    play([Replay(other)], name=name, begin=begin)
    for options, expected in (((), told), (("--mp4", tmp_path / "film.mp4"), told_of_films)):
        done = run(capsys, "replay", replay, other, *options)
        assert done.status == 0
        warnings = [line for line in done.err.splitlines() if line.startswith("warning")]
        assert len(warnings) == bool(expected)
        assert expected in "".join(warnings)


def test_a_torn_replay_is_shown_as_far_as_it_goes(
    capsys: pytest.CaptureFixture[str], started: list[tuple[list[str], dict[str, Any]]], replay: Path
) -> None:
    whole = replay.read_bytes()
    torn = whole[: check_replay(replay).whole_bytes - 40]
    replay.write_bytes(torn)
    done = run(capsys, "replay", replay)
    assert done.status == 0
    (line,) = done.err.splitlines()
    assert line.startswith("warning: ")
    assert "did not close this replay" in line
    ((_, options),) = started
    assert 0 < len(options["shown"]) < len(torn)
    assert torn.startswith(options["shown"])


def test_a_film(capsys: pytest.CaptureFixture[str], replay: Path, tmp_path: Path) -> None:
    pytest.importorskip("av")
    film = tmp_path / "film.mp4"
    done = run(capsys, "replay", replay, "--mp4", film)
    assert done.status == 0
    assert "film.mp4: written, 4 frames" in done.out
    assert film.read_bytes()[4:8] == b"ftyp"


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
    assert_one_error(run(capsys, "replay", replay, "--mp4", tmp_path), "--mp4")
    assert_one_error(run(capsys, "replay", replay, "--mp4", tmp_path / "film.avi"), "film.mp4")
    assert started == []


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems always have a display")
@pytest.mark.parametrize(("ending", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_without_a_display(
    replay: Path, monkeypatch: pytest.MonkeyPatch, ending: signal.Signals, status: int
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    environment = {**os.environ, "PYTHONPATH": str(Path(acp_lab.__file__).parents[1])}
    environment["http_proxy"] = "http://127.0.0.1:9"  # nobody there: what is on this machine needs no proxy
    command = [sys.executable, "-m", "acp_lab", "replay", str(replay)]
    # A group of its own, so that Ctrl-C can be sent to it, as a terminal does.
    served = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True, start_new_session=True)
    try:
        assert served.stdout is not None
        assert "--mp4" in served.stdout.readline()
        address = served.stdout.readline().strip()
        pages = [word for word in (address, served.stdout.readline()) if "http" in word]
        assert pages == [address], "one address, the one that shows the replay"
        url = urllib.parse.urlsplit(address)
        assert url.hostname == "127.0.0.1"
        data = urllib.parse.urlsplit(urllib.parse.parse_qs(url.query)["url"][0])
        with urllib.request.urlopen(f"http://{url.netloc}/") as page:
            assert (page.status, page.headers["Content-Type"]) == (200, "text/html")
            rules = dict(rule.split(" ", 1) for rule in page.headers["Content-Security-Policy"].split("; "))
            assert b"re_viewer.js" in page.read()
        assert rules.keys() == {"default-src", "connect-src"}
        assert [word for word in rules["connect-src"].split() if "://" in word] == [f"http://{data.netloc}"]
        assert "://" not in rules["default-src"]
        with pytest.raises(urllib.error.HTTPError, match="404"):
            urllib.request.urlopen(f"http://{url.netloc}/nothing.here")
        with socket.create_connection((url.hostname, int(url.port or 0))) as raw:
            raw.sendall(b"GET @nowhere.invalid/ HTTP/1.0\r\n\r\n")
            assert b" 400 " in raw.recv(100)
        socket.create_connection((str(data.hostname), int(data.port or 0))).close()
    finally:
        served.send_signal(ending)
    assert served.wait(timeout=30) == status
    with pytest.raises(OSError, match="refused"):
        socket.create_connection((str(data.hostname), int(data.port or 0)))


def test_the_address_of_the_page_that_shows_the_replay() -> None:
    page = "http://127.0.0.1:90"
    line = f"INFO Hosting a web-viewer at {page} - connect at {page}?url=rerun%2Bhttp%3A%2F%2Flocalhost%3A98%2Fproxy\n"
    assert address_in(line) == f"{page}/?url=rerun%2Bhttp%3A%2F%2F127.0.0.1%3A98%2Fproxy"
    assert address_in(f"INFO Hosting a web-viewer at {page}") is None


def test_lab_opens_the_first_notebook(
    capsys: pytest.CaptureFixture[str], started: list[tuple[list[str], dict[str, Any]]]
) -> None:
    assert run(capsys, "lab", "--no-browser").status == 0
    command, options = started[0]
    root = course_folder(None)
    assert str(root) in command
    (opened,) = (word.partition("/lab/tree/")[2] for word in command if "default_url" in word)
    assert (root / opened).is_file()
    assert "--ip=127.0.0.1" in command
    assert not any("token" in word for word in command)
    assert options["env"]["RERUN_NOTEBOOK_ASSET"] == "serve-local"
    assert str(SETTINGS) in options["env"]["JUPYTER_CONFIG_PATH"]
    assert (SETTINGS / "labconfig" / "default_setting_overrides.json").is_file()


def test_lab_says_what_the_notebooks_would_lack(
    capsys: pytest.CaptureFixture[str],
    started: list[tuple[list[str], dict[str, Any]]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    outcome = run(capsys, "lab", "--no-browser")
    assert outcome.status == 0
    assert ".[notebook]" in outcome.err
    assert len(started) == 1


def test_lab_without_notebooks(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(acp_lab, "__file__", str(tmp_path / "acp_lab" / "__init__.py"))
    monkeypatch.setattr(course_copy, "shipped_files", lambda: {})
    assert_one_error(run(capsys, "lab"), "notebooks")


def test_lab_in_a_checkout_copies_nothing(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert_one_error(run(capsys, "lab", tmp_path / "course"), "course", "checkout")
    assert not (tmp_path / "course").exists()


def test_advice_fits_how_it_was_installed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    assert "in the checkout" in installation.install_extra("step")
    monkeypatch.setattr(acp_lab, "__file__", str(tmp_path / "acp_lab" / "__init__.py"))
    assert installation.install_extra("step") == 'python -m pip install "acp_lab[step]"'
