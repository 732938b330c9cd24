"""What every source of frames offers, be it a data set, a folder of images, a video or a live camera."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import islice
from typing import Protocol

from acp_lab.errors import SequenceError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.sequences.frame import Frame, UnreadableFrame


class Sequence(Protocol):
    """A numbered run of frames and, where somebody measured it, the true pose of each object.

    Frames are read one at a time while they are asked for; nothing is kept.
    """

    @property
    def name(self) -> str:
        """For titles and files: "bcot_cat/test/000001", "clip.mp4"."""

    @property
    def scene_id(self) -> int:
        """The scene id in results; 1 for anything that is no BOP scene."""

    @property
    def frame_ids(self) -> tuple[int, ...]:
        """Image ids, rising; for a video what its header announces, for a live camera nothing."""

    @property
    def object_ids(self) -> tuple[int, ...]:
        """Ids of the objects to track: those of the first frame's truth.

        Without truth (1,) of one's own images, () of a data set.
        """

    def frames(self, max_frames: int | None = None) -> Iterator[Frame | UnreadableFrame]:
        """The frames from the first on, at most max_frames; each call starts anew."""

    def truth(self, frame_id: int, object_id: int) -> FloatArray | None:
        """The true cam_T_obj (4, 4), mm, of an object in a frame; None when it is not known."""

    @property
    def first_poses(self) -> Mapping[int, FloatArray]:
        """True cam_T_obj (4, 4) by object id in the first frame; SequenceError when there is no truth."""

    @property
    def first_pose(self) -> FloatArray:
        """The true cam_T_obj (4, 4) of the only object; SequenceError when there is none or more than one."""


def only_pose(name: str, poses: Mapping[int, FloatArray]) -> FloatArray:
    """The single pose of a mapping; SequenceError naming the objects when there are several."""
    if len(poses) != 1:
        ids = ", ".join(str(i) for i in sorted(poses))
        raise SequenceError(f"{name}: the first frame shows objects {ids}: take first_poses[object_id]")
    return next(iter(poses.values()))


def at_most(frames: Iterator[Frame | UnreadableFrame], max_frames: int | None) -> Iterator[Frame | UnreadableFrame]:
    """The first max_frames of an iterator, all of them for None; SequenceError for less than one."""
    if max_frames is None:
        return frames
    if max_frames < 1:
        raise SequenceError(f"max_frames is {max_frames}: ask for at least one frame")
    return islice(frames, max_frames)
