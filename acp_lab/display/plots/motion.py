"""Figures of one moment each, for moving pictures: PnP's two poses, and the steps of an optimiser in one frame."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from acp_lab.display.look import GENERATED, POINTS, START, TRUTH, UNKNOWN, WRONG
from acp_lab.display.pictures import cut_to, draw_edges, draw_quad, show_image
from acp_lab.geometry.arrays import ByteImage, FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.studies.true_edges import TrueEdges
from acp_lab.studies.two_poses import TwoPoses

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw_two_poses(figure: Figure, moments: Sequence[TwoPoses], number: int, truth: TrueEdges, camera: Camera) -> None:
    """The part as both poses of a moment show it, and the tilts of both up to then over the true one."""
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.5))
    now = moments[number]
    everything = np.vstack([truth.at(one.cam_T_true, camera).points for one in (moments[0], moments[-1])])
    for pose, colour, name in ((now.poses[1], START, "fits less"), (now.poses[0], GENERATED, "fits better")):
        draw_edges(left, truth.at(pose, camera), colour, name, width=1.1)
    draw_quad(left, now.points, numbers=False)
    cut_to(left, everything, 12.0)
    left.set_aspect("equal")
    left.set_xticks([])
    left.set_yticks([])
    left.spines[:].set_visible(False)
    left.set_title("PnP took the wrong one" if now.is_flipped else "PnP took the right one")
    true_deg = np.array([one.true_deg for one in moments])
    right.plot(true_deg, true_deg, color=TRUTH, linewidth=1.0, label="true")
    seen = moments[: number + 1]
    for row, colour, name in ((1, START, "fits less"), (0, GENERATED, "fits better")):
        tilts = [one.tilts_deg[row] for one in seen]
        right.plot(true_deg[: number + 1], tilts, "o", color=colour, markersize=4.0, label=name)
    right.set_xlim(true_deg[0] - 2.0, true_deg[-1] + 2.0)
    reach = max(np.abs(one.tilts_deg).max() for one in moments) + 3.0
    right.set_ylim(-reach, reach)
    right.set_xlabel("true tilt [deg]")
    right.set_ylabel("tilt of the two poses [deg]")
    right.legend(loc="center left")


def draw_step(
    figure: Figure,
    image: ByteImage,
    truth: TrueEdges,
    camera: Camera,
    poses: Sequence[FloatArray],
    errors_percent: Sequence[float],
    levels: Sequence[int],
    number: int,
) -> None:
    """The edges after step `number` (0: the start) on the image, and the error of all steps up to then.

    poses: (4, 4) each, the last one taken for the end. errors_percent: ADD of each, percent of the diameter. levels: of
    each step, from coarse to fine, one less than the poses.
    """
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.3))
    ends = np.vstack([truth.at(pose, camera).points for pose in (poses[0], poses[-1])])
    show_image(left, image, around=ends, margin_px=12.0)
    draw_edges(left, truth.at(poses[number], camera), GENERATED, width=1.3)
    left.set_title("start" if number == 0 else f"step {number}, level {levels[number - 1] + 1}")
    for step in range(1, len(levels)):
        if levels[step] != levels[step - 1]:
            right.axvline(step + 0.5, color=UNKNOWN, linestyle=":", linewidth=1.0)
    right.plot(range(number + 1), errors_percent[: number + 1], "-o", color=POINTS, markersize=4.0)
    right.plot(number, errors_percent[number], "o", color=WRONG if errors_percent[number] > 2.0 else TRUTH)
    right.set_xlim(-0.5, len(poses) - 0.5)
    right.set_yscale("log")
    right.set_ylim(0.5 * min(errors_percent), 1.6 * max(errors_percent))
    right.set_yticks([1.0, 2.0, 5.0, 10.0], ["1", "2", "5", "10"])
    right.minorticks_off()
    right.axhline(2.0, color=UNKNOWN, linewidth=0.8)
    right.set_xlabel("step (dotted: the next level)")
    right.set_ylabel("ADD [% of the diameter]")
