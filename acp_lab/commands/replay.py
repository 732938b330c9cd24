"""`acp-lab replay`: opens replays in the rerun viewer."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from acp_lab.errors import AcpLabError, InputFileError

_RRD_START = (b"RRF", b"RRI")


def show_replays(files: tuple[Path, ...], mp4: Path | None = None) -> int:
    """Open the viewer on one or two replays and wait until it is closed; the viewer's exit status."""
    if mp4 is not None:
        raise AcpLabError(f"--mp4 {mp4}: films are not built yet: open the replay without --mp4")
    if len(files) > 2:
        raise InputFileError(f"{files[2]}: one replay too many: give one, or two to compare")
    for file in files:
        check_replay(file)
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise AcpLabError(
            f"{files[0]}: there is no display to open the viewer on: in a browser it opens with "
            f"rerun --web-viewer --bind 127.0.0.1 {' '.join(map(str, files))}"
        )
    # Without --bind the viewer would listen on all network interfaces.
    command = [sys.executable, "-m", "rerun", *map(str, files), "--bind", "127.0.0.1"]
    return subprocess.run(command, check=False, stderr=sys.stderr).returncode


def check_replay(file: Path) -> None:
    """Raise InputFileError when a file is no rerun recording."""
    try:
        with file.open("rb") as stream:
            start = stream.read(4)
    except FileNotFoundError:
        raise InputFileError(f"{file}: no such replay: acp-lab track --replay {file} writes one") from None
    except OSError as error:
        raise InputFileError(f"{file}: cannot be read ({error.strerror}): give a replay, a .rrd file") from None
    if not start:
        raise InputFileError(f"{file}: the file is empty: write it again with acp-lab track --replay")
    if not start.startswith(_RRD_START):
        raise InputFileError(f"{file}: is no replay: acp-lab track --replay FILE.rrd writes one")
