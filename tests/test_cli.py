"""The command line itself: help, usage errors, exit statuses, and that it starts light."""

from __future__ import annotations

import os
import subprocess
import sys
import time
import warnings
from pathlib import Path

import pytest

import acp_lab
from acp_lab.cli import main
from acp_lab.commands import console
from acp_lab.commands.regions import joined_regions
from acp_lab.errors import AcpLabError
from tests.cli_runner import assert_one_error, run

COMMANDS = ("demo", "prepare", "track", "detect", "bench", "eval", "replay", "methods", "doctor", "lab")
HEAVY = ("torch", "kornia", "rerun", "matplotlib", "pyrender", "cv2", "scipy", "trimesh", "numpy")


@pytest.mark.parametrize("words", [(), *((command,) for command in COMMANDS)])
def test_help_is_there_for_every_command(capsys: pytest.CaptureFixture[str], words: tuple[str, ...]) -> None:
    outcome = run(capsys, *words, "--help")
    assert (outcome.status, outcome.err) == (0, "")
    assert "Usage: acp-lab" in outcome.out


def test_top_help_names_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    text = run(capsys, "--help").out
    assert all(f"\n  {command} " in text for command in COMMANDS)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ((), "Missing command"),
        (("nothing",), "nothing"),
        (("track", "--nothing"), "--nothing"),
        (("track",), "--parts"),
        (("track", "x", "--parts", "p", "--out", "o.csv", "--threads", "none"), "--threads"),
        (("track", "x", "--parts", "p", "--out", "o.csv", "--threads", "0"), "--threads"),
        (("track", "x", "--parts", "p", "--out", "o.csv", "--max-frames", "0"), "--max-frames"),
        (("track", "x", "--parts", "p", "--out", "o.csv", "--seed", "-1"), "--seed"),
        (("track", "x", "y", "--parts", "p", "--out", "o.csv"), "y"),
        (("prepare", "--out", "p"), "MESH"),
        (("prepare", "a.ply"), "--out"),
        (("prepare", "a.ply", "--out", "p", "--generator", "magic"), "magic"),
        (("prepare", "a.ply", "--out", "p", "--regions", "6"), "--regions 6"),
        (("prepare", "a.ply", "--out", "p", "--regions", "some"), "--regions some"),
        (("prepare", "a.ply", "--out", "p", "--edge-break", "-1"), "--edge-break"),
        (("prepare", "a.ply", "--out", "p", "--edge-break", "nan"), "--edge-break"),
        (("eval", "x"), "results.csv"),
        (("bench", "--noise", "2"), "--noise 2"),
        (("bench", "--steps", "0"), "--steps 0"),
        (("bench", "--steps", "x"), "--steps x"),
        (("bench", "--seeds", "0"), "--seeds 0"),
        (("bench", "--jobs", "0"), "--jobs 0"),
        (("bench", "--jobs", "257"), "--jobs 257: give 1 to 256"),
        (("bench", "--scheduler", ""), "--scheduler '': is no address"),
        (("bench", "--methods", "magic"), "--methods magic"),
        (("bench", "--methods", ""), "--results-from"),
        (("bench", "nowhere"), "nowhere"),
        (("replay",), "FILE.rrd"),
    ],
)
def test_bad_usage_is_one_line(capsys: pytest.CaptureFixture[str], words: tuple[str, ...], expected: str) -> None:
    assert_one_error(run(capsys, *words), expected)


def test_the_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(capsys, "--version").out == f"acp_lab {acp_lab.__version__}\n"


def test_a_message_of_many_lines_becomes_one(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(out: Path) -> None:
        raise AcpLabError("first\n  second\n\nthird")

    monkeypatch.setattr("acp_lab.commands.demo.run_demo", fail)
    assert run(capsys, "demo").err == "error: first second third\n"


def test_ctrl_c_exits_130(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(out: Path) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("acp_lab.commands.demo.run_demo", interrupt)
    outcome = run(capsys, "demo")
    assert (outcome.status, outcome.err) == (130, "note: interrupted\n")


def test_system_errors_name_the_file(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(out: Path) -> None:
        raise PermissionError(13, "Permission denied", "secret.csv")

    monkeypatch.setattr("acp_lab.commands.demo.run_demo", fail)
    assert_one_error(run(capsys, "demo"), "secret.csv", "Permission denied")


def test_our_own_faults_exit_1_and_say_where(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(out: Path) -> None:
        raise ZeroDivisionError("oh")

    monkeypatch.setattr("acp_lab.commands.demo.run_demo", fail)
    outcome = run(capsys, "demo")
    assert outcome.status == 1
    assert outcome.err.count("\n") == 1
    assert "ZeroDivisionError in test_cli.py" in outcome.err


def test_signs_that_the_output_cannot_hold_are_escaped() -> None:
    """As where Windows writes to a pipe, or a locale is Latin-1."""
    code = (
        "import sys; from acp_lab.cli import main; from acp_lab.commands import demo; "
        "demo.run_demo = lambda out: print('5 °, Ω'); sys.exit(main(['demo']))"
    )
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, env={**os.environ, "PYTHONIOENCODING": "ascii"}, capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (0, b"")
    assert done.stdout.split() == [b"5", rb"\xb0,", rb"\u03a9"]


def test_notes_wait_for_success(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    def succeed(out: Path) -> None:
        console.note("worth knowing")

    def fail(out: Path) -> None:
        console.note("worth knowing")
        raise AcpLabError("no")

    monkeypatch.setattr("acp_lab.commands.demo.run_demo", succeed)
    assert run(capsys, "demo").err == "note: worth knowing\n"
    monkeypatch.setattr("acp_lab.commands.demo.run_demo", fail)
    assert run(capsys, "demo").err == "error: no\n"


def test_regions_may_be_several_words() -> None:
    assert joined_regions(["a.ply", "--regions", "0", "2", "5", "b.ply"]) == [
        "a.ply",
        "--regions",
        "0,2,5",
        "b.ply",
    ]
    assert joined_regions(["--regions", "0,2", "--out", "x"]) == ["--regions", "0,2", "--out", "x"]
    assert joined_regions(["--regions", "all", "a.ply"]) == ["--regions", "all", "a.ply"]
    assert joined_regions(["a.ply", "--regions"]) == ["a.ply", "--regions"]


def test_regions_of_several_options_are_all_prepared() -> None:
    once = ["a.ply", "--regions", "0,2,5", "--out", "x"]
    assert joined_regions(["a.ply", "--regions", "0", "--regions", "2", "--out", "x", "--regions", "5"]) == once
    assert joined_regions(["a.ply", "--regions=0,2", "--out", "x", "--regions=5"]) == once
    assert joined_regions(["--regions", "2", "--regions"]) == ["--regions", "2", "--regions"]


def test_unknown_name_of_the_face() -> None:
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        acp_lab.nothing  # noqa: B018


def test_every_name_of_the_face_can_be_loaded() -> None:
    for name in acp_lab.__all__:
        assert getattr(acp_lab, name) is not None
    assert set(acp_lab.__all__) <= set(dir(acp_lab))


def test_the_command_line_starts_light() -> None:
    code = f"import sys, acp_lab.cli; print([m for m in {HEAVY} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_help_comes_at_once() -> None:
    def seconds() -> float:
        start = time.perf_counter()
        subprocess.run([sys.executable, "-m", "acp_lab", "--help"], capture_output=True, check=True)
        return time.perf_counter() - start

    # The best of three: what counts is the program, not what else the machine is doing.
    assert min(seconds() for _ in range(3)) < 1.0


def test_libraries_cannot_write_to_stderr_and_we_can() -> None:
    code = (
        "import os, sys, warnings\n"
        "import acp_lab.cli, acp_lab.commands.demo as demo\n"
        "from acp_lab.errors import AcpLabError\n"
        "def run(out):\n"
        "    os.write(2, b'grumbling C code\\n')\n"
        "    warnings.warn('from elsewhere')\n"
        "    raise AcpLabError('ours')\n"
        "demo.run_demo = run\n"
        "sys.exit(acp_lab.cli.main(['demo']))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (2, "error: ours\n")


def test_progress_is_silent_without_a_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    with console.Progress() as progress:
        progress("training", 1, 10)
    assert capsys.readouterr().err == ""


def test_main_takes_words_or_the_command_line(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", ["acp-lab", "--help"])
    assert main() == 0
    assert "Usage: acp-lab" in capsys.readouterr().out


def test_other_packages_warnings_are_no_notes(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where the checkout's folder, with the environment in it, is called acp_lab."""
    monkeypatch.delenv("ACP_LAB_DEBUG", raising=False)
    with console.warnings_as_notes():
        warnings.warn_explicit("nobody's", UserWarning, str(tmp_path / "acp_lab" / "lib" / "torch.py"), 1)
        warnings.warn_explicit("one of ours", UserWarning, str(Path(console.__file__).parents[1] / "units.py"), 1)
    console.release_notes()
    assert capsys.readouterr().err == "note: one of ours\n"
