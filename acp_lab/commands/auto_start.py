"""`acp-lab track --init auto`: start poses that are found in the images, not given."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from acp_lab.commands import console, interrupt
from acp_lab.errors import SequenceError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.sequences.protocol import Sequence, at_most

FRAMES_TO_TRY = 30


class LaterStart:
    """A sequence from one of its frames on; everything else is that of the sequence behind it."""

    def __init__(self, sequence: Sequence, first_id: int) -> None:
        self.sequence, self.first_id = sequence, first_id
        self.name, self.scene_id, self.object_ids = sequence.name, sequence.scene_id, sequence.object_ids
        self.frame_ids = tuple(i for i in sequence.frame_ids if i >= first_id)

    def frames(self, max_frames: int | None = None) -> Iterator[Frame | UnreadableFrame]:
        """From the start on, at most max_frames."""
        return at_most((f for f in self.sequence.frames() if f.index >= self.first_id), max_frames)

    def truth(self, frame_id: int, object_id: int) -> FloatArray | None:
        """As in the sequence behind it."""
        return self.sequence.truth(frame_id, object_id)

    @property
    def first_poses(self) -> Mapping[int, FloatArray]:
        """Of the sequence behind it, in its own first frame."""
        return self.sequence.first_poses

    @property
    def first_pose(self) -> FloatArray:
        """Of the sequence behind it, in its own first frame."""
        return self.sequence.first_pose


@dataclass(frozen=True, eq=False)
class FoundStart:
    """Where tracking can begin: the image, and the poses (4, 4) of the objects that were found in it, by id."""

    frame_id: int
    poses: Mapping[int, FloatArray]


def find_starts(sequence: Sequence, models: Mapping[int, PreparedPart]) -> list[FoundStart]:
    """For each object the first of `FRAMES_TO_TRY` frames in which it is found, those of one frame together.

    Raises:
        SequenceError: an object is found in none of them.
    """
    from acp_lab.tracking.find import Finder

    missing = {object_id: Finder(model) for object_id, model in models.items()}
    starts = list[FoundStart]()
    for frame in sequence.frames(FRAMES_TO_TRY):
        if not missing:
            break
        interrupt.check()
        if isinstance(frame, UnreadableFrame):
            continue
        best = {object_id: finder.find(frame, 1) for object_id, finder in missing.items()}
        poses = {object_id: one[0].cam_T_obj for object_id, one in best.items() if one and one[0].is_accepted}
        if poses:
            starts.append(FoundStart(frame.index, poses))
            console.note(f"scene {sequence.scene_id}: found in image {frame.index}: object {_listed(poses)}")
        missing = {object_id: finder for object_id, finder in missing.items() if object_id not in poses}
    if missing:
        raise SequenceError(
            f"--init auto: object {_listed(missing)} is not found in the first {FRAMES_TO_TRY} frames of "
            f"{sequence.name}: give start poses, or look at what acp-lab detect makes of them"
        )
    return starts


def _listed(ids: Mapping[int, object]) -> str:
    return ", ".join(map(str, sorted(ids)))
