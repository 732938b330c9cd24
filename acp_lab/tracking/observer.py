"""What a tracker reports per frame, and who may listen.

Things that look upward in the layers (results files, replays, progress bars) are handed to the
frame loop as observers; the tracker itself knows none of them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
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


@dataclass(frozen=True, eq=False)
class TrackStep:
    """One iteration inside a frame.

    Attributes:
        control_points: (4, 2) px, I after the step.
        cam_T_obj: (4, 4) mm, the pose after the step.
        loss: e(I) after the step, the same function as `TrackResult.loss`, on the candidates of the step's level.
        level: coarse-to-fine level that it belongs to, from 0.
    """

    control_points: np.ndarray
    cam_T_obj: np.ndarray
    loss: float
    level: int


@dataclass(frozen=True, eq=False)
class TargetView:
    """Where a method looked in the image, and what it found there to hold the generated edges against.

    Attributes:
        edge_points: (m, 2) px of the full image: the image edges.
        origin: (x, y) px of the crop's first pixel in the full image.
        size: (w, h) px of the crop.
        distance_map: (h, w) float32 px to the nearest image edge, of the crop; None where the method has none.
    """

    edge_points: np.ndarray
    origin: tuple[int, int]
    size: tuple[int, int]
    distance_map: np.ndarray | None = None


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
        edges: the edge points generated last, at the final pose; None where nothing was seen.
        residuals_px: (n,) signed distance along the normal from each generated edge point to the
            image edge assigned to it, NaN where none was; None where nothing was seen.
        iterations: Gauss-Newton steps taken.
        timings: wall seconds per stage.
        note: reason of a state change or of an unreadable frame, empty otherwise.
        steps: the iterations that led to the pose, in their order; empty unless the tracker's `records_steps`
            is set.
        target: what was found in the image; None unless the tracker's `records_target` is set.
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
    steps: tuple[TrackStep, ...] = ()
    target: TargetView | None = None


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
    control_points_obj: tuple[np.ndarray, ...] = field(default=(), compare=False)


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
    truth: Callable[[int, int], np.ndarray | None] | None = field(default=None, compare=False)
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
