"""`acp-lab lab`: opens JupyterLab on the notebooks."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import acp_lab
from acp_lab.commands import console
from acp_lab.errors import AcpLabError


def notebooks_folder() -> Path:
    """The notebooks of the checkout that this package runs from; AcpLabError when there is none."""
    checkout = Path(acp_lab.__file__).resolve().parent.parent
    folder = checkout / "notebooks"
    if not (folder.is_dir() and (checkout / "pyproject.toml").is_file()):
        raise AcpLabError(
            f"{folder}: no notebooks here: they come with the source, not with the installed package; "
            "in a checkout of it, make lab opens them"
        )
    return folder


def open_lab(browser: bool = True) -> int:
    """Run JupyterLab on the loopback address, with its token, until it is stopped; its exit status."""
    if importlib.util.find_spec("rerun_notebook") is None:
        console.warn("replays will not show inside notebooks: python -m pip install -e '.[notebook]' (make lab does)")
    command = [sys.executable, "-m", "jupyterlab", str(notebooks_folder()), "--ip=127.0.0.1"]
    if not browser:
        command.append("--no-browser")
    if hasattr(os, "geteuid") and os.geteuid() == 0:
        command.append("--allow-root")  # Jupyter refuses to run as root otherwise
    # rerun's notebook viewer would fetch its page from the net; set before its first import.
    environment = {"RERUN_NOTEBOOK_ASSET": "serve-local", **os.environ}
    process = subprocess.Popen(command, env=environment, stderr=sys.stderr)
    while True:
        try:
            return process.wait()
        except KeyboardInterrupt:
            continue  # Ctrl-C reaches JupyterLab too, which asks whether it was meant
