"""Ctrl-C is remembered where a library swallows it."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from acp_lab import cli
from acp_lab.commands import interrupt
from tests.key_presses import ends_within, pressed_at


def test_a_swallowed_key_is_not_lost() -> None:
    with interrupt.remembered():
        interrupt.check()
        with contextlib.suppress(KeyboardInterrupt):  # as libraries do around optional imports
            signal.raise_signal(signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            interrupt.check()
        assert interrupt.pressed()
    with interrupt.remembered():
        interrupt.check()  # forgotten when the command is over


def test_the_old_handler_comes_back() -> None:
    before = signal.getsignal(signal.SIGINT)
    with interrupt.remembered():
        assert signal.getsignal(signal.SIGINT) is not before
    assert signal.getsignal(signal.SIGINT) is before


def test_a_command_that_swallowed_the_key_exits_with_130(monkeypatch: pytest.MonkeyPatch) -> None:
    def swallow() -> int:
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        return 0

    monkeypatch.setattr("acp_lab.commands.doctor.print_report", swallow)
    assert cli.main(["doctor"]) == 130


PRESSED = """
import signal, sys
wanted = sys.argv.pop(1)
class Press:
    def find_spec(self, name, path=None, target=None):
        if name == wanted:
            sys.meta_path.remove(self)
            signal.raise_signal(signal.SIGINT)
sys.meta_path.insert(0, Press())
from acp_lab.__main__ import run
sys.exit(run())
"""


@pytest.mark.parametrize(
    "module",
    ["typer", "acp_lab.commands.console", "acp_lab.commands.machine", "numpy", "cv2", "acp_lab.cad.part", "rerun"],
)
def test_a_key_during_imports(module: str, dataset: Path, parts: Path, tmp_path: Path) -> None:
    """Whatever a library makes of it: exit 130, one line."""
    words = ("track", dataset, "--parts", parts, "--out", tmp_path / "r.csv", "--replay", tmp_path / "r.rrd")
    command = [sys.executable, "-c", PRESSED, module, *map(str, words)]
    done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stderr) == (130, "note: interrupted\n")


def test_no_module_is_left_half_imported(tmp_path: Path) -> None:
    """A C extension that was interrupted there may crash the process when it is used again."""
    (tmp_path / "halves.py").write_text(
        "import signal, time\nfirst = 1\nsignal.raise_signal(signal.SIGINT)\ntime.sleep(0.2)\nsecond = 2\n"
    )
    code = (
        "import sys, time\nfrom acp_lab.commands import interrupt\ninterrupt.listen()\n"
        "try:\n    import halves\n    time.sleep(30)\n"
        "except KeyboardInterrupt:\n    print(sys.modules['halves'].second)\n"
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), os.getcwd()])}
    done = subprocess.run(
        [sys.executable, "-c", code], check=False, capture_output=True, text=True, timeout=20, env=environment
    )
    assert (done.stdout, done.stderr) == ("2\n", "")


def test_after_its_work_a_command_cannot_be_torn() -> None:
    code = (
        "import signal, sys; from acp_lab.__main__ import run; sys.argv = ['acp-lab', '--version']; status = run(); "
        "signal.raise_signal(signal.SIGINT); sys.exit(status)"
    )
    done = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (0, "")


def test_it_is_said_once(capsys: pytest.CaptureFixture[str]) -> None:
    with interrupt.remembered():
        assert (interrupt.tell(), interrupt.tell()) == (130, 130)
    assert capsys.readouterr().err == "note: interrupted\n"


def test_an_error_that_a_key_turned_into_is_the_key(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def turn() -> int:
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        raise ImportError("cannot load module more than once per process")

    monkeypatch.setattr("acp_lab.commands.doctor.print_report", turn)
    assert cli.main(["doctor"]) == 130
    assert capsys.readouterr().err == "note: interrupted\n"


def test_a_second_key_while_the_first_is_taken_down() -> None:
    def press() -> None:
        with contextlib.suppress(KeyboardInterrupt):
            interrupt._remember(signal.SIGINT, None)

    for number in range(10):
        with interrupt.remembered():
            pressed_at(number, press)
            assert ends_within(10.0, press), f"the second key never ends, after the first at moment {number}"
            assert interrupt.pressed()
