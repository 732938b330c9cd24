"""The environment that holds cv2.rapid: made once with pip, apart from everything else."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from acp_lab.errors import PreparationError

REQUIREMENT = "opencv-contrib-python-headless>=4.10,<6"
VARIABLE = "ACP_LAB_PEERS"
"""Names another folder for it."""


def folder() -> Path:
    """Where it is, or would be."""
    named = os.environ.get(VARIABLE)
    return Path(named) if named else Path.home() / ".cache" / "acp_lab" / "peers"


def python() -> Path:
    """Its Python; PreparationError, naming the command to run, where it was not made yet."""
    path = folder() / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python")
    if not (folder() / "complete").exists() or not path.exists():
        raise PreparationError(f"{folder()}: cv2.rapid is not there: run acp-lab bench --install-peers")
    return path


def install() -> None:
    """Make it, unless it is there; takes what pip is told by its own configuration and environment variables.

    Raises PreparationError where pip fails, with the last thing that it said.
    """
    place = folder()
    if (place / "complete").exists():
        return
    place.parent.mkdir(parents=True, exist_ok=True)
    own = place / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python")
    for command in (
        [sys.executable, "-m", "venv", "--clear", str(place)],
        [str(own), "-m", "pip", "install", "--disable-pip-version-check", REQUIREMENT],
        [str(own), "-c", "import cv2; cv2.rapid"],
    ):
        done = subprocess.run(command, capture_output=True, text=True, check=False, env=clean_environment())
        if done.returncode:
            said = (done.stderr.strip() or done.stdout.strip() or "no reason").splitlines()[-1]
            raise PreparationError(f"{place}: cannot be made ({said}): see that pip can install {REQUIREMENT}")
    (place / "complete").touch()


def clean_environment() -> dict[str, str]:
    """Ours without what would lead the other Python to our packages."""
    return {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "PYTHONHOME")}
