"""How a command that failed says so: one line `error: …` on stderr, and an exit status."""

from __future__ import annotations

import errno
import os
import select
import sys
import traceback
from pathlib import Path

from acp_lab.commands import console
from acp_lab.errors import AcpLabError


def tell_failure(error: Exception) -> int:
    """Print the one line that an exception deserves; the exit status."""
    if console.debugging():
        traceback.print_exc()
    if isinstance(error, AcpLabError):
        console.say("error", str(error))
        return 2
    if hasattr(error, "format_message"):  # bad usage, as typer words it
        console.say("error", f"{error.format_message().rstrip('. ')}: see {_help_of(error)}")
        return 2
    if isinstance(error, OSError) and error.errno == errno.EPIPE and _nobody_reads():
        # Whoever read our output has seen enough; keep Python from complaining when it flushes at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    if isinstance(error, OSError) and error.strerror:
        where = f"{error.filename}: " if error.filename else "the output: "
        console.say("error", f"{where}{error.strerror}: check the path, its permissions and the disk")
        return 2
    frame = traceback.extract_tb(error.__traceback__)[-1]
    console.say(
        "error",
        f"unexpected {type(error).__name__} in {Path(frame.filename).name}:{frame.lineno}: {error} "
        "(this is a fault of acp_lab: ACP_LAB_DEBUG=1 shows the whole trace)",
    )
    return 1


def _nobody_reads() -> bool:
    """Whether stdout is a pipe whose reader is gone; also where the system cannot tell."""
    if not hasattr(select, "poll"):
        return True
    poll = select.poll()
    poll.register(sys.stdout.fileno(), select.POLLOUT)
    return any(happened & select.POLLERR for _, happened in poll.poll(0))


def _help_of(error: Exception) -> str:
    path = getattr(getattr(error, "ctx", None), "command_path", None) or "acp-lab"
    return f"{path} --help"
