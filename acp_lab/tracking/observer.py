"""What a tracker reports per frame, and who may listen.

Things that look upward in the layers (results files, replays, progress bars) are handed to the
frame loop as observers; the tracker itself knows none of them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Protocol

import numpy as np

from acp_lab.cad.part import Part
from acp_lab.generator.base import GeneratedEdges
from acp_lab.sequences.frame import Frame, UnreadableFrame


class TrackState(StrEnum):
    """How far a pose can be trusted; chosen from the quality with hysteresis."""

    TRACKING = "tracking"
    WEAK = "weak"
    LOST = "lost"


@dataclass(frozen=True)
class Timings:
    """Wall seconds of one frame's stages, from the decoded frame to the pose."""

    undistort_s: float = 0.0
    image_s: float = 0.0
    generate_s: float = 0.0
    search_s: float = 0.0
    solve_s: float = 0.0
    learn_s: float = 0.0
    total_s: float = 0.0


@dataclass(frozen=True)
class TrackResult:
    """The pose of one part in one frame.

    Attributes:
        frame_id: im_id of the frame.
        cam_T_obj: (4, 4) pose, mm.
        control_points: (4, 2) image control points I in px, in the order of W's rows.
        loss: e(I), see `loss.robust_loss`; 0 for a perfect fit, NaN where nothing was seen.
        quality: in [0, 1]; mean score of the best image edge found per generated edge point.
        state: tracking, weak or lost.
        region: index 0..5 of the view region whose W is in use.
        edges: the edge points generated at the final pose, None where nothing was seen.
        residuals_px: (n,) signed distance along the normal from each generated edge point to the
            image edge assigned to it, NaN where none was; None where nothing was seen.
        iterations: Gauss-Newton steps taken.
        timings: wall seconds per stage.
        note: reason of a state change or of an unreadable frame, empty otherwise.
    """

    frame_id: int
    cam_T_obj: np.ndarray
    control_points: np.ndarray
    loss: float
    quality: float
    state: TrackState
    region: int
    edges: GeneratedEdges | None
    residuals_px: np.ndarray | None
    iterations: int
    timings: Timings
    note: str = ""


@dataclass(frozen=True)
class TrackedObject:
    """One object of a tracking session: its id in the data set and its CAD part."""

    object_id: int
    part: Part


@dataclass(frozen=True)
class SessionInfo:
    """What observers learn before the first frame."""

    name: str
    scene_id: int
    method: str
    objects: tuple[TrackedObject, ...]
    truth: Callable[[int, int], np.ndarray | None] | None = field(default=None, compare=False)
    """truth(frame_id, object_id) -> (4, 4) pose or None; for display only, never seen by a tracker."""


class Observer(Protocol):
    """Listens to a tracking session; called once per frame after all parts were tracked."""

    def on_start(self, session: SessionInfo) -> None:
        """Called before the first frame."""

    def on_frame(self, frame: Frame | UnreadableFrame, results: Mapping[int, TrackResult]) -> None:
        """Called per frame with the results by object id."""

    def on_end(self) -> None:
        """Called once at the end, also when the loop was interrupted."""
