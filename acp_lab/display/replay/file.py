"""Reading replays back: is the file whole, what does it hold, and two of them as one.

An .rrd file is a row of messages, each with its length before it, and an end mark when the run closed it. A
killed run leaves no end mark and perhaps a torn last message; everything before that can be read.
"""

from __future__ import annotations

import math
import shutil
import struct
import tempfile
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from acp_lab.display.replay.blueprint import Spot
from acp_lab.errors import InputFileError
from acp_lab.input_file import check_regular
from acp_lab.pasted import quoted

if TYPE_CHECKING:
    from rerun.chunk import Chunk

RUN_ENTITY = "/__properties/acp_lab_run"
_MAGIC = b"RRF2"
_OTHER_MAGICS = (b"RRF0", b"RRF1", b"RRIO")
_HEADER_BYTES = 12
_MESSAGE = struct.Struct("<QQ")  # kind, length of what follows
_KINDS = 4
_END = 0


@dataclass(frozen=True)
class ReplayFile:
    """A replay on disk. whole_bytes: of the messages that are whole. is_complete: the run closed it."""

    path: Path
    whole_bytes: int
    is_complete: bool


@dataclass(frozen=True)
class ReplayContent:
    """The chunks of a replay and what its run said of itself.

    announced: how many frames each scene had to offer, 0 where nobody knew. scenes: their names.
    objects: names of the tracked objects' entities, in the order of their colours.
    spot: where in space they were first. last_frame: on the timeline `frame`, -1 without any.
    """

    file: ReplayFile
    chunks: tuple[Chunk, ...]
    announced: tuple[int, ...]
    scenes: tuple[str, ...]
    objects: tuple[str, ...]
    spot: Spot
    last_frame: int

    @property
    def loss(self) -> str:
        """What an incomplete file lacks, as one line for a warning; empty for a complete one."""
        if self.file.is_complete:
            return ""
        count, known = self.last_frame + 1, sum(self.announced) if all(self.announced) else 0
        shown = f"its first {count} frames{f' of {known}' if known else ''} can be seen, the rest is lost"
        if count == known:
            shown = f"all {count} frames can be seen"
        return f"{self.file.path}: the run did not close this replay (killed, or still going on): {shown}"


def check_replay(path: Path) -> ReplayFile:
    """Look at a file's frame; InputFileError when it is no replay or holds nothing whole."""
    try:
        check_regular(path, "give a replay, a .rrd file", math.inf)
        with path.open("rb") as stream:
            magic = stream.read(4)
            if not magic:
                raise InputFileError(f"{path}: the file is empty: write it again with acp-lab track --replay")
            if magic in _OTHER_MAGICS:
                raise InputFileError(f"{path}: was written by an old rerun: run rerun rrd migrate {quoted(path)}")
            if magic != _MAGIC:
                raise InputFileError(f"{path}: is no replay: acp-lab track --replay FILE.rrd writes one")
            size = path.stat().st_size
            at = _HEADER_BYTES
            while at + _MESSAGE.size <= size:
                stream.seek(at)
                kind, length = _MESSAGE.unpack(stream.read(_MESSAGE.size))
                if kind >= _KINDS or at + _MESSAGE.size + length > size:
                    break
                if kind == _END:
                    return ReplayFile(path, at, True)
                at += _MESSAGE.size + length
    except FileNotFoundError:
        raise InputFileError(f"{path}: no such replay: acp-lab track --replay {quoted(path)} writes one") from None
    except OSError as error:
        raise InputFileError(f"{path}: cannot be read ({error.strerror}): give a replay, a .rrd file") from None
    if at == _HEADER_BYTES:
        raise InputFileError(f"{path}: is cut off before its first frame: write it again with acp-lab track --replay")
    return ReplayFile(path, at, False)


@contextmanager
def readable(file: ReplayFile) -> Iterator[Path]:
    """A path that rerun reads: the file itself, or while the context lasts a copy without its torn end."""
    if file.is_complete:
        yield file.path
        return
    with tempfile.TemporaryDirectory(prefix="acp_lab_replay_") as folder:
        copy = Path(folder) / file.path.name
        with file.path.open("rb") as source, copy.open("wb") as target:
            shutil.copyfileobj(source, target)
            target.truncate(file.whole_bytes)
        yield copy


def read_replay(file: ReplayFile) -> ReplayContent:
    """All chunks of a replay; InputFileError when it is damaged or was not written by acp_lab."""
    from rerun.chunk import RrdReader

    try:
        with readable(file) as path, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of the missing footer, which we know of
            chunks = tuple(RrdReader(path).stream().to_chunks())
    except Exception as error:  # whatever rerun's reader, written in Rust, makes of a damaged file
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputFileError(
            f"{file.path}: the replay is damaged ({reason}): write it again with acp-lab track --replay"
        ) from None
    properties = next((chunk for chunk in reversed(chunks) if str(chunk.entity_path) == RUN_ENTITY), None)
    if properties is None:
        raise InputFileError(f"{file.path}: was not written by acp_lab: open it with rerun {file.path}")
    values = {name: column[0] for name, column in properties.to_record_batch().to_pydict().items()}
    last = max((max(frames_of(chunk), default=-1) for chunk in chunks), default=-1)
    return ReplayContent(
        file,
        chunks,
        tuple(values["frames"]),
        tuple(values["scenes"]),
        tuple(values["objects"]),
        Spot(np.array(values["centre"]), float(values["reach"][0])),
        last,
    )


def frames_of(chunk: Chunk) -> list[int]:
    """When its rows are, on the timeline `frame`; empty for chunks that are not on it."""
    if "frame" not in chunk.timeline_names:
        return []
    return [int(frame) for frame in chunk.to_record_batch().column("frame").to_pylist()]


def merge_replays(contents: Mapping[str, ReplayContent], path: Path) -> None:
    """Write two replays as one, side by side on the same timelines, laid out for comparison.

    contents: by the names below which their entities go, such as "a" and "b".
    """
    import rerun as rr

    from acp_lab.display.replay.blueprint import comparison
    from acp_lab.display.replay.curves import log_run_styles
    from acp_lab.display.replay.recorder import APPLICATION

    recording = rr.RecordingStream(APPLICATION, recording_id=" and ".join(contents))
    recording.save(path)
    recording.set_log_time_enabled(False)
    recording.set_log_tick_enabled(False)
    titles = {root: f"{root.upper()}: {content.file.path.stem}" for root, content in contents.items()}
    recording.send_recording_name(", ".join(titles.values()))
    first = next(iter(contents.values()))
    layout = comparison(titles, {root: content.objects for root, content in contents.items()}, first.spot)
    recording.send_blueprint(layout, make_active=True, make_default=True)
    for root, content in contents.items():
        named = [chunk for chunk in content.chunks if not str(chunk.entity_path).startswith("/__")]
        recording.send_chunks([chunk.with_entity_path(f"/{root}{chunk.entity_path}") for chunk in named])
    log_run_styles(recording, {root: content.objects for root, content in contents.items()})
    recording.flush()
    recording.disconnect()
