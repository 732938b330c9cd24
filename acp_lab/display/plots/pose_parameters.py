"""The six pose parameters over a sequence: the truth, and what one run or several made of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from acp_lab.display.look import GENERATED, IMAGE, POINTS, TRUTH, as_it_is
from acp_lab.studies.pose_parameters import NAMES, PoseParameters

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_COLOURS = (GENERATED, POINTS, IMAGE)


def draw_pose_parameters(axes: Sequence[Axes], runs: Mapping[str, PoseParameters]) -> None:
    """A panel per parameter on six axes: the truth as a wide line, up to three runs by name as thin ones."""
    for number, (panel, name) in enumerate(zip(axes, NAMES, strict=True)):
        first = next(iter(runs.values()))
        panel.plot(first.frame_ids, first.true[:, number], color=TRUTH, linewidth=4.0, alpha=0.4, label="truth")
        for colour, (run, found) in zip(_COLOURS, runs.items(), strict=False):
            panel.plot(found.frame_ids, found.estimated[:, number], color=colour, linewidth=1.2, label=as_it_is(run))
        panel.set_title(name, fontsize=9)
        panel.grid(alpha=0.3)
    for panel in axes[3:]:
        panel.set_xlabel("image id")
    axes[0].legend(fontsize=8)


def draw_pose_errors(axes: Sequence[Axes], runs: Mapping[str, PoseParameters]) -> None:
    """The same six panels, estimated minus true."""
    for number, (panel, name) in enumerate(zip(axes, NAMES, strict=True)):
        panel.axhline(0.0, color=TRUTH, linewidth=1.0)
        for colour, (run, found) in zip(_COLOURS, runs.items(), strict=False):
            panel.plot(found.frame_ids, found.off[:, number], color=colour, linewidth=1.2, label=as_it_is(run))
        panel.set_title(f"off: {name}", fontsize=9)
        panel.grid(alpha=0.3)
    for panel in axes[3:]:
        panel.set_xlabel("image id")
    axes[0].legend(fontsize=8)
