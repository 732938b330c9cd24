"""`acp-lab`, and `python -m acp_lab`: Ctrl-C is listened to before anything heavy is imported."""

from __future__ import annotations

import os
import sys
import threading

from acp_lab.commands import interrupt


def run() -> int:
    """One command, from the process's own arguments; the exit status, 130 after Ctrl-C."""
    interrupt.listen()
    try:
        from acp_lab.cli import main

        status = main()
    except BaseException:
        if not interrupt.pressed():
            raise
        status = interrupt.tell()  # the key came while the command line itself was imported, or a second time
    interrupt.ignore()  # the work is done: nothing that Python takes down at its end may be torn
    if any(thread.daemon for thread in threading.enumerate()):
        # A library that does not come back, as rerun's writer on a full disk: Python's end would wait for it.
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
    return status


if __name__ == "__main__":
    sys.exit(run())
