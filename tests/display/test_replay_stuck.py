"""A writer of rerun that never comes back, as on a full disk: the run ends, and says so."""

from __future__ import annotations

import subprocess
import sys
import threading
from pathlib import Path

import pytest

from acp_lab.display.replay import recorder
from acp_lab.display.replay.recorder import Replay
from acp_lab.errors import InputFileError
from tests.display.made_run import play


class Stuck:
    """A recording that fails to flush, and waits for ever when it is closed."""

    def __init__(self) -> None:
        self.waits = threading.Event()

    def flush(self, timeout_sec: float) -> None:
        raise RuntimeError("Flush timed out")

    def disconnect(self) -> None:
        self.waits.wait()


def test_a_writer_that_hangs_is_not_waited_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recorder, "FLUSH_S", 0.05)
    replay = Replay(tmp_path / "run.rrd", sessions=2)
    play([replay])
    really, replay._recording = replay._recording, Stuck()
    with pytest.raises(InputFileError, match=r"run\.rrd: the replay could not be written to its end \(Flush timed out"):
        replay.close()
    replay.close()  # once is enough
    really.disconnect()


def test_python_ends_though_a_thread_does_not() -> None:
    code = (
        "import sys, threading, atexit, time\n"
        "from acp_lab.__main__ import run\n"
        "threading.Thread(target=time.sleep, args=(60,), daemon=True).start()\n"
        "atexit.register(time.sleep, 60)\n"
        "sys.argv = ['acp-lab', '--version']\n"
        "sys.exit(run())\n"
    )
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True, timeout=30)
    assert done.stdout.startswith("acp_lab ")
