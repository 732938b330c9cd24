"""Pictures of the search along an edge point's normal: grey levels, gradient, and the competing peaks.

Convention: px along the normal, 0 at the generated edge point; grey levels 0 to 255.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

from acp_lab.display.look import GENERATED, IMAGE, POINTS, TRUTH, UNKNOWN
from acp_lab.geometry.arrays import FloatArray
from acp_lab.imaging.edge_search import ImagePatch, SearchConfig, search_along_normals
from acp_lab.studies.edge_finding import FindingStudy

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SEARCH = SearchConfig()


def profile(patch: ImagePatch, point: FloatArray, normal: FloatArray, steps_px: FloatArray) -> FloatArray:
    """(2, n): smoothed grey levels, and the gradient of light along the normal, at steps (n,) from a point (2,)."""
    at = (point - patch.origin + steps_px[:, None] * normal).astype(np.float32)
    read = cv2.remap(patch.channels, at[None, :, 0], at[None, :, 1], cv2.INTER_LINEAR)[0]
    return np.stack([read[:, 2], read[:, :2] @ normal]).astype(np.float64)


def draw_profile(
    axes: Axes,
    patch: ImagePatch,
    point: FloatArray,
    normal: FloatArray,
    reach_px: int,
    way_px: float | None = None,
    config: SearchConfig = _SEARCH,
) -> None:
    """Grey level and gradient along the normal of one point, with the search's candidates.

    way_px: where the true edge lies, if that is known.
    """
    steps = np.arange(-reach_px, reach_px + 0.01, 0.25)
    grey, gradient = profile(patch, point, normal, steps)
    axes.plot(steps, grey, color=UNKNOWN, label="grey level")
    axes.plot(steps, 10.0 * np.abs(gradient), color=IMAGE, label="10 x gradient of light")
    candidates = search_along_normals(patch, point[None], normal[None], reach_px, config)
    found = candidates.scores[0] > 0.0
    offsets, scores = candidates.offsets[0][found], candidates.scores[0][found]
    # Candidates are the peaks of light's slope, placed between the samples that are drawn.
    heights = np.interp(offsets, steps, 10.0 * np.abs(gradient))
    for number, order in enumerate(np.argsort(-scores)):
        axes.plot(offsets[order], heights[order], "o", color=POINTS, markersize=5.0, label=_once("candidates", number))
        text = f"{scores[order]:.2f}"
        axes.annotate(text, (offsets[order], heights[order]), (0, 6), textcoords="offset points", ha="center")
    axes.axvline(0.0, color=GENERATED, linestyle="--", label="generated edge point")
    if way_px is not None:
        axes.axvline(way_px, color=TRUTH, linewidth=2.0, label="its true place")
    axes.set_xlabel("along the normal [px]")
    axes.set_ylabel("grey level; 10 x light per px")
    axes.set_ylim(0.0, 1.15 * max(float(grey.max()), 10.0 * float(np.abs(gradient).max())))


def draw_finding(axes: Axes, studies: dict[str, FindingStudy]) -> None:
    """The shares of right displacements per rule, a group of bars per study; keys of the studies go to the legend."""
    shades = (POINTS, GENERATED, TRUTH, IMAGE)
    height = 0.8 / len(studies)
    for order, ((name, study), colour) in enumerate(zip(studies.items(), shades, strict=False)):
        places = np.arange(len(study.rules)) + (order - 0.5 * (len(studies) - 1)) * height
        axes.barh(places, study.shares, height, color=colour, label=name)
        for place, share in zip(places, study.shares, strict=True):
            axes.text(share + 0.01, place, f"{share:.2f}", va="center", fontsize=8)
    axes.set_yticks(range(len(study.rules)), study.rules)
    axes.invert_yaxis()
    axes.set_xlim(0.0, 1.0)
    axes.set_xlabel("share of edge points led to their own image edge")
    axes.legend()


def _once(label: str, number: int) -> str | None:
    return label if number == 0 else None
