"""What all edges of a part have in common and no profile tells alone, such as how far they are broken.

From where a part is usually seen a bevel is narrower than a pixel, and a single profile hardly shows it. But the edges
of one part are alike, and they must agree on one pose. So the network of `edge_profiles` says of every image edge
where the CAD's would be on a usual part, and by how much each of a few *traits* of the part would move it. Those
traits are the part's that make the edges of its frames agree, whatever the pose (a linear mixed-effects model; the
network learns the slopes by how well they explain views of a part that its traits were not taken from).

A trait is 0 for a usual part, and 1 is its standard deviation over parts.
(Not in the paper; see docs/paper-ledger.md. How the slopes are trained: data_recipes/profiles/training.py.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acp_lab.compiled import kernel
from acp_lab.geometry.arrays import FloatArray, plain
from acp_lab.geometry.normal_equations import add_up_rows, leave_rest
from acp_lab.geometry.pose_kernels import eliminate

FREEDOM = 3.0
"""Degrees of freedom of Student's distribution, by which edges scatter about where their profiles put them."""
# Fewer edges tell nothing of what they have in common.
_LEAST_EDGES = 50
# How far off a solved pose may be, beside its shift: turns, share of the distance. So much that edges alone tell the
# pose step; a pose that was taken for nearly right would hold the traits with which it was found.
_TURN_DEG, _DISTANCE_SHARE = 5.7, 0.2
# An edge that lies farther off is another one.
_FARTHEST_PX = 2.5
_ROUNDS = 4


@dataclass(frozen=True, eq=False)
class TraitEvidence:
    """Where n edges of a solved frame lie beside where they are told to be.

    Attributes:
        residuals_px: (n,) along the normals from the solved place to the told one; NaN where no edge was found.
        slopes_px: (n, k) by how much the told place moves along the normals with each trait.
        spreads_px: (n,) standard deviation of the told place; 0 where nothing was told.
        jacobian: (n, 6) motion along the normals by a pose step (rad, mm).
        depth_mm: of the part.
        told_with: (k,) the traits by which the places were told.
    """

    residuals_px: FloatArray
    slopes_px: FloatArray
    spreads_px: FloatArray
    jacobian: FloatArray
    depth_mm: float
    told_with: FloatArray


class EdgeTraits:
    """The traits of one tracked part. values: (k,)."""

    def __init__(self, count: int, evidence_share: float, memory: float, shift_mm: float) -> None:
        """See `edge_profiles.ProfileConfig`; count: k, 0 for a network that knows of none."""
        self._share, self._memory, self._shift_mm = evidence_share, memory, shift_mm
        self.values: FloatArray = np.zeros(count)
        self.forget()

    @property
    def are_learnt(self) -> bool:
        """Whether edges are asked for any."""
        return len(self.values) > 0 and self._share > 0.0

    def forget(self) -> None:
        """Those of a usual part."""
        count = len(self.values)
        self.values = np.zeros(count)
        self._information, self._vector = np.zeros((count, count)), np.zeros(count)

    def learn(self, seen: TraitEvidence) -> None:
        """Take in a solved frame; what earlier ones told counts less from frame to frame.

        Nothing changes where fewer than 50 of its edges were found and told.
        """
        if not self.are_learnt:
            return
        count = len(self.values)
        # What was told with other traits than those of now, such as before these were forgotten, is taken back as told.
        usual_px = seen.residuals_px - seen.slopes_px @ seen.told_with
        turn, distance_mm = np.radians(_TURN_DEG), _DISTANCE_SHARE * max(seen.depth_mm, 1.0)
        doubt = 1.0 / np.array([turn, turn, turn, self._shift_mm, self._shift_mm, distance_mm]) ** 2
        matrix, vector = np.empty((6 + count, 6 + count)), np.empty(6 + count)
        edges = _agree(
            usual_px, plain(seen.slopes_px), plain(seen.jacobian), plain(seen.spreads_px), doubt, self._share, matrix,
            vector,
        )  # fmt: skip
        if edges < _LEAST_EDGES:
            return
        self._information = self._memory * self._information + matrix[6:, 6:]
        self._vector = self._memory * self._vector + vector[6:]
        # With what is known beforehand: 0, give or take 1.
        self.values = self._vector.copy()
        eliminate(np.eye(count) + self._information, self.values)


@kernel("i8(f8[::1], f8[:, ::1], f8[:, ::1], f8[::1], f8[::1], f8, f8[:, ::1], f8[::1])")
def _agree(
    residuals_px: FloatArray, slopes_px: FloatArray, jacobian: FloatArray, spreads_px: FloatArray, doubt: FloatArray,
    share: float, matrix: FloatArray, vector: FloatArray,
) -> int:  # fmt: skip
    """Fill the last k rows and columns of matrix (6 + k, 6 + k) and of vector (6 + k,) with what n edges tell of the
    traits, whatever the pose: their information, and that times the traits. Returns how many edges were used.

    residuals_px: (n,) for a usual part; doubt: (6,) information about the pose step that there is beforehand; share:
    of an edge's own information that is new, as neighbours err alike. Edges scatter by Student's distribution.
    """
    count, most, edges = 6 + slopes_px.shape[1], len(residuals_px), 0
    rows, residuals, squares = np.empty((count, most)), np.empty(most), np.empty(most)
    for i in range(most):
        if abs(residuals_px[i]) < _FARTHEST_PX and spreads_px[i] > 0.0:
            # Residual plus what traits move is what a pose step explains.
            for k in range(count):
                rows[k, edges] = jacobian[i, k] if k < 6 else -slopes_px[i, k - 6]
            residuals[edges], squares[edges] = residuals_px[i], FREEDOM * spreads_px[i] * spreads_px[i]
            edges += 1
    found, matrix_and_prior = np.zeros(count), np.empty((count, count))
    rest, weights, pulls = np.empty(edges), np.empty(edges), np.empty(edges)
    for _ in range(_ROUNDS):
        leave_rest(rows, residuals, found, rest)
        for i in range(edges):
            weights[i] = share * (FREEDOM + 1.0) / (squares[i] + rest[i] * rest[i])
            pulls[i] = weights[i] * residuals[i]
        add_up_rows(rows, weights, pulls, matrix, vector)
        for k in range(6):
            matrix[k, k] += doubt[k]
        # With what is known of traits beforehand, where the pose step and the traits go that fit best.
        matrix_and_prior[:] = matrix
        found[:] = vector
        for k in range(6, count):
            matrix_and_prior[k, k] += 1.0
        if not eliminate(matrix_and_prior, found):
            return 0
    # The pose step is eliminated: what is left is of the traits alone.
    for column in range(6):
        for row in range(column + 1, count):
            factor = matrix[row, column] / matrix[column, column]
            for k in range(column, count):
                matrix[row, k] -= factor * matrix[column, k]
            vector[row] -= factor * vector[column]
    return edges
