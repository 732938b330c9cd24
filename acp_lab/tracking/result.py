"""What a tracker reports of one part in one frame."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from acp_lab.generator.base import GeneratedEdges
from acp_lab.geometry.arrays import Float32Array, FloatArray
from acp_lab.tracking.sought import Sought

NOT_PREPARED = "is not prepared"
"""In the note of the frame in which a part turned to a view region that its generator was not prepared for."""
EXACT = 0.95
"""An exactness below it is worth a word to the user."""


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

    control_points: FloatArray
    cam_T_obj: FloatArray
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

    edge_points: FloatArray
    origin: tuple[int, int]
    size: tuple[int, int]
    distance_map: Float32Array | None = None


@dataclass(frozen=True, eq=False, repr=False)
class TrackResult:
    """The pose of one part in one frame.

    Attributes:
        frame_id: im_id of the frame.
        cam_T_obj: (4, 4) pose, mm.
        predicted: (4, 4) pose, mm, from which edges were searched: that of the motion, corrected by where the part's
            last picture was found (`PictureSearch`); in the first frame the given one.
        control_points: (4, 2) image control points I in px, in the order of W's rows.
        loss: e(I) as the method's targets define it; 0 for a perfect fit, NaN where nothing was seen.
        quality: in [0, 1]; how likely the part is there, see `confidence`; for methods without it, how well the image
            agrees with the generated edges.
        state: tracking, weak or lost.
        region: index 0..5 of the view region whose W is in use.
        edges: the edge points generated last, at the final pose; None where nothing was seen.
        residuals_px: (n,) signed distance along the normal from each generated edge point to the
            image edge assigned to it, NaN where none was; None where nothing was seen.
        iterations: of the solver, on all levels of the solution that was accepted.
        timings: wall seconds per stage.
        note: reason of a state change, of a pose that was replaced, of a frame that is unreadable or shows no part, or
            that the generator was not prepared for the view; else empty.
        steps: the iterations that led to the pose, in their order; empty unless the tracker's `records_steps`
            is set.
        covariance: (6, 6) of a pose step (rad, mm) about the part's centre, in camera axes, given that the part is
            there (how likely that is says `quality`), see `uncertainty`; None where the pose was given, held or
            predicted, and for methods without it.
        exactness: in [0, 1]; how likely the pose of a part that is there has an ADD below 5% of the diameter, by the
            covariance; 1 where there is none.
        target: what was found in the image; None unless the tracker's `records_target` is set.
        sought: of a lost part, where it was looked for and what was found; else None.
    """

    frame_id: int
    cam_T_obj: FloatArray
    predicted: FloatArray
    control_points: FloatArray
    loss: float
    quality: float
    state: TrackState
    region: int
    edges: GeneratedEdges | None
    residuals_px: FloatArray | None
    iterations: int
    timings: Timings
    note: str = ""
    steps: tuple[TrackStep, ...] = ()
    covariance: FloatArray | None = None
    target: TargetView | None = None
    sought: Sought | None = None
    exactness: float = 1.0

    def __repr__(self) -> str:
        x, y, z = self.cam_T_obj[:3, 3]
        note = f", {self.note!r}" if self.note else ""
        return (
            f"TrackResult(frame {self.frame_id}, {self.state}, {self.quality_in_words}, "
            f"t = [{x:.1f}, {y:.1f}, {z:.1f}] mm{note})"
        )

    @property
    def right(self) -> float:
        """In [0, 1]; how likely the pose is right: the part is there, and its ADD below 5% of the diameter."""
        return self.quality * self.exactness

    @property
    def quality_in_words(self) -> str:
        """For a status line: the quality, and the exactness where it is low."""
        return f"quality {self.quality:.2f}" + (f", exactness {self.exactness:.2f}" if self.exactness < EXACT else "")
