"""`acp-lab lab`: opens JupyterLab on the first notebook of the course."""

from __future__ import annotations

import importlib.util
import os
import signal
import subprocess
import sys
from pathlib import Path

from acp_lab.commands import console
from acp_lab.commands.course_copy import copy_course
from acp_lab.commands.installation import checkout, install_extra
from acp_lab.errors import AcpLabError

FIRST = "notebooks/00_start_here.ipynb"
# Defaults of JupyterLab's settings, below the user's own: no news popup, and links to docs open rendered.
SETTINGS = Path(__file__).resolve().parent / "jupyter"


def course_folder(folder: Path | None = None) -> Path:
    """The folder that holds notebooks/ and docs/: the checkout, or a copy of what the wheel brings.

    folder: where the copy goes, `acp_lab_course` in the working folder when None. AcpLabError when there is no
    course, or when a folder is given in a checkout, which is worked in where it is.
    """
    source = checkout()
    if source is not None:
        if folder is not None:
            raise AcpLabError(
                f"{folder}: this is a checkout, whose notebooks are opened in {source}: leave the folder out"
            )
        return source
    folder = (folder or Path("acp_lab_course")).resolve()
    copied = copy_course(folder)
    print(f"the course is in {folder}" + (f" ({copied} files copied)" if copied else ""), flush=True)
    return folder


def open_lab(browser: bool = True, folder: Path | None = None) -> int:
    """Run JupyterLab on the loopback address, with its token, until it is stopped; its exit status."""
    root = course_folder(folder)
    if importlib.util.find_spec("rerun_notebook") is None:
        console.warn(f"replays will not show inside notebooks: {install_extra('notebook')}")
    # The folder above the notebooks is served, so that their links to docs/ work.
    command = [
        sys.executable,
        "-m",
        "jupyterlab",
        str(root),
        "--ip=127.0.0.1",
        f"--LabApp.default_url=/lab/tree/{FIRST}",
    ]
    if not browser:
        command.append("--no-browser")
    if hasattr(os, "geteuid") and os.geteuid() == 0:
        command.append("--allow-root")  # Jupyter refuses to run as root otherwise
    process = subprocess.Popen(command, env=lab_environment(), stderr=sys.stderr)
    # Whoever ends this program means JupyterLab, which shuts its kernels down.
    before = signal.signal(signal.SIGTERM, lambda *_: process.terminate())
    try:
        while True:
            try:
                return process.wait()
            except KeyboardInterrupt:
                continue  # Ctrl-C reaches JupyterLab too, which asks whether it was meant
    finally:
        signal.signal(signal.SIGTERM, before)


def lab_environment() -> dict[str, str]:
    """The environment of JupyterLab and its kernels: our default settings, and replays that need no network."""
    config = os.pathsep.join(filter(None, [os.environ.get("JUPYTER_CONFIG_PATH"), str(SETTINGS)]))
    # rerun's notebook viewer would fetch its page from the net; set before its first import.
    return {"RERUN_NOTEBOOK_ASSET": "serve-local", **os.environ, "JUPYTER_CONFIG_PATH": config}
