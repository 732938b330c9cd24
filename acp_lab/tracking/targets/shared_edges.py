"""Image edges shared out among the model edges that they may belong to.

Where two edges of the model run side by side a few px apart, a rim and the face behind it, both find the same image
edge, and the one whose own edge shows no contrast pulls the pose away from the other. So an image edge counts for a
sample only by the share that is its own: with s the candidate's score after the memory had its say, d its distance from
the generated edge point, v the variance of that, and c the weight of the sample::

    m = c s exp(-d^2 / (2 v)),      share = m / (m + the most that a known neighbour on another edge makes of it)

A candidate stands where its profile says that the CAD's edge lies (`learning.edge_profiles`), for d as for whether two
candidates are one image edge. A sample's expected offset (`learning.contour_offsets`) is not taken off d.

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
from acp_lab.geometry.arrays import BoolArray, FloatArray, IntArray, plain
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
        same_px: candidates of two samples nearer to each other than this, after their profiles had their say, are
            one image edge.
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
        level: Level, jacobian: FloatArray, covariance: FloatArray | None,
    ) -> FloatArray:  # fmt: skip
        """(n, m) scores, less for candidates that rather belong to a neighbour.

        Args:
            scores: (n, m) in [0, 1], 0 where there is no candidate.
            offsets: (n, m) px of the candidates along the normals, where profiles say that the CAD's edge lies.
            points: (n, 2) px of the edge points; normals: (n, 2) unit.
            known: (n,) whether a sample was found before.
            level: at which the candidates were searched.
            jacobian: (n, 6) px along the normals by a pose step (rad, mm) about the part's centre.
            covariance: (6, 6) of the expected pose, of the same step, see `View`; None where nobody knows.
        """
        known_share = level.sigma_px >= self.known_from_sigma_px
        if not known_share and known.all():
            return scores
        least = self.spread_px**2 + (self.unknown_px**2 if covariance is None else 0.0)
        masses, shared = np.zeros(scores.shape), np.empty_like(scores)
        weights, offsets = np.where(known, 1.0, self.newcomer), plain(offsets)
        of_pose = _NO_COVARIANCE if covariance is None else covariance
        _weigh(scores, offsets, weights, plain(jacobian), of_pose, least, masses)
        _share_out(
            plain(points), plain(normals), known, known_share, offsets, scores, masses, self.apart_px, self.along_px,
            self.same_px, 2.0 * level.reach_px, np.argsort(points[:, 0]), shared,
        )  # fmt: skip
        return shared


_NO_COVARIANCE = np.zeros((6, 6))


@kernel("void(f8[:, ::1], f8[:, ::1], f8[::1], f8[:, ::1], f8[:, ::1], f8, f8[:, ::1])")
def _weigh(
    scores: FloatArray, offsets: FloatArray, weights: FloatArray, jacobian: FloatArray, covariance: FloatArray,
    least_variance: float, masses: FloatArray,
) -> None:  # fmt: skip
    """Fill masses (n, m), zeros before: m of the module's head.

    weights: (n,) of the samples; covariance: (6, 6) of the expected pose; least_variance: px^2 where that is sure.
    """
    # Of all samples in every loop: a processor sums several at once.
    columns, variances = jacobian.T.copy(), np.full(len(scores), least_variance)
    for j in range(6):
        for k in range(6):
            for i in range(len(scores)):
                variances[i] += columns[j, i] * covariance[j, k] * columns[k, i]
    for i in range(len(scores)):
        narrow = -0.5 / variances[i]
        for k in range(scores.shape[1]):
            if scores[i, k] != 0.0:
                masses[i, k] = weights[i] * scores[i, k] * np.exp(narrow * offsets[i, k] * offsets[i, k])


@kernel(
    "void(f8[:, ::1], f8[:, ::1], b1[::1], b1, f8[:, ::1], f8[:, ::1], f8[:, ::1], f8, f8, f8, f8, i8[::1],"
    " f8[:, ::1])",
)
def _share_out(
    points: FloatArray, normals: FloatArray, known: BoolArray, known_share: bool, offsets: FloatArray,
    scores: FloatArray, masses: FloatArray, apart_px: float, along_px: float, same_px: float, span_px: float,
    by_x: IntArray, shared: FloatArray,
) -> None:  # fmt: skip
    """Fill shared (n, m), see `EdgeSharing.share_out`.

    known_share: whether the known share among themselves; by_x: (n,) the points' order from left to right; span_px:
    neighbours are no farther than this in x and y.
    """
    count, width = scores.shape
    # Those who may claim from left to right, in rows of their own: x, y, normal.
    rows, of, claimants = np.empty((4, count)), np.empty(count, np.int64), 0
    for i in by_x:
        if known[i] and scores[i].any():
            rows[0, claimants], rows[1, claimants] = points[i, 0], points[i, 1]
            rows[2, claimants], rows[3, claimants] = normals[i, 0], normals[i, 1]
            of[claimants] = i
            claimants += 1
    claims, neighbours, beside = np.empty(width), np.empty(count, np.int64), np.empty(count, np.bool_)
    first, last = 0, 0
    for i in by_x:
        claims[:] = 0.0
        if not known[i] or known_share:
            x, y, nx, ny = points[i, 0], points[i, 1], normals[i, 0], normals[i, 1]
            while first < claimants and rows[0, first] < x - span_px:
                first += 1
            while last < claimants and rows[0, last] <= x + span_px:
                last += 1
            # Without a branch, as no processor can foresee who is a neighbour; and several at once.
            xs, ys, nxs, nys = rows[0, first:last], rows[1, first:last], rows[2, first:last], rows[3, first:last]
            for b in range(len(xs)):
                dx, dy = xs[b] - x, ys[b] - y
                gap, side = abs(dx * nx + dy * ny), abs(dx * ny - dy * nx)
                cosine = abs(nxs[b] * nx + nys[b] * ny)
                beside[b] = (abs(dy) <= span_px) & (cosine >= _LEAST_COSINE) & (gap >= apart_px) & (side <= along_px)
            found = 0
            for b in range(len(xs)):
                neighbours[found] = first + b
                found += beside[b]
            for b in neighbours[:found]:
                j = of[b]
                gap = (rows[0, b] - x) * nx + (rows[1, b] - y) * ny
                sign = np.sign(rows[2, b] * nx + rows[3, b] * ny)
                for q in range(width):
                    if masses[j, q] == 0.0:
                        continue
                    place = gap + sign * offsets[j, q]
                    for k in range(width):
                        if abs(place - offsets[i, k]) < same_px:
                            claims[k] = max(claims[k], masses[j, q])
        for k in range(width):
            both = masses[i, k] + claims[k]
            shared[i, k] = scores[i, k] * masses[i, k] / both if claims[k] > 0.0 else scores[i, k]
