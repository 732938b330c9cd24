"""How well a loss finds the pose: from starts nearby, for its alpha, and with part of the image's edges missing.

One part, some frames with known poses. From each start the rigid edges of the true view are moved to minimise e, one
level per alpha, in six degrees of freedom. The remaining error is due to the loss alone.

Reflections hide edges. `erase_edges` imitates that: on one side of the part it removes the edge pixels along the part's
edges and keeps all others, so that a generated edge point finds the nearest wrong edge.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from acp_lab.errors import SequenceError
from acp_lab.evaluation import PartMetric
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose_step import move_pose
from acp_lab.imaging.distance import distance_map
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame
from acp_lab.studies.landscape import LossSurface
from acp_lab.tracking.losses import LossForm
from acp_lab.tracking.solvers import GaussNewton
from acp_lab.tracking.targets.distance_map import DistanceTarget

ERASED_REACH_PX = 2.5
_LOST = 1.0
_MOST_VERTICES = 1000


@dataclass(frozen=True)
class LossChoice:
    """A loss to try. alphas_px: one level each, coarse to fine; a very large one makes it plain least squares."""

    name: str
    form: LossForm
    alphas_px: tuple[float, ...]


@dataclass(frozen=True)
class LossStudyConfig:
    """turn_deg, shift_mm: how far the starts are off; trials: random directions per frame; steps: per level; limit:
    share of the diameter below which ADD(-S) counts as found."""

    turn_deg: float = 2.0
    shift_mm: float = 2.0
    trials: int = 4
    steps: int = 6
    limit: float = 0.02


@dataclass(frozen=True, eq=False)
class LossStudy:
    """Where the minimisations ended. Prints as a table.

    names: (c,) of the choices. erased: (e,) shares of the part's edges that were removed. errors: (c, e, n) ADD(-S)
    of n descents as share of the diameter, 1 for those that diverged. limit: below it the pose counts as found.
    """

    names: tuple[str, ...]
    erased: tuple[float, ...]
    errors: FloatArray
    limit: float

    @property
    def found(self) -> FloatArray:
        """(c, e) share of the descents that found the pose."""
        return np.asarray((self.errors < self.limit).mean(2), dtype=np.float64)

    @property
    def median(self) -> FloatArray:
        """(c, e) median ADD(-S), share of the diameter."""
        return np.asarray(np.median(self.errors, axis=2), dtype=np.float64)

    def __str__(self) -> str:
        width = max(len(name) for name in self.names)
        head = " " * width + "".join(f"{f'{100 * share:.0f}% removed':>15}" for share in self.erased)
        rows = [
            f"{name:>{width}}" + "".join(f"{100 * error:13.2f} %" for error in errors)
            for name, errors in zip(self.names, self.median, strict=True)
        ]
        return "\n".join([head, *rows, f"median ADD(-S) in % of the diameter, {self.errors.shape[2]} descents each"])


def loss_study(
    model: PreparedPart,
    frames: Sequence[Frame],
    truths: Sequence[FloatArray],
    choices: Sequence[LossChoice],
    erased: Sequence[float] = (0.0,),
    config: LossStudyConfig = LossStudyConfig(),
    seed: int = 0,
) -> LossStudy:
    """Minimise every choice of loss from the same starts.

    Args:
        truths: cam_T_obj (4, 4) mm of each frame.
        erased: shares in [0, 1) of the part's edges that are removed from the image, on one side of it.

    Raises:
        SequenceError: no frames, or not one truth for each.
    """
    if not frames or len(frames) != len(truths):
        raise SequenceError(f"loss study of {len(frames)} frames and {len(truths)} poses: give one pose for each frame")
    metric = PartMetric(model.part, _MOST_VERTICES)
    errors = np.empty((len(choices), len(erased), len(frames) * config.trials))
    solver = GaussNewton(steps=config.steps)
    for which, (frame, truth) in enumerate(zip(frames, truths, strict=True)):
        whole = LossSurface(model, frame, truth)
        for trial in range(config.trials):
            rng = np.random.default_rng([seed, which, trial])
            start, side_rad = _start(rng, config), float(rng.uniform(0.0, 2.0 * np.pi))
            for j, share in enumerate(erased):
                surface = copy.copy(whole)
                surface.target = erase_edges(whole.target, whole.edges.points, share, side_rad)
                for i, choice in enumerate(choices):
                    way = surface.descend("pose", start, choice.form, choice.alphas_px, solver)
                    end = move_pose(truth, model.part.box_centre, way.offsets[-1])
                    errors[i, j, which * config.trials + trial] = min(metric.share(end, truth), _LOST)
    return LossStudy(tuple(choice.name for choice in choices), tuple(erased), errors, config.limit)


def erase_edges(target: DistanceTarget, points: FloatArray, share: float, side_rad: float) -> DistanceTarget:
    """A frame's target without its edge pixels along some of the part's edge points.

    target: with a single map. points: (n, 2) px, the part's true edge points. share: of them, the ones that lie
    furthest towards the side `side_rad` (0 is right, a quarter turn is down).
    """
    if share <= 0.0:
        return target
    along = points @ (np.cos(side_rad), np.sin(side_rad))
    gone = points[along > np.quantile(along, 1.0 - share)]
    marked = np.zeros_like(target.edges)
    height, width = marked.shape
    column, row = np.round(gone - target.origin).astype(int).T
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    marked[row[inside], column[inside]] = True
    edges = target.edges & (distance_map(marked) > ERASED_REACH_PX) if marked.any() else target.edges
    return DistanceTarget(edges, edges[None], target.origin)


def _start(rng: np.random.Generator, config: LossStudyConfig) -> FloatArray:
    """(6,) rad and mm: exactly so far off, in random directions."""
    axis, way = (v / np.linalg.norm(v) for v in rng.standard_normal((2, 3)))
    return np.concatenate([np.radians(config.turn_deg) * axis, config.shift_mm * way])
