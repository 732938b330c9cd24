"""The least error that the edges of a frame allow: a Cramer-Rao bound of the pose, and of ADD.

At the true pose every visible edge sample has an image edge beside it. How much these scatter says how well a pose can
be known at all: the information of n samples is J^T J / s^2, and no unbiased estimate has a smaller covariance than its
inverse (Kay, "Fundamentals of Statistical Signal Processing: Estimation Theory", 1993, chapter 3). But samples do not
only scatter: all outlines lie beside the CAD's by a length that they share, since edges are broken and light shifts
them, and so do all inner edges; and a stretch of an edge has an offset of its own, so that neighbours err together.
Unknown lengths that the frame has to tell as well, nuisances, take information away, most of it from the distance.

About what its stretch shares, each sample counts as independent: what a frame really allows is more error than this,
never less.

Convention: pose steps (rad, mm) about the part's centre, in camera axes; offsets in mm, positive off the material for
outlines and away from the middle of the visible edges for the others.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from acp_lab.cad.part import Part
from acp_lab.errors import ParameterError
from acp_lab.geometry.arrays import BoolArray, FloatArray, IntArray
from acp_lab.geometry.pose import transform
from acp_lab.geometry.pose_step import centre_position, step_jacobian
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.frame_solver import FrameSolver
from acp_lab.tracking.learning.knowledge import Off, SampleLearning
from acp_lab.tracking.method import ACP
from acp_lab.tracking.start import LOOK_LEVEL
from acp_lab.tracking.stopwatch import Stopwatch

WITHOUT_PROFILES = replace(ACP, learning=SampleLearning(profiles=Off()))
"""`acp`, but that it takes image edges as they are: what `edge_evidence` asks for."""
LEAST_SAMPLES = 12
"""Of a class, for its offset and scatter; and of all."""
LEAST_IN_STRETCH = 4
_STRETCH_IN_DIAMETERS = 0.08
_MAD_TO_DEVIATION = 1.4826
_LEAST_SCATTER_PX = 0.02
_LOOSE_MM = 100.0
# Beaton and Tukey's biweight; at this width 95% as sure as least squares where there are no outliers.
_TUKEY, _ROUNDS = 4.685, 6
_DRAWS = 400
_MOST_VERTICES = 300


@dataclass(frozen=True, eq=False)
class EdgeEvidence:
    """What n edge samples show at the true pose.

    Attributes:
        jacobian: (n, 6) px along the samples' normals by a pose step.
        residuals_px: (n,) from the CAD's edge to the image's along the normal.
        px_per_mm: (n,) signed scale across the edge, positive where the offset counts as positive along the normal.
        outline: (n,) bool, whether on the outline.
        stretch: (n,) the stretch of edge that a sample belongs to, a cell of space; the same in every frame.
        points_obj: (n, 3) mm, the samples; those of the CAD model's edges are the same in every frame.
    """

    jacobian: FloatArray
    residuals_px: FloatArray
    px_per_mm: FloatArray
    outline: BoolArray
    stretch: IntArray
    points_obj: FloatArray

    @property
    def classes(self) -> FloatArray:
        """(n, 2) px per mm of what outlines, and of what inner edges share; 0 for those of the other class."""
        return np.stack([np.where(self.outline, self.px_per_mm, 0.0), np.where(self.outline, 0.0, self.px_per_mm)], 1)

    @property
    def shared_mm(self) -> FloatArray:
        """(2,) offset that outlines, and inner edges share: medians; NaN for a class of too few samples."""
        return np.array([self._median(rows, LEAST_SAMPLES) for rows in (self.outline, ~self.outline)])

    @cached_property
    def stretches_mm(self) -> dict[int, tuple[bool, float]]:
        """By stretch of enough samples: whether it is of the outline, and its offset beside what its class shares."""
        shared_mm, found = self.shared_mm, {}
        for stretch in np.unique(self.stretch).tolist():
            rows = self.stretch == stretch
            outline = bool(self.outline[rows][0])
            own = self._median(rows, LEAST_IN_STRETCH) - shared_mm[0 if outline else 1]
            if np.isfinite(own):
                found[stretch] = (outline, float(own))
        return found

    @cached_property
    def spread_mm(self) -> FloatArray:
        """(2,) standard deviation of the stretches of outlines, and of inner edges, robustly; 0 for too few."""
        return np.array([
            robust_deviation([own for outline, own in self.stretches_mm.values() if outline is which])
            for which in (True, False)
        ])  # fmt: skip

    @cached_property
    def scatter_px(self) -> FloatArray:
        """(n,) standard deviation of each sample about what its stretch shares, robustly, one per class.

        Infinite for the samples of a class or stretch that has too few.
        """
        deviation = np.full(len(self.residuals_px), np.inf)
        for rows, shared in zip((self.outline, ~self.outline), self.shared_mm, strict=True):
            own = np.array([self.stretches_mm.get(s, (True, np.nan))[1] for s in self.stretch[rows].tolist()])
            rest = self.residuals_px[rows] - (shared + own) * self.px_per_mm[rows]
            known = np.isfinite(rest)
            if known.sum() >= LEAST_SAMPLES:
                scatter_px = max(robust_deviation(rest[known].tolist()), _LEAST_SCATTER_PX)
                deviation[np.flatnonzero(rows)[known]] = scatter_px
        return deviation

    @property
    def stretches(self) -> FloatArray:
        """(n, m) px per mm of what each of m stretches shares, in the order of `stretches_mm`."""
        ids = np.array(list(self.stretches_mm), np.int64)
        return np.where(self.stretch[:, None] == ids, self.px_per_mm[:, None], 0.0)

    def _median(self, rows: BoolArray, least: int) -> float:
        known = rows & (self.px_per_mm != 0.0)
        if known.sum() < least:
            return float("nan")
        return float(np.median(self.residuals_px[known] / self.px_per_mm[known]))


def robust_deviation(values: list[float]) -> float:
    """Standard deviation about the median, from the median absolute deviation; 0 for fewer than three."""
    if len(values) < 3:
        return 0.0
    return _MAD_TO_DEVIATION * float(np.median(np.abs(np.array(values) - np.median(values))))


def edge_evidence(solver: FrameSolver, frame: Frame, cam_T_true: FloatArray) -> EdgeEvidence | None:
    """The image edges beside a part at its true pose (4, 4); None where too few are found.

    solver: of a method that searches along normals and takes image edges as they are; what it has learnt is forgotten.

    Raises:
        ParameterError: the method reads profiles, which say where the CAD's edges are in place of the image's.
    """
    solver.forget()
    if solver.knowledge.profiles is not None:
        raise ParameterError("evidence: image edges as they are: give a method such as WITHOUT_PROFILES")
    seen = solver.look(frame.image, frame.camera, cam_T_true, solver.choose_region(cam_T_true))
    looked = None if seen is None else solver.look_at(seen, seen.view.at_pose(cam_T_true), LOOK_LEVEL, Stopwatch())
    matches = None if looked is None else looked.judgement.matches
    if matches is None or matches.expected is None:
        return None
    residuals_px = matches.sure_residuals_px + matches.expected.offsets_px
    arms = matches.edges.points - matches.edges.points.mean(0)
    away = np.sign(np.einsum("nj,nj->n", arms, matches.normals)) * np.abs(matches.expected.px_per_mm)
    scale = np.where(matches.edges.outline, matches.expected.px_per_mm, away)
    found = np.isfinite(residuals_px)
    if found.sum() < LEAST_SAMPLES:
        return None
    outline = matches.edges.outline[found]
    part, points_obj = solver.part, matches.points_obj[found]
    cells = np.floor((points_obj - part.box_min) / (_STRETCH_IN_DIAMETERS * part.diameter))
    places = cells.astype(np.int64) @ np.array([10_000, 100, 1]) * 2 + outline
    return EdgeEvidence(matches.jacobian[found], residuals_px[found], scale[found], outline, places, points_obj)


def least_covariance(
    jacobian: FloatArray, scatter_px: FloatArray, shared: FloatArray, shared_mm: FloatArray | float
) -> FloatArray:
    """(k, k) of the k variables: no unbiased estimate from n independent samples has a smaller one.

    Args:
        jacobian: (n, k) px of each sample by the variables.
        scatter_px: (n,) standard deviation of each sample; infinite for one that says nothing.
        shared: (n, m) px of each sample by m nuisances, such as `EdgeEvidence.classes` and `.stretches`.
        shared_mm: (m,) or one standard deviation of the nuisances, known before: 0 where they are known, infinite
            where nothing is known of them.

    Raises:
        ParameterError: a standard deviation is negative, or the samples do not fix all variables.
    """
    deviation = np.broadcast_to(np.asarray(shared_mm, np.float64), shared.shape[1:])
    if not ((deviation >= 0.0).all() and (scatter_px > 0.0).all()):
        raise ParameterError("bound: scatter and shared offsets are standard deviations: give numbers above 0")
    weights = 1.0 / np.square(scatter_px)
    information = jacobian.T @ (weights[:, None] * jacobian)
    # What is known before costs nothing, and what no sample shows cannot be told.
    open_ones = (deviation > 0.0) & (np.square(shared).T @ weights > 0.0)
    if open_ones.any():
        asked = shared[:, open_ones]
        own = asked.T @ (weights[:, None] * asked) + np.diag(1.0 / np.square(deviation[open_ones]))
        between = jacobian.T @ (weights[:, None] * asked)
        information = information - between @ np.linalg.solve(own, between.T)
    # In units in which every variable alone has information 1.
    unit = 1.0 / np.sqrt(np.maximum(np.diagonal(jacobian.T @ (weights[:, None] * jacobian)), 1e-300))
    scaled = unit[:, None] * information * unit
    if np.linalg.eigvalsh(scaled)[0] < 1e-12:
        raise ParameterError("bound: the samples do not fix all variables: give more of them, or fewer unknowns")
    covariance = unit[:, None] * np.linalg.inv(scaled) * unit
    return np.asarray(0.5 * (covariance + covariance.T))


def shown_step(
    jacobian: FloatArray,
    residuals_px: FloatArray,
    scatter_px: FloatArray,
    shared: FloatArray,
    shared_mm: FloatArray | float,
) -> FloatArray:
    """(k,) what n samples show of k variables: least squares beside the nuisances, robust against wrong image edges.

    Where samples are as `least_covariance` has them it scatters by that covariance; where it scatters more, they are
    not. Arguments as there; residuals_px: (n,). Nuisances of which nothing is known before are held loosely, by 100 mm.
    """
    deviation = np.minimum(np.broadcast_to(np.asarray(shared_mm, np.float64), shared.shape[1:]), _LOOSE_MM)
    asked = deviation > 0.0
    rows = np.hstack([jacobian, shared[:, asked]])
    known = np.concatenate([np.zeros(jacobian.shape[1]), 1.0 / np.square(deviation[asked])])
    weights = 1.0 / np.square(scatter_px)
    found, robust = np.zeros(rows.shape[1]), np.ones(len(rows))
    for _ in range(_ROUNDS):
        weighted = (weights * robust)[:, None] * rows
        # Held a little, where robust weights leave a variable without samples.
        normal = weighted.T @ rows + np.diag(known)
        normal += 1e-9 * np.diag(np.diagonal(normal) + 1e-9)
        found = np.linalg.solve(normal, weighted.T @ residuals_px)
        rest = (residuals_px - rows @ found) * np.sqrt(weights)
        robust = np.where(np.abs(rest) < _TUKEY, np.square(1.0 - np.square(rest / _TUKEY)), 0.0)
    return np.asarray(found[: jacobian.shape[1]])


@dataclass(frozen=True)
class AllowedError:
    """Of the best unbiased estimate: its mean ADD as a share of the diameter, and the probability of each limit.

    within: by limit, the probability that ADD is below that share of the diameter.
    """

    mean: float
    within: dict[float, float]


def allowed_error(
    part: Part, cam_T_true: FloatArray, covariance: FloatArray, limits: tuple[float, ...] = (0.02, 0.05)
) -> AllowedError:
    """ADD of poses that scatter about the true one (4, 4) with a covariance (6, 6) of pose steps."""
    points_cam = transform(cam_T_true, part.vertices[:: -(-len(part.vertices) // _MOST_VERTICES)])
    centre_cam = centre_position(cam_T_true, part.box_centre)
    # mm of each vertex along x, y and z by a pose step.
    rows = np.stack([step_jacobian(points_cam, np.tile(axis, (len(points_cam), 1)), centre_cam) for axis in np.eye(3)])
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    steps = np.random.default_rng(0).standard_normal((_DRAWS, 6)) @ root.T
    add = np.linalg.norm(np.einsum("anj,dj->dna", rows, steps), axis=2).mean(1) / part.diameter
    return AllowedError(float(add.mean()), {limit: float((add < limit).mean()) for limit in limits})
