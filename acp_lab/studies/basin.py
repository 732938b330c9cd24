"""The basin of convergence: from how far off an alignment still finds the pose.

A start pose is rotated about the box centre by an exact angle and shifted by an exact distance, in random directions
that are the same for every size and every method. The basin at that size is the share of trials that end within 2% of
the diameter of the truth by ADD (ADD-S with symmetries).
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from acp_lab.cad.part import Part
from acp_lab.errors import SequenceError, TrackingError
from acp_lab.evaluation import PartMetric
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import disturb_pose
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.session import PartTracker

_MOST_VERTICES = 2000


class Align(Protocol):
    """A way to find the pose of a part in one frame from a start nearby."""

    def __call__(self, frame: Frame, start_T_obj: FloatArray) -> FloatArray:
        """The pose (4, 4), mm, found from a start pose (4, 4); TrackingError counts as a failure."""
        ...


def align_with(make_tracker: Callable[[], PartTracker], again: int = 0) -> Align:
    """An `Align` that starts a fresh tracker in the frame.

    again: how often the same frame is then tracked again, for trackers that take few steps at the start.
    """

    def align(frame: Frame, start_T_obj: FloatArray) -> FloatArray:
        tracker = make_tracker()
        result = tracker.start(frame, start_T_obj)
        for _ in range(again):
            result = tracker.track(frame)
        return result.cam_T_obj

    return align


@dataclass(frozen=True)
class BasinConfig:
    """Settings.

    Attributes:
        angles_deg, shifts_mm: the grid of disturbances.
        trials: random directions per cell and frame.
        limit: share of the diameter below which ADD(-S) counts as found.
    """

    angles_deg: tuple[float, ...] = (0.0, 1.0, 2.0, 4.0, 8.0, 12.0, 16.0)
    shifts_mm: tuple[float, ...] = (0.0, 2.0, 5.0, 10.0, 20.0)
    trials: int = 10
    limit: float = 0.02


@dataclass(frozen=True, eq=False)
class Basin:
    """How often an alignment found the pose. Prints as a table.

    Attributes:
        name: of the method.
        angles_deg: (a,); shifts_mm: (s,).
        errors: (a, s, n) ADD(-S) as share of the diameter at the end of each of n trials, inf for none.
        limit: share of the diameter that counts as found.
    """

    name: str
    angles_deg: FloatArray
    shifts_mm: FloatArray
    errors: FloatArray
    limit: float

    @property
    def share(self) -> FloatArray:
        """(a, s) share of the trials that were found."""
        return np.asarray((self.errors < self.limit).mean(2))

    @property
    def volume(self) -> float:
        """The mean share over the grid: one number to compare methods on the same grid by."""
        return float(self.share.mean())

    def __str__(self) -> str:
        head = f"{self.name}: % of {self.errors.shape[2]} trials within {100.0 * self.limit:g}% of the diameter"
        columns = "   deg " + "".join(f"{f'{shift:g} mm':>8}" for shift in self.shifts_mm)
        rows = [
            f"{angle:6g} " + "".join(f"{100.0 * value:8.0f}" for value in row)
            for angle, row in zip(self.angles_deg, self.share, strict=True)
        ]
        return "\n".join([head, columns, *rows])


def basin_of_convergence(
    align: Align,
    part: Part,
    frames: Sequence[Frame],
    truths: Sequence[FloatArray],
    config: BasinConfig = BasinConfig(),
    name: str = "align",
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Basin:
    """Run an alignment from disturbed starts.

    Args:
        frames, truths: the images and their true cam_T_obj (4, 4), mm.
        progress: called with (trials done, trials in all).

    Raises:
        SequenceError: no frames, or not one truth for each.
    """
    if not frames or len(frames) != len(truths):
        raise SequenceError(f"basin of {len(frames)} frames and {len(truths)} poses: give one true pose for each frame")
    metric = PartMetric(part, _MOST_VERTICES)
    shape = (len(config.angles_deg), len(config.shifts_mm), len(frames) * config.trials)
    errors = np.full(shape, math.inf)
    for count, (i, j, k) in enumerate(np.ndindex(shape)):
        which, trial = divmod(k, config.trials)
        # The same directions in every cell, so that cells differ by the size alone.
        rng = np.random.default_rng([seed, which, trial])
        angle_deg, shift_mm = config.angles_deg[i], config.shifts_mm[j]
        start = disturb_pose(truths[which], part.box_centre, angle_deg, shift_mm, rng)
        with contextlib.suppress(TrackingError):  # then it stays infinite: a failure
            errors[i, j, k] = metric.share(align(frames[which], start), truths[which])
        if progress is not None:
            progress(count + 1, errors.size)
    return Basin(name, np.array(config.angles_deg), np.array(config.shifts_mm), errors, config.limit)
