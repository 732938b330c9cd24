"""The rest of a sequence, from one of its frames on: where another run stopped, or where a part was found."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from acp_lab.errors import SequenceError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.sequences.bop import BopScene
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.sequences.protocol import Sequence, at_most


class RestOfSequence:
    """The frames of a sequence from the image id `first` on; ids and truth are the sequence's own.

    Raises SequenceError when the sequence announces its frames and `first` is none of them.
    """

    def __init__(self, sequence: Sequence, first: int) -> None:
        if sequence.frame_ids and first not in sequence.frame_ids:
            raise SequenceError(f"{sequence.name}: has no image {first} to go on from: track it from its first frame")
        self.sequence, self.first = sequence, first
        self.frame_ids = tuple(frame_id for frame_id in sequence.frame_ids if frame_id >= first)
        self.name, self.scene_id, self.object_ids = sequence.name, sequence.scene_id, sequence.object_ids

    def frames(self, max_frames: int | None = None) -> Iterator[Frame | UnreadableFrame]:
        """The frames from `first` on, read one at a time, at most max_frames; each call starts anew."""
        return at_most(self._rest(), max_frames)

    def truth(self, frame_id: int, object_id: int) -> FloatArray | None:
        """As in the whole sequence."""
        return self.sequence.truth(frame_id, object_id)

    @property
    def first_poses(self) -> Mapping[int, FloatArray]:
        """Always SequenceError: the first frame's truth is that of the whole sequence."""
        raise self._no_truth()

    @property
    def first_pose(self) -> FloatArray:
        """Always SequenceError."""
        raise self._no_truth()

    def _no_truth(self) -> SequenceError:
        return SequenceError(f"{self.name}: from image {self.first} on it starts from an estimate: give that")

    def _rest(self) -> Iterator[Frame | UnreadableFrame]:
        if isinstance(self.sequence, BopScene):  # nothing that is left out needs to be decoded
            yield from (self.sequence.frame(frame_id) for frame_id in self.frame_ids)
        else:
            yield from (frame for frame in self.sequence.frames() if frame.index >= self.first)
