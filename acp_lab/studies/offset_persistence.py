"""How long an image edge stays where it lay beside the CAD's: as the view turns, and along the part.

Image edges lie beside those of the CAD model, at the true pose too (see `pose_bound`). A tracker that remembers where
each of them lies takes that offset for a property of the part. How far that holds, the offsets at true poses tell: the
correlation of one sample's offset in two frames, by the turn of the view between them, and that of two samples in one
frame, by the distance between them. What all outlines of a frame share, and all its inner edges, is taken away before;
wrong image edges count no more than three standard deviations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from acp_lab.errors import ParameterError
from acp_lab.geometry.arrays import BoolArray, FloatArray
from acp_lab.studies.pose_bound import EdgeEvidence, robust_deviation

_FARTHEST = 3.0
_MOST_SAMPLES = 400
_ONE_SAMPLE_MM = 1e-6


@dataclass(frozen=True, eq=False)
class SeenOffsets:
    """The samples that one frame shows, and where their edges lie.

    Attributes:
        points_obj: (n, 3) mm.
        offsets: (n,) beside what their class shares in this frame, in its robust standard deviations, at most three;
            no unit.
        outline: (n,) bool.
        view_obj: (3,) unit direction from the part to the eye.
    """

    points_obj: FloatArray
    offsets: FloatArray
    outline: BoolArray
    view_obj: FloatArray


def seen_offsets(evidence: EdgeEvidence, view_obj: FloatArray) -> SeenOffsets:
    """What a frame shows, seen from a direction (3,) of any length; samples along the line of sight say nothing."""
    own = np.full(len(evidence.outline), np.nan)
    known = evidence.px_per_mm != 0.0
    own[known] = evidence.residuals_px[known] / evidence.px_per_mm[known]
    for rows, shared_mm in zip((evidence.outline, ~evidence.outline), evidence.shared_mm, strict=True):
        own[rows] -= shared_mm
        deviation = robust_deviation(own[rows & np.isfinite(own)].tolist())
        own[rows] = np.clip(own[rows] / deviation, -_FARTHEST, _FARTHEST) if deviation > 0.0 else np.nan
    told = np.isfinite(own)
    return SeenOffsets(
        evidence.points_obj[told], own[told], evidence.outline[told], view_obj / np.linalg.norm(view_obj)
    )


def persistence_by_turn(frames: Sequence[SeenOffsets], turns_deg: Sequence[float]) -> FloatArray:
    """(k,) correlation of a sample's offset in two frames whose views are between turns_deg (k + 1,) apart.

    NaN for turns that no two frames have. Only samples that are of the same class in both count.

    Raises:
        ParameterError: the turns are fewer than two, or do not rise.
    """
    edges, found = _rising(turns_deg), _Products(len(turns_deg) - 1)
    rows = [
        {
            (*place, outline): offset
            for place, outline, offset in zip(
                np.rint(frame.points_obj / _ONE_SAMPLE_MM).astype(np.int64).tolist(),
                frame.outline.tolist(),
                frame.offsets.tolist(),
                strict=True,
            )
        }
        for frame in frames
    ]
    for a, b in combinations(range(len(frames)), 2):
        turn_deg = np.degrees(np.arccos(np.clip(frames[a].view_obj @ frames[b].view_obj, -1.0, 1.0)))
        both = rows[a].keys() & rows[b].keys()
        offsets = np.array([[rows[a][key], rows[b][key]] for key in both]).reshape(-1, 2)
        found.add(np.full(len(offsets), turn_deg), offsets[:, 0], offsets[:, 1], edges)
    return found.correlations


def persistence_by_distance(frames: Sequence[SeenOffsets], distances_mm: Sequence[float]) -> FloatArray:
    """(k,) correlation of the offsets of two samples of a frame that are between distances_mm (k + 1,) apart.

    NaN for distances that no two samples have. Only samples of one class are compared, of each frame at most 400.

    Raises:
        ParameterError: the distances are fewer than two, or do not rise.
    """
    edges, found = _rising(distances_mm), _Products(len(distances_mm) - 1)
    rng = np.random.default_rng(0)
    for frame in frames:
        count = len(frame.offsets)
        kept = np.sort(rng.choice(count, min(count, _MOST_SAMPLES), replace=False))
        first, second = np.triu_indices(len(kept), 1)
        alike = frame.outline[kept][first] == frame.outline[kept][second]
        first, second = kept[first[alike]], kept[second[alike]]
        apart_mm = np.linalg.norm(frame.points_obj[first] - frame.points_obj[second], axis=1)
        found.add(apart_mm, frame.offsets[first], frame.offsets[second], edges)
    return found.correlations


class _Products:
    """Sums of products and of squares of pairs of numbers, by bin."""

    def __init__(self, bins: int) -> None:
        self._sums = np.zeros((3, bins))

    def add(self, values: FloatArray, one: FloatArray, other: FloatArray, edges: FloatArray) -> None:
        places = np.searchsorted(edges, values, side="right") - 1
        within = (places >= 0) & (places < len(edges) - 1)
        for row, products in zip(self._sums, (one * other, one * one, other * other), strict=True):
            row += np.bincount(places[within], products[within], len(row))

    @property
    def correlations(self) -> FloatArray:
        products, ones, others = self._sums
        with np.errstate(invalid="ignore"):
            found: FloatArray = products / np.sqrt(ones * others)
        return found


def _rising(edges: Sequence[float]) -> FloatArray:
    found = np.asarray(edges, np.float64)
    if len(found) < 2 or not (np.diff(found) > 0.0).all():
        raise ParameterError(f"persistence: bins {list(edges)}: give two or more limits, each above the one before")
    return found
