"""Pictures of runs side by side, and of the stages of one frame: what notebook 09 draws.

Convention: runs are drawn over image ids, so that runs over different frames of one sequence are aligned; px along
normals, 0 at the generated edge point.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from acp_lab.display.accuracy import AddPercent
from acp_lab.display.look import GENERATED, IMAGE, POINTS, START, TRUTH, UNKNOWN, WRONG, as_it_is
from acp_lab.display.pictures import draw_strokes
from acp_lab.errors import SequenceError
from acp_lab.geometry.arrays import FloatArray, IntArray
from acp_lab.tracking.method import METHODS
from acp_lab.tracking.result import TrackState
from acp_lab.tracking.session import TrackRun
from acp_lab.tracking.states import StateConfig
from acp_lab.tracking.targets.normals import NormalMeasure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SHADES = (POINTS, GENERATED, TRUTH, IMAGE, START, UNKNOWN)
_LARGEST_DOT = 24.0
"""Square points, of a score of 1."""


def add_percents(run: TrackRun, object_id: int = 1) -> FloatArray:
    """(n,) ADD(-S) of a run's frames in percent of the diameter, NaN where truth is not known.

    Raises SequenceError for an object that was not tracked, and for a run that does not know its part.
    """
    if object_id not in run.parts or object_id not in run.results:
        raise SequenceError(f"{run.name}: object {object_id} was not tracked: there are {sorted(run.parts)}")
    error = AddPercent(run.parts[object_id])
    truth = run.session.truth if run.session is not None else None
    return np.array(
        [error(r.cam_T_obj, truth(r.frame_id, object_id) if truth else None) for r in run.results[object_id]]
    )


def draw_runs(
    error_axes: Axes,
    quality_axes: Axes,
    runs: Mapping[str, TrackRun],
    largest_percent: float = 20.0,
    object_id: int = 1,
) -> None:
    """ADD(-S) and quality of up to six runs; crosses where a run is lost, rings where it is weak.

    largest_percent: errors above it are drawn there. The limits of the states are those of the first run's method.
    """
    for colour, (name, run) in zip(_SHADES, runs.items(), strict=False):
        results = run.results[object_id]
        ids = np.array([result.frame_id for result in results], int)
        quality = np.array([result.quality for result in results])
        error = np.minimum(add_percents(run, object_id), largest_percent)
        gaps = _gaps(ids)
        for axes, values in ((error_axes, error), (quality_axes, quality)):
            x, y = np.insert(ids, gaps, 0), np.insert(values, gaps, np.nan)
            axes.plot(x, y, color=colour, linewidth=1.5, label=as_it_is(name))
            for state, marker in ((TrackState.LOST, "x"), (TrackState.WEAK, "o")):
                rows = np.array([result.state is state for result in results], bool)
                axes.plot(ids[rows], values[rows], marker, color=WRONG, markersize=4.5, markerfacecolor="none")
    for limit in (2.0, 5.0):
        error_axes.axhline(limit, color=UNKNOWN, linestyle="--", linewidth=0.8)
    error_axes.set_ylim(0.0, 1.04 * largest_percent)
    error_axes.set_ylabel(f"ADD(-S) [% of diameter], at most {largest_percent:.0f}")
    first = next(iter(runs.values()), None)
    states = StateConfig() if first is None or first.method not in METHODS else METHODS[first.method].states
    for limit, word in ((states.weak_below, "weak"), (states.lost_below, "lost")):
        quality_axes.axhline(limit, color=WRONG, linestyle=":", linewidth=1.0)
        quality_axes.annotate(word, (0.0, limit), (2, 2), textcoords="offset points", fontsize=8, color=WRONG)
    quality_axes.set_ylim(0.0, 1.05)
    quality_axes.set_ylabel("quality [0 to 1]")
    for axes in (error_axes, quality_axes):
        axes.set_xlabel("image id")
        axes.grid(alpha=0.3)
    quality_axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)


def _gaps(ids: IntArray) -> IntArray:
    """Places in front of which images are missing: steps of more than twice the usual one."""
    steps = np.diff(ids)
    gaps: IntArray = np.flatnonzero(steps > 2.0 * np.median(steps)) + 1 if len(steps) else np.zeros(0, int)
    return gaps


def draw_found(axes: Axes, observation: NormalMeasure, scores: FloatArray) -> None:
    """The generated edge points, and the image edge that scores best for each; dots as large as their scores.

    scores: (n, m) of the observation's candidates, with or without the memory's weight.
    """
    tangents = np.stack([observation.normals[:, 1], -observation.normals[:, 0]], 1)
    draw_strokes(axes, observation.points, tangents, GENERATED, "generated")
    best = scores.argmax(1)[:, None]
    height = np.take_along_axis(scores, best, 1)[:, 0]
    offset = np.take_along_axis(observation.candidates.offsets, best, 1)
    found = observation.points + offset * observation.normals
    draw_strokes(axes, 0.5 * (observation.points + found), observation.normals, UNKNOWN, width=0.4, length_px=2.0)
    x, y = found.T
    axes.scatter(x, y, s=_LARGEST_DOT * height, color=IMAGE, linewidths=0.0, label="image edge, by score")


def draw_memory(axes: Axes, observation: NormalMeasure, row: int, way_px: float) -> None:
    """The candidates of one edge point along its normal: scores of the image alone, and with the memory.

    way_px: place of the true edge along the normal.
    """
    offsets, alone = observation.candidates.offsets[row], observation.candidates.scores[row]
    shown = alone > 0.0
    axes.vlines(offsets[shown], 0.0, alone[shown], color=UNKNOWN, linewidth=1.0)
    axes.plot(offsets[shown], alone[shown], "o", mfc="white", mec=UNKNOWN, label="contrast and direction")
    remembered = observation.scores[row]
    axes.plot(offsets[shown], remembered[shown], "o", color=IMAGE, label="remembered and shared")
    axes.axvline(0.0, color=GENERATED, linestyle="--", label="generated edge point")
    axes.axvline(way_px, color=TRUTH, linewidth=2.0, label="its true place")
    axes.set_ylim(0.0, 1.05)
    axes.set_xlabel("along the normal [px]")
    axes.set_ylabel("score [0 to 1]")
