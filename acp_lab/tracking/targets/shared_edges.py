"""Image edges shared out among the model edges that they may belong to.

Where two edges of the model run side by side a few px apart, a rim and the face behind it, both find the same image
edge, and the one whose own edge shows no contrast pulls the pose away from the other. So an image edge counts for a
sample only by the share that is its own: with s the candidate's score after the memory had its say, d its distance from
where the sample is expected, v the variance of that, and c the weight of the sample::

    m = c s exp(-d^2 / (2 v)),      share = m / (m + the most that a known neighbour on another edge makes of it)

A sample that was never found before counts little and claims nothing: what is new in sight may have hardly any
contrast, and what is known explains most of what is seen. At fine levels what is known keeps its edges: it lies where
it should, and its memory tells it from its neighbours. In a first frame nothing is known, and nothing is shared.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from acp_lab.compiled import kernel
from acp_lab.errors import TrackingError
from acp_lab.geometry.arrays import BoolArray, FloatArray, IntArray
from acp_lab.tracking.schedule import Level

# Model edges whose normals differ by more than the angle of this cosine do not claim the same image edge.
_LEAST_COSINE = 0.9


@dataclass(frozen=True)
class EdgeSharing:
    """Configuration: an image edge counts for a sample by the share that is its own.

    Attributes:
        newcomer: weight of a sample that was never found before; the others have 1.
        apart_px: samples nearer to each other across the edge than this are of one edge.
        along_px: how far along the edge a neighbour may be.
        same_px: candidates of two samples nearer to each other than this are one image edge.
        spread_px: standard deviation of an edge's place where the pose is known; the variance that the expected pose
            gives it is added. unknown_px: the standard deviation instead, where nobody knows how sure that pose is.
        known_from_sigma_px: at finer levels than this the known keep their edges, and only newcomers share.
    """

    kind: ClassVar[str] = "on"
    newcomer: float = 0.15
    apart_px: float = 1.0
    along_px: float = 8.0
    same_px: float = 2.0
    spread_px: float = 0.7
    unknown_px: float = 1.0
    known_from_sigma_px: float = 1.5

    def __post_init__(self) -> None:
        if not self.newcomer > 0.0:
            raise TrackingError(f"sharing.newcomer = {self.newcomer:g}: give more than 0; 1 like any other")
        for name in ("apart_px", "along_px", "same_px", "spread_px", "unknown_px", "known_from_sigma_px"):
            if not 0.0 < (value := getattr(self, name)) <= 100.0:
                raise TrackingError(f"sharing.{name} = {value:g}: give more than 0, at most 100")

    def share_out(
        self, scores: FloatArray, offsets: FloatArray, points: FloatArray, normals: FloatArray, known: BoolArray,
        level: Level, jacobian: FloatArray, information: FloatArray | None,
    ) -> FloatArray:  # fmt: skip
        """(n, m) scores, less for candidates that rather belong to a neighbour.

        Args:
            scores: (n, m) in [0, 1], 0 where there is no candidate.
            offsets: (n, m) px of the candidates along the normals.
            points: (n, 2) px of the edge points; normals: (n, 2) unit.
            known: (n,) whether a sample was found before.
            level: at which the candidates were searched.
            jacobian: (n, 6) px along the normals by a pose step (rad, mm) about the part's centre.
            information: (6, 6) of the expected pose, by the same step, see `View`; None where nobody knows.
        """
        known_share = level.sigma_px >= self.known_from_sigma_px
        if not known_share and known.all():
            return scores
        if information is None:
            variances = np.full(len(points), self.spread_px**2 + self.unknown_px**2)
        else:
            variances = self.spread_px**2 + np.einsum("ni,ni->n", jacobian @ np.linalg.inv(information), jacobian)
        shared = np.empty_like(scores)
        _share_out(
            np.ascontiguousarray(points), np.ascontiguousarray(normals), known, self.newcomer,
            known_share, variances, np.ascontiguousarray(offsets), scores, self.apart_px, self.along_px, self.same_px,
            2.0 * level.reach_px, np.argsort(points[:, 0]), shared,
        )  # fmt: skip
        return shared


@kernel(
    "void(f8[:, ::1], f8[:, ::1], b1[::1], f8, b1, f8[::1], f8[:, ::1], f8[:, ::1], f8, f8, f8, f8, i8[::1],"
    " f8[:, ::1])",
)
def _share_out(
    points: FloatArray, normals: FloatArray, known: BoolArray, newcomer: float, known_share: bool,
    variances: FloatArray, offsets: FloatArray, scores: FloatArray, apart_px: float, along_px: float, same_px: float,
    span_px: float, by_x: IntArray, shared: FloatArray,
) -> None:  # fmt: skip
    """Fill shared (n, m), see `EdgeSharing.share_out`.

    known_share: whether the known share among themselves; variances: (n,) px^2; by_x: (n,) the points' order from left
    to right; span_px: neighbours are no farther than this in x and y.
    """
    count, width = scores.shape
    masses, claims = np.zeros(scores.shape), np.zeros(scores.shape)
    for i in range(count):
        weight, narrow = 1.0 if known[i] else newcomer, -0.5 / variances[i]
        for k in range(width):
            if scores[i, k] != 0.0:
                masses[i, k] = weight * scores[i, k] * np.exp(narrow * offsets[i, k] * offsets[i, k])
    for a in range(count):
        i = by_x[a]
        if known[i] and not known_share:
            continue
        for way in (-1, 1):
            b = a + way
            while 0 <= b < count:
                j = by_x[b]
                b += way
                dx, dy = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1]
                if abs(dx) > span_px:
                    break
                if not known[j] or abs(dy) > span_px:
                    continue
                cosine = normals[i, 0] * normals[j, 0] + normals[i, 1] * normals[j, 1]
                gap, side = dx * normals[i, 0] + dy * normals[i, 1], dx * normals[i, 1] - dy * normals[i, 0]
                if abs(cosine) < _LEAST_COSINE or abs(gap) < apart_px or abs(side) > along_px:
                    continue
                for q in range(width):
                    if masses[j, q] == 0.0:
                        continue
                    place = gap + np.sign(cosine) * offsets[j, q]
                    for k in range(width):
                        if masses[j, q] > claims[i, k] and abs(place - offsets[i, k]) < same_px:
                            claims[i, k] = masses[j, q]
    for i in range(count):
        for k in range(width):
            both = masses[i, k] + claims[i, k]
            shared[i, k] = scores[i, k] * masses[i, k] / both if claims[i, k] > 0.0 else scores[i, k]
