"""A sequence that is changed on the way: frames left out, images painted over, another camera.

For failures that are made on purpose. Image ids and truth are those of the sequence behind it, so that the same part
is tracked, and judged, under other conditions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping

from acp_lab.errors import SequenceError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.sequences.protocol import Sequence, at_most

Change = Callable[[Frame], Frame | UnreadableFrame]


def unchanged(frame: Frame) -> Frame:
    """The frame itself."""
    return frame


class AlteredSequence:
    """Some frames of another sequence, each one as `change` returns it.

    change: gets each frame that can be read; it returns a new one (`dataclasses.replace`) and leaves the old one as
    it is. The same frame must always give the same result: viewers read frames again. frame_ids: the images to
    keep, all by default, also of a sequence that does not announce them. name: by default the sequence's own.
    Raises SequenceError for a frame id that the sequence does not have, and when its first frame is left out.
    """

    def __init__(
        self, sequence: Sequence, change: Change = unchanged, frame_ids: Iterable[int] | None = None, name: str = ""
    ) -> None:
        kept = tuple(sequence.frame_ids if frame_ids is None else sorted(frame_ids))
        unknown = sorted(set(kept) - set(sequence.frame_ids))
        if unknown:
            raise SequenceError(f"{sequence.name}: has no frame {unknown[0]}: keep others")
        if kept[:1] != sequence.frame_ids[:1]:
            raise SequenceError(f"{sequence.name}: its first frame is left out, where the start pose belongs: keep it")
        self.sequence, self.change, self.frame_ids = sequence, change, kept
        self._keeps_all = frame_ids is None
        self.name = name or sequence.name
        self.scene_id = sequence.scene_id
        self.object_ids = sequence.object_ids

    def frames(self, max_frames: int | None = None) -> Iterator[Frame | UnreadableFrame]:
        """The frames that are left, changed; each call starts anew."""
        return at_most(self._changed(), max_frames)

    def truth(self, frame_id: int, object_id: int) -> FloatArray | None:
        """As in the sequence behind it."""
        return self.sequence.truth(frame_id, object_id)

    @property
    def first_poses(self) -> Mapping[int, FloatArray]:
        """As in the sequence behind it, whose first frame is never left out."""
        return self.sequence.first_poses

    @property
    def first_pose(self) -> FloatArray:
        """As in the sequence behind it."""
        return self.sequence.first_pose

    def _changed(self) -> Iterator[Frame | UnreadableFrame]:
        kept = frozenset(self.frame_ids)
        for frame in self.sequence.frames():
            if self._keeps_all or frame.index in kept:
                yield self.change(frame) if isinstance(frame, Frame) else frame
