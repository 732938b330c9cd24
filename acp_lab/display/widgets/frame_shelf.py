"""The frames of a sequence in any order, compressed, for a player that jumps about.

A data set has a file per frame, which goes to the browser as it is when it is a JPEG that no note of a camera turns.
A video or a camera only runs forward: what was passed is kept, compressed, some 60 kB a frame at 640 x 512.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from acp_lab.display.widgets.picture import jpeg_bytes
from acp_lab.errors import AcpLabError, SequenceError
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.sequences.image_header import is_turned
from acp_lab.sequences.protocol import Sequence
from acp_lab.tracking.session import image_path_of


@dataclass(frozen=True)
class ShelvedFrame:
    """content: bytes of a JPEG, b"" where the frame cannot be read. size: (width, height) px, (0, 0) then.
    note: why it cannot be read, else ""."""

    content: bytes
    size: tuple[int, int]
    note: str = ""


class FrameShelf:
    """Frames by their image ids."""

    def __init__(self, sequence: Sequence) -> None:
        self._sequence = sequence
        self._path_of = image_path_of(sequence)
        self._read = getattr(sequence, "frame", None)
        self._coming: Iterator[Frame | UnreadableFrame] | None = None
        self._passed: dict[int, ShelvedFrame] = {}

    def __call__(self, frame_id: int) -> ShelvedFrame:
        """The frame of an image id; SequenceError when the sequence has none."""
        if self._read is not None:
            frame = self._read(frame_id)
            path = self._path_of(frame_id) if self._path_of else None
            return _shelved(frame, path)
        if self._coming is None:
            self._coming = self._sequence.frames()
        while frame_id not in self._passed:
            frame = next(self._coming, None)
            if frame is None:
                raise SequenceError(f"{self._sequence.name}: no frame {frame_id}: give the sequence of this run")
            self._passed[frame.index] = _shelved(frame, None)
        return self._passed[frame_id]


def _shelved(frame: Frame | UnreadableFrame, path: Path | None) -> ShelvedFrame:
    if isinstance(frame, UnreadableFrame):
        return ShelvedFrame(b"", (0, 0), frame.reason)
    size = (frame.camera.width, frame.camera.height)
    if path is not None and path.suffix.lower() in (".jpg", ".jpeg"):
        try:
            content = path.read_bytes()
        except OSError as error:
            raise AcpLabError(f"{path}: cannot be read ({error.strerror}): check the data set") from None
        if not is_turned(content):  # a browser would turn it below overlays that are not
            return ShelvedFrame(content, size)
    return ShelvedFrame(jpeg_bytes(frame.image), size)
