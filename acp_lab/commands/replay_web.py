"""A replay in a browser: rerun's own web viewer, served on the loopback address, with the one address to open."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
import sys
import webbrowser
from pathlib import Path

from acp_lab.commands.replay_page import kept_home
from acp_lab.errors import AcpLabError

_ADDRESS = re.compile(r"connect at (http://127\.0\.0\.1:\d+)/?(\?url=[\w%.+-]+)")


def serve_to_browser(path: Path, opens: bool = False) -> int:
    """Serve one replay until Ctrl-C, and print its address; the server's exit status.

    opens: open the address in this machine's browser, too. Raises AcpLabError when the server does not start.
    """
    # Ports are whichever are free: the server's log says which.
    command = [sys.executable, "-m", "rerun", str(path), "--serve-web", "--bind", "127.0.0.1"]
    command += ["--web-viewer-port", "0", "--port", "0"]
    server = subprocess.Popen(
        command,
        stderr=subprocess.PIPE,
        text=True,
        encoding="utf-8",
        errors="replace",
        env={**without_telemetry(), "RUST_LOG": "info", "NO_COLOR": "1"},
        start_new_session=True,  # what is started is a wrapper, and the server its child: they end as a group
    )
    assert server.stderr is not None
    # Whoever ends this program means the server, too.
    before = signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    try:
        address = next(filter(None, map(address_in, server.stderr)), None)
        if address is None:
            raise AcpLabError(f"{path}: rerun's web viewer does not start: acp-lab doctor checks the viewer")
        with kept_home(address) as page:
            print(f"{page}\nopen it in a browser on this machine; Ctrl-C here ends it", flush=True)
            if opens:
                webbrowser.open(page)
            for _ in server.stderr:  # a pipe that nobody reads would stop the server
                pass
            return server.wait()
    finally:
        _end(server)
        signal.signal(signal.SIGTERM, before)


def address_in(line: str) -> str | None:
    """The address that shows the replay, from a line of the server's log; None when it names none.

    The log says `localhost`, which some browsers take for an address where nobody listens.
    """
    found = _ADDRESS.search(line)
    return f"{found[1]}/{found[2]}".replace("localhost", "127.0.0.1") if found else None


def without_telemetry() -> dict[str, str]:
    """The environment in which rerun's programs send no usage statistics and write no settings for them.

    Only these programs do: a `Replay` that is recorded, and one that is read, touch neither network nor home folder.
    """
    # What rerun 0.41 looks at (re_analytics, pipeline.rs): CI, whatever its value, unless the other one insists.
    kept = {name: value for name, value in os.environ.items() if name != "FORCE_RERUN_ANALYTICS"}
    return {**kept, "CI": "1"}


def _end(server: subprocess.Popen[str]) -> None:
    if sys.platform == "win32":
        server.terminate()  # the child gets the console's Ctrl-C itself
    else:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(server.pid, signal.SIGTERM)
    server.wait()
