"""What a command says where nobody listens: a reader that is gone, a stream that is closed, a disk that is full."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

COMMAND = f"{sys.executable} -m acp_lab"

pytestmark = pytest.mark.skipif(os.name != "posix", reason="asks a POSIX shell")


def shell(line: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(["bash", "-c", line], check=False, capture_output=True, text=True, timeout=120)


def test_a_reader_that_has_seen_enough_is_no_fault() -> None:
    done = shell(f"{COMMAND} methods acp | true; echo ${{PIPESTATUS[0]}}")
    assert done.stdout.strip() == "0"
    assert done.stderr == ""


def test_a_full_disk_behind_stdout_is_one_line() -> None:
    done = shell(f"{COMMAND} methods > /dev/full")
    assert done.returncode == 2
    assert done.stderr == "error: the output: No space left on device: check the path, its permissions and the disk\n"


def test_notes_stay_out_of_the_results_where_stderr_is_closed(tmp_path: Path) -> None:
    code = "from acp_lab.commands import console; console.say('note', 'not for stdout'); print('a result')"
    done = shell(f'{sys.executable} -c "{code}" 2>&-')
    assert done.stdout == "a result\n"
