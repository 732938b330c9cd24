"""Offline regression of the control points W of a view region (paper IV-C).

When the part moves a little, its four image control points move, and the homography between their old and new
places moves the old edges too. The plane through W is good when the edges then lie where the moved part shows its
edges: in that case pushing the control points about is an image transformation, as the paper wants it.

The chain, differentiable from end to end (float64, torch): parameters -> W (`plane_points`) -> e_3d, eq. 10
(`edge_loss`) -> Adam, over all motion pairs (`motion_pairs`) at every step.

**What e_3d can see.** A rigid motion moves the image of a plane by one homography, and any four of the plane's points
give that same homography. So e_3d depends on the plane of W alone, 3 of the paper's 11 degrees of freedom; along the
other 8 its gradient is zero. The default form `plane` has these 3 alone; `printed` has all 11 and ends in the same
plane. (Deviation from the paper, which does not say it.)
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch

from acp_lab.cad.edges import EdgeSamples
from acp_lab.cad.part import Part
from acp_lab.cad.raycast import RayCaster
from acp_lab.control_points.edge_loss import EdgeLoss
from acp_lab.control_points.motion_pairs import PairConfig, make_motion_pairs
from acp_lab.control_points.plane_points import Form, PlanePoints
from acp_lab.control_points.view_regions import ViewRegion

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class RegressionConfig(PairConfig):
    """Settings of the regression: those of the motion pairs, and Adam's.

    Attributes:
        form: "plane", 3 degrees of freedom, or "printed", the paper's 11; see `plane_points`.
        steps: of Adam, each over all pairs.
        rate: Adam's step, in units of half the box; it falls to zero along a cosine.
    """

    form: Form = "plane"
    steps: int = 80
    rate: float = 0.05

    @classmethod
    def fast(cls) -> RegressionConfig:
        """A third of the views and half the steps, for lessons and tests."""
        return cls(views=32, steps=40)


@dataclass(frozen=True)
class RegressionReport:
    """What the regression did to one region.

    Attributes:
        region: 0..5.
        form: parametrisation.
        residual_before, residual_after: mean e_3d as printed in eq. 10, of the mid-section and of the result.
        before_px, after_px: mean distance of the moved edge points to the true edges, px of the virtual view, on
            the pairs that Adam saw; held_out_before_px, held_out_after_px: on a third as many others.
        exact_px: the same for the points moved as the part really moves, on the first pairs: the grain of the
            pixels and edges that appear or vanish, which no plane can remove.
        offset, tilt_u, tilt_v: the plane found, in units of half the box; see `plane_points`.
        train_s: wall seconds, making the pairs included.
    """

    region: int
    form: Form
    residual_before: float
    residual_after: float
    before_px: float
    after_px: float
    held_out_before_px: float
    held_out_after_px: float
    exact_px: float
    offset: float
    tilt_u: float
    tilt_v: float
    train_s: float


def regress_points(
    part: Part,
    edges: EdgeSamples,
    caster: RayCaster,
    region: ViewRegion,
    config: RegressionConfig = RegressionConfig(),
    seed: int = 0,
    progress: Progress | None = None,
) -> tuple[np.ndarray, RegressionReport]:
    """The control points W of a region, moved from the mid-section to where e_3d is smallest.

    Args:
        edges, caster: of this part.
        progress: called with (steps done, steps in all); making the pairs counts as the first half.

    Returns:
        (4, 3) mm, object frame, in the order of `mid_section_points`; and the report. The same seed and thread
        count give the same numbers.

    Raises:
        GeometryError: the settings leave no room for the part and its motion.
    """
    # The arrays are small: two threads spend their time waiting for each other.
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        return _regress(part, edges, caster, region, config, seed, progress)
    finally:
        torch.set_num_threads(threads)


def _regress(
    part: Part,
    edges: EdgeSamples,
    caster: RayCaster,
    region: ViewRegion,
    config: RegressionConfig,
    seed: int,
    progress: Progress | None,
) -> tuple[np.ndarray, RegressionReport]:
    begin = time.perf_counter()
    total = config.views + config.steps
    tell_pairs = None if progress is None else (lambda done, _: progress(done, total))
    pairs = make_motion_pairs(part, edges, caster, region, config, seed, tell_pairs)
    loss = EdgeLoss(pairs)
    form = PlanePoints.of(part, region, config.form)

    parameters = form.zero().requires_grad_()
    adam = torch.optim.Adam([parameters], lr=config.rate)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(adam, max(config.steps, 1))
    best, least = parameters.detach().clone(), float("inf")
    for step in range(config.steps + 1):  # the last round only judges where the last step led
        adam.zero_grad(set_to_none=True)
        value = loss(form.points_obj(parameters))
        if value.item() < least:
            best, least = parameters.detach().clone(), value.item()
        if step == config.steps:
            break
        value.backward()
        adam.step()
        schedule.step()
        with torch.no_grad():
            parameters.copy_(form.bounded(parameters))
        if progress is not None:
            progress(config.views + step + 1, total)

    with torch.no_grad():
        start, end = form.points_obj(form.zero()), form.points_obj(best)
        held_out = EdgeLoss(make_motion_pairs(part, edges, caster, region, _held_out(config), seed + 1_000_003))
        report = RegressionReport(
            region=region.index,
            form=config.form,
            residual_before=loss(start).item(),
            residual_after=loss(end).item(),
            before_px=loss.distances(start).mean().item(),
            after_px=loss.distances(end).mean().item(),
            held_out_before_px=held_out.distances(start).mean().item(),
            held_out_after_px=held_out.distances(end).mean().item(),
            exact_px=loss.exact_distances().mean().item(),
            offset=best[0].item(),
            tilt_u=best[1].item(),
            tilt_v=best[2].item(),
            train_s=time.perf_counter() - begin,
        )
    return end.numpy(), report


def _held_out(config: RegressionConfig) -> PairConfig:
    return PairConfig(
        views=max(1, config.views // 3),
        turn_deg=config.turn_deg,
        shift_mm=config.shift_mm,
        overlap=config.overlap,
        nearest=config.nearest,
        farthest=config.farthest,
        size=config.size,
        points=config.points,
    )
