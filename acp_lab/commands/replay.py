"""`acp-lab replay`: opens replays in the rerun viewer or in a browser, two of them side by side, or makes films."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from acp_lab.commands import console
from acp_lab.commands.replay_web import serve_to_browser, without_telemetry
from acp_lab.errors import InputFileError

if TYPE_CHECKING:
    from acp_lab.display.replay.file import ReplayContent, ReplayFile

DIFFERENT_SEQUENCES = "the two replays show different sequences: frame k of one stands beside frame k of the other"
OTHER_IMAGES = (
    "the two replays do not show the same images in the same frames: frame k of one stands beside frame k of the "
    "other; a film, --mp4 FILE.mp4, has the same images beside each other"
)


def show_replays(files: tuple[Path, ...], mp4: Path | None = None, web: bool = False) -> int:
    """Open the viewer on one or two replays and wait until it is closed; the viewer's exit status.

    mp4: write a film there instead. web: show them in a browser, as is done anyway without a display. A replay
    that its run did not close is shown as far as it goes, and a warning says how far that is.
    """
    if len(files) > 2:
        raise InputFileError(f"{files[2]}: one replay too many: give one, or two to compare")
    from acp_lab.display.replay.file import check_replay

    replays = [check_replay(file) for file in files]
    if mp4 is not None:
        return _make_film(replays, mp4)
    if not (web or has_display()):
        print("no display here, so a browser shows the replay (--mp4 FILE makes a film instead):")
    open_viewer = _open_viewer if has_display() and not web else partial(serve_to_browser, opens=has_display())
    return _show_one(replays[0], open_viewer) if len(replays) == 1 else _compare(replays, open_viewer)


def has_display() -> bool:
    """Whether a window can be opened here."""
    return not sys.platform.startswith("linux") or any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY")))


def _show_one(replay: ReplayFile, open_viewer: Callable[[Path], int]) -> int:
    from acp_lab.display.replay.file import readable

    if not replay.is_complete:
        _read(replay)
    with readable(replay) as path:
        return open_viewer(path)


def _compare(replays: list[ReplayFile], open_viewer: Callable[[Path], int]) -> int:
    from acp_lab.display.replay.file import merge_replays
    from acp_lab.display.replay.frames import images_of

    contents = dict(zip("ab", map(_read, replays), strict=True))
    one, other = map(images_of, contents.values())
    if set(one).isdisjoint(other):
        console.warn(DIFFERENT_SEQUENCES)
    elif any(a != b for a, b in zip(one, other, strict=False)):
        console.warn(OTHER_IMAGES)
    with tempfile.TemporaryDirectory(prefix="acp_lab_replay_") as folder:
        both = Path(folder) / "comparison.rrd"
        merge_replays(contents, both)
        return open_viewer(both)


def _make_film(replays: list[ReplayFile], mp4: Path) -> int:
    from acp_lab.display.replay.frames import images_of
    from acp_lab.display.replay.overlay_video import write_film

    if mp4.is_dir():
        raise InputFileError(f"{mp4}: is a folder: --mp4 needs a file name")
    if mp4.suffix.lower() != ".mp4":
        raise InputFileError(f"{mp4}: --mp4 writes MP4 only: name it {mp4.with_suffix('.mp4').name}")
    if any(mp4.resolve() == replay.path.resolve() for replay in replays):
        raise InputFileError(f"{mp4}: --mp4 would overwrite the replay: choose another file")
    contents = [_read(replay) for replay in replays]
    if len(contents) > 1 and set(images_of(contents[0])).isdisjoint(images_of(contents[1])):
        console.warn(DIFFERENT_SEQUENCES)
    frames = write_film(contents, mp4, console.Progress())
    print(f"{mp4}: written, {frames} frames")
    return 0


def _read(replay: ReplayFile) -> ReplayContent:
    from acp_lab.display.replay.file import read_replay

    content = read_replay(replay)
    if content.loss:
        console.warn_on_success(content.loss)
    return content


def _open_viewer(path: Path) -> int:
    # Without --bind the viewer would listen on all network interfaces.
    command = [sys.executable, "-m", "rerun", str(path), "--bind", "127.0.0.1"]
    return subprocess.run(command, check=False, stderr=sys.stderr, env=without_telemetry()).returncode
