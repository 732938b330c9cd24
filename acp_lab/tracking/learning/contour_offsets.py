"""Where image edges lie beside the CAD's edges: broken edges, rims of light, and how to learn them.

A machined part has broken edges of 0.2 to 0.4 mm that its CAD model does not: its outline lies inside
the model's, the part looks smaller, and an edge tracker puts it 1 to 4% too far away while the
overlay looks perfect. So every edge sample carries an expected offset in mm:

* as a prior, outlines lie inside by a share of the edge break; where the profiles of image edges are read
  (`edge_profiles`) these tell most of that, and offsets are what is left;
* where the start pose can be trusted, the offsets of all samples in the first frame are measured, and
  neighbours that were not seen take the mean of their cell of space;
* inner creases are moved about by reflections on some parts and are the steadiest of all on others;
  their spread follows how much they scatter, frame by frame;
* an offset is the view's more than the part's: what was measured from one side says little from another
  (`benchmarks/offset_persistence.py`), and counts less the farther the view has turned since.

The spread becomes a weight in the solver: samples with a well-known offset decide the depth.
(Not in the paper, which takes CAD edges as they are; see docs/paper-ledger.md.)
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from acp_lab.cad.edges import EdgeSamples
from acp_lab.compiled import kernel
from acp_lab.errors import TrackingError
from acp_lab.geometry.arrays import BoolArray, FloatArray, IntArray, plain
from acp_lab.geometry.pose_kernels import eliminate

# A handful of samples has no scatter to speak of.
MIN_FOR_SCATTER = 30
# Turns are taken in from so many degrees on: a pose that only trembles must not wear away what was measured.
_TURNED_DEG = 2.0
# Less of a measurement than this is none.
_LEAST_LEFT = 1e-3


@dataclass(frozen=True)
class OffsetConfig:
    """How offsets are expected and learnt; lengths in mm, of parts of usual size, see `part_size`.

    Attributes:
        break_share: of the part's edge break, by which outlines are expected to lie inside the CAD's.
        edge_spread_px: scatter of an image edge about its true place, in px.
        known_spread: of an outline sample measured in the first frame.
        cell_spread: of an outline sample whose neighbours were measured.
        unknown_spread: of an outline sample nothing near which was measured.
        inner_spread: of creases that are no outline, when they scatter by `inner_scatter_px`.
        inner_power, inner_limits: the spread grows with that power of the scatter, within limits.
        inner_scatter_px: median absolute residual of steady inner creases.
        initial_scatter_px: what is assumed before any was seen.
        scatter_rate: share of a new frame in the running scatter.
        cell_in_diameters: side of the cells that share what was measured.
        sample_inertia, cell_inertia, class_inertia: weights, in numbers of measurements, of the coarser
            estimate (cell, all outlines, prior) beside the finer one.
        largest: no measured offset is taken as larger.
        view_deg: turn of the view after which a measurement counts e times less; 0 for never.
        follow_rate: share of what a frame shows beside the expected offset that is taken over, where the offset is not
            known at all; follow_noise: mm, scatter of what a frame shows, which lowers that share. 0 for never.
    """

    kind: ClassVar[str] = "on"
    in_mm: ClassVar[Mapping[str, int]] = dict.fromkeys(
        ("known_spread", "cell_spread", "unknown_spread", "inner_spread", "inner_limits", "largest", "follow_noise"), 1
    )
    break_share: float = 0.8
    edge_spread_px: float = 0.3
    known_spread: float = 0.15
    cell_spread: float = 0.375
    unknown_spread: float = 0.6
    inner_spread: float = 0.3
    inner_power: float = 4.0
    inner_limits: tuple[float, float] = (0.15, 1.0)
    inner_scatter_px: float = 0.3
    initial_scatter_px: float = 0.36
    scatter_rate: float = 0.1
    cell_in_diameters: float = 0.08
    sample_inertia: float = 2.0
    cell_inertia: float = 4.0
    class_inertia: float = 20.0
    largest: float = 0.8
    view_deg: float = 15.0
    follow_rate: float = 0.2
    follow_noise: float = 0.4

    def __post_init__(self) -> None:
        divisors = "edge_spread_px", "inner_scatter_px", "cell_in_diameters"
        for name in (*divisors, "sample_inertia", "cell_inertia", "class_inertia"):
            if not 1e-6 <= getattr(self, name) <= 1e6:
                raise TrackingError(f"learning.offsets.{name} = {getattr(self, name):g}: give a number above 0")
        for name in ("scatter_rate", "follow_rate"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise TrackingError(f"learning.offsets.{name} = {getattr(self, name):g}: give 0 to 1")
        if not 0.0 <= self.view_deg < float("inf"):
            raise TrackingError(f"learning.offsets.view_deg = {self.view_deg:g}: give degrees, 0 for never")
        if not 0.0 <= self.inner_limits[0] <= self.inner_limits[1]:
            limits = list(self.inner_limits)
            raise TrackingError(f"learning.offsets.inner_limits = {limits}: give the least, then the most")

    def expected_mm(self, edge_break_mm: float) -> float:
        """Where outlines are expected beside the CAD's, outward, before any was measured."""
        return -self.break_share * edge_break_mm


@dataclass(frozen=True)
class ExpectedOffsets:
    """What is expected of n visible samples.

    Attributes:
        offsets_px: (n,) along the image normals.
        weights: (n,) in (0, 1], from how well the offset is known.
        offsets_mm: (n,) outward for outlines, along the normal for inner creases.
        px_per_mm: (n,) scale across the edge, signed: positive where outward is along the normal.
    """

    offsets_px: FloatArray
    weights: FloatArray
    offsets_mm: FloatArray
    px_per_mm: FloatArray


class ContourOffsets:
    """Expected offset of every edge sample, as an outline and as an inner crease.

    prior_mm: of outlines, outward, before any was measured.
    """

    def __init__(self, edges: EdgeSamples, diameter: float, prior_mm: float, config: OffsetConfig) -> None:
        self.config = config
        self.edges = edges
        self.prior_mm = prior_mm
        cells = np.floor((edges.points_obj - edges.points_obj.min(0)) / (config.cell_in_diameters * diameter))
        _, self._cell_of = np.unique(cells.astype(np.int64), axis=0, return_inverse=True)
        self._cell_of = self._cell_of.ravel()
        self._outward_obj = edges.off_obj
        self._numbers = np.array(
            [
                config.sample_inertia,
                config.cell_inertia,
                config.known_spread,
                config.cell_spread,
                config.unknown_spread,
                config.edge_spread_px,
            ]
        )
        self.forget()

    def forget(self) -> None:
        """Back to the prior."""
        count, cells = len(self.edges), int(self._cell_of.max()) + 1
        # Column 0: as an inner crease, column 1: as an outline.
        self._sample_count, self._sample_sum = np.zeros((count, 2)), np.zeros((count, 2))
        self._cell_count, self._cell_sum = np.zeros(cells), np.zeros(cells)
        # By how much the sums are moved by a part's traits.
        self._sample_slopes: FloatArray | None = None
        self._cell_slopes: FloatArray | None = None
        self._inner_scatter_px = self.config.initial_scatter_px
        self._to_eye: FloatArray | None = None

    @property
    def inner_spread_mm(self) -> float:
        """Spread of inner creases at present."""
        config = self.config
        ratio = self._inner_scatter_px / config.inner_scatter_px
        least, most = config.inner_limits
        return min(max(config.inner_spread * ratio**config.inner_power, least), most)

    def expect(
        self, ids: IntArray, outline: BoolArray, directions_obj: FloatArray, scatter_px: FloatArray | None = None
    ) -> ExpectedOffsets:
        """Offsets of visible samples.

        Args:
            ids: (n,) rows of the edge samples.
            outline: (n,) bool.
            directions_obj: (n, 3) px per mm along the image normal, object frame
                (`pose_step.image_directions` turned by the pose).
            scatter_px: (n,) of each edge about its place before anything was learnt of it; 0 where nobody knows.
        """
        config = self.config
        total, total_sum = self._cell_count.sum(), self._cell_sum.sum()
        of_class = (config.class_inertia * self.prior_mm + total_sum) / (config.class_inertia + total)
        found = np.empty((4, len(ids)))
        _expect(
            np.ascontiguousarray(ids), np.ascontiguousarray(outline), plain(directions_obj), self._outward_obj,
            self._cell_of, self._cell_count, self._cell_sum, self._sample_count, self._sample_sum, of_class,
            self.inner_spread_mm, self._numbers, np.zeros(len(ids)) if scatter_px is None else scatter_px, found,
        )  # fmt: skip
        return ExpectedOffsets(*found)

    def follow(self, ids: IntArray, outline: BoolArray, expected: ExpectedOffsets, residuals_px: FloatArray) -> None:
        """Take over a share of what a tracked frame shows, the larger the less is known of a sample.

        Args:
            residuals_px: (n,) from the expected to the seen place along the normals, NaN where nothing was seen.
        """
        config = self.config
        if not config.follow_rate:
            return
        numbers = (
            config.sample_inertia,
            config.known_spread,
            config.unknown_spread,
            config.follow_rate,
            config.follow_noise,
            config.largest,
        )
        _follow(
            np.ascontiguousarray(ids), np.ascontiguousarray(outline), expected.offsets_mm, expected.px_per_mm,
            plain(residuals_px), self._sample_count, self._sample_sum, self.inner_spread_mm, np.array(numbers),
        )  # fmt: skip

    def observe_scatter(
        self, ids: IntArray, outline: BoolArray, residuals_px: FloatArray, jacobian: FloatArray
    ) -> None:
        """Take in how inner creases scatter in a solved frame.

        Args:
            residuals_px: (n,) px, NaN where no image edge was found.
            jacobian: (n, 6) of the motion along the normals by a pose step. The creases are fitted by a step of
                their own first: where outlines decide the pose, its error is no scatter of the creases.
        """
        rest, rows = np.empty(len(ids)), np.empty((len(ids), 6))
        count = _inner_creases(
            np.ascontiguousarray(ids), np.ascontiguousarray(outline), plain(residuals_px), plain(jacobian),
            self._sample_count, rest, rows,
        )  # fmt: skip
        if count >= MIN_FOR_SCATTER:
            seen = max(_scatter_after_fit(rest[:count], rows[:count]), 0.05)
            self._inner_scatter_px += self.config.scatter_rate * (seen - self._inner_scatter_px)

    def learn(
        self, ids: IntArray, outline: BoolArray, expected: ExpectedOffsets, residuals_px: FloatArray,
        slopes_px: FloatArray | None = None,
    ) -> None:  # fmt: skip
        """Take in what a trusted pose shows.

        Args:
            residuals_px: (n,) from the expected to the seen place along the normals, NaN where nothing was seen.
            slopes_px: (n, k) by how much the seen place moves with each of the part's traits, see `edge_traits`.
        """
        rows = np.flatnonzero(np.isfinite(residuals_px) & (expected.px_per_mm != 0.0))
        measured = expected.offsets_mm[rows] + residuals_px[rows] / expected.px_per_mm[rows]
        measured = np.clip(measured, -self.config.largest, self.config.largest)
        role = outline[rows].astype(np.intp)
        np.add.at(self._sample_count, (ids[rows], role), 1.0)
        np.add.at(self._sample_sum, (ids[rows], role), measured)
        shared = outline[rows] & self.edges.convex[ids[rows]]
        cells = self._cell_of[ids[rows[shared]]]
        np.add.at(self._cell_count, cells, 1.0)
        np.add.at(self._cell_sum, cells, measured[shared])
        if slopes_px is not None:
            if self._sample_slopes is None or self._cell_slopes is None:
                traits = slopes_px.shape[1]
                self._sample_slopes = np.zeros((*self._sample_sum.shape, traits))
                self._cell_slopes = np.zeros((len(self._cell_sum), traits))
            slopes = slopes_px[rows] / expected.px_per_mm[rows, None]
            np.add.at(self._sample_slopes, (ids[rows], role), slopes)
            np.add.at(self._cell_slopes, cells, slopes[shared])

    def see_from(self, to_eye_obj: FloatArray) -> None:
        """Let what was measured count less by how far the view has turned; to_eye_obj: (3,), object frame."""
        if not self.config.view_deg:
            return
        to_eye = to_eye_obj / max(math.sqrt(to_eye_obj @ to_eye_obj), 1e-9)
        if self._to_eye is None:
            self._to_eye = to_eye
            return
        turn_deg = math.degrees(math.acos(min(max(float(to_eye @ self._to_eye), -1.0), 1.0)))
        if turn_deg < _TURNED_DEG:
            return
        self._to_eye = to_eye
        left = math.exp(-turn_deg / self.config.view_deg)
        measured = self._sample_count, self._sample_sum, self._cell_count, self._cell_sum
        for array in (*measured, self._sample_slopes, self._cell_slopes):
            if array is not None:
                array *= left

    def move(self, traits: FloatArray) -> None:
        """What was measured lies elsewhere beside the CAD's edges when the part's traits (k,) are others by so much."""
        if self._sample_slopes is not None and self._cell_slopes is not None:
            traits = plain(traits)
            _add_moved(self._sample_sum.reshape(-1), self._sample_slopes.reshape(-1, len(traits)), traits)
            _add_moved(self._cell_sum, self._cell_slopes, traits)


@kernel("void(f8[::1], f8[:, ::1], f8[::1])")
def _add_moved(sums: FloatArray, slopes: FloatArray, traits: FloatArray) -> None:
    """Add slopes (n, k) times traits (k,) to sums (n,)."""
    for n in range(len(sums)):
        for k in range(len(traits)):
            sums[n] += slopes[n, k] * traits[k]


@kernel(
    "void(i8[::1], b1[::1], f8[:, ::1], f8[:, ::1], i8[::1], f8[::1], f8[::1], f8[:, ::1], f8[:, ::1], f8, f8, f8[::1],"
    " f8[::1], f8[:, ::1])"
)
def _expect(
    ids: IntArray, outline: BoolArray, directions_obj: FloatArray, outward_obj: FloatArray, cell_of: IntArray,
    cell_count: FloatArray, cell_sum: FloatArray, sample_count: FloatArray, sample_sum: FloatArray, of_class: float,
    inner_spread: float, numbers: FloatArray, scatter_px: FloatArray, found: FloatArray,
) -> None:  # fmt: skip
    """Fill found (4, n): the fields of `ExpectedOffsets`. numbers: as `ContourOffsets` has them; scatter_px: (n,), see
    `ContourOffsets.expect`.
    """
    sample_inertia, cell_inertia, known_spread = numbers[0], numbers[1], numbers[2]
    cell_spread, unknown_spread, edge_spread = numbers[3], numbers[4], numbers[5]
    for n in range(len(ids)):
        i = ids[n]
        x, y, z = directions_obj[n, 0], directions_obj[n, 1], directions_obj[n, 2]
        scale = np.sqrt(x * x + y * y + z * z)
        if outline[n]:
            cell = cell_of[i]
            coarse = (cell_inertia * of_class + cell_sum[cell]) / (cell_inertia + cell_count[cell])
            role, spread = 1, unknown_spread
            if sample_count[i, 1] > 0:
                spread = known_spread
            elif cell_count[cell] > 2:
                spread = cell_spread
            # Which way along the image normal leads off the material.
            sign = np.sign(x * outward_obj[i, 0] + y * outward_obj[i, 1] + z * outward_obj[i, 2])
        else:
            role, coarse, spread, sign = 0, 0.0, inner_spread, 1.0
        offset = (sample_inertia * coarse + sample_sum[i, role]) / (sample_inertia + sample_count[i, role])
        square, spread_square = edge_spread * edge_spread, (spread * scale) ** 2
        if scatter_px[n] > 0.0:
            own_square = scatter_px[n] * scatter_px[n]
            if sample_count[i, role] > _LEAST_LEFT:
                spread_square /= min(sample_count[i, role], 1.0)
                # What was measured and what the profile says are two measurements of one place.
                spread_square = own_square * spread_square / (own_square + spread_square)
            else:
                spread_square = own_square
        found[0, n] = offset * sign * scale
        found[1, n] = square / (square + spread_square)
        found[2, n], found[3, n] = offset, sign * scale


@kernel("i8(i8[::1], b1[::1], f8[::1], f8[:, ::1], f8[:, ::1], f8[::1], f8[:, ::1])")
def _inner_creases(
    ids: IntArray, outline: BoolArray, residuals_px: FloatArray, jacobian: FloatArray, sample_count: FloatArray,
    rest: FloatArray, rows: FloatArray,
) -> int:  # fmt: skip
    """Fill rest (n,) and rows (n, 6) with residuals and Jacobian of inner creases that were measured; returns how many.

    sample_count: (samples, 2), see `ContourOffsets`.
    """
    count = 0
    for n in range(len(ids)):
        if np.isfinite(residuals_px[n]) and not outline[n] and sample_count[ids[n], 0] > 0.0:
            rest[count], rows[count] = residuals_px[n], jacobian[n]
            count += 1
    return count


@kernel("f8(f8[::1], f8[:, ::1])")
def _scatter_after_fit(residuals_px: FloatArray, jacobian: FloatArray) -> float:
    """Median absolute residual that is left after a robust fit of one pose step."""
    count = len(residuals_px)
    # Columns in rad and mm are brought to one scale, for a ridge that touches only what cannot be seen.
    scale, step = np.zeros(6), np.zeros(6)
    for i in range(count):
        for j in range(6):
            scale[j] += jacobian[i, j] * jacobian[i, j]
    for j in range(6):
        scale[j] = max(np.sqrt(scale[j] / count), 1e-9)
    rows, rest = np.empty((count, 6)), residuals_px.copy()
    for i in range(count):
        for j in range(6):
            rows[i, j] = jacobian[i, j] / scale[j]
    matrix, vector = np.empty((6, 6)), np.empty(6)
    for _ in range(3):
        matrix[:] = 0.0
        vector[:] = 0.0
        total = 0.0
        for i in range(count):
            weight = 1.0 / (1.0 + (rest[i] / 0.5) ** 2) ** 2
            total += weight
            for j in range(6):
                weighted = weight * rows[i, j]
                vector[j] += weighted * rest[i]
                for k in range(j + 1):
                    matrix[j, k] += weighted * rows[i, k]
        for j in range(6):
            matrix[j, j] += 1e-3 * total
            for k in range(j):
                matrix[k, j] = matrix[j, k]
        if not eliminate(matrix, vector):
            break
        step += vector
        for i in range(count):
            rest[i] = residuals_px[i]
            for j in range(6):
                rest[i] -= rows[i, j] * step[j]
    return float(np.median(np.abs(rest)))


@kernel("void(i8[::1], b1[::1], f8[::1], f8[::1], f8[::1], f8[:, ::1], f8[:, ::1], f8, f8[::1])")
def _follow(
    ids: IntArray, outline: BoolArray, offsets_mm: FloatArray, px_per_mm: FloatArray, residuals_px: FloatArray,
    sample_count: FloatArray, sample_sum: FloatArray, inner_spread: float, numbers: FloatArray,
) -> None:  # fmt: skip
    """Move sample_sum (samples, 2) on, see `ContourOffsets.follow`. numbers: of the configuration."""
    inertia, known_spread, unknown_spread = numbers[0], numbers[1], numbers[2]
    rate, noise, largest = numbers[3], numbers[4], numbers[5]
    for n in range(len(ids)):
        if px_per_mm[n] == 0.0 or not abs(residuals_px[n]) < 2.0:
            continue
        i, role = ids[n], int(outline[n])
        count, spread = sample_count[i, role], inner_spread
        if role == 1:
            spread = known_spread if count > 0.0 else unknown_spread
        share = rate * spread * spread / (spread * spread + noise * noise)
        there = min(max(offsets_mm[n] + share * residuals_px[n] / px_per_mm[n], -largest), largest)
        sample_sum[i, role] += (there - offsets_mm[n]) * (inertia + count)
