"""Who may listen to a tracking session, and what listeners are told.

Things that look upward in the layers (results files, replays, progress bars) are handed to the session as observers;
a tracker knows none of them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from acp_lab.cad.part import Part
from acp_lab.geometry.arrays import FloatArray
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.tracking.result import TrackResult


@dataclass(frozen=True)
class TrackedObject:
    """One object of a tracking session.

    Attributes:
        object_id: in the data set.
        part: its CAD model.
        control_points_obj: (4, 3) mm per view region 0..5, the method's W; empty where a method has none.
    """

    object_id: int
    part: Part
    control_points_obj: tuple[FloatArray, ...] = field(default=(), compare=False)


@dataclass(frozen=True)
class SessionInfo:
    """What observers learn before the first frame.

    Attributes:
        name: of the sequence; scene_id: its id in results; method: such as "acp".
        objects: that are tracked.
        truth: truth(frame_id, object_id) -> (4, 4) pose or None; for display only, never seen by a tracker.
        frame_count: frames that the sequence announces, 0 where it announces none.
        image_path: image_path(frame_id) -> the file that a frame's image was decoded from, unaltered but for the
            decoding, or None.
    """

    name: str
    scene_id: int
    method: str
    objects: tuple[TrackedObject, ...]
    truth: Callable[[int, int], FloatArray | None] | None = field(default=None, compare=False)
    frame_count: int = 0
    image_path: Callable[[int], Path | None] | None = field(default=None, compare=False)


class Observer(Protocol):
    """Listens to a tracking session; called once per frame after all parts were tracked.

    An observer that wants the iterations inside a frame has an attribute `wants_steps` that is true, one that
    wants to see what the image showed `wants_target`; both cost time, so they are off unless somebody asks.
    """

    def on_start(self, session: SessionInfo) -> None:
        """Called before the first frame."""

    def on_frame(self, frame: Frame | UnreadableFrame, results: Mapping[int, TrackResult]) -> None:
        """Called per frame with the results by object id."""

    def on_end(self) -> None:
        """Called once at the end, also when the loop was interrupted."""
