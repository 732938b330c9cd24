"""A level of the region tracker as one call of machine code: `solvers.minimise` says what is computed, this the same.

Between two steps the lines say anew how far their points have to go: the mean of their posteriors at first, then its
slope where they stand (`contour_regions`). Each step is that of `pose_descent`, on lines that pull with a strength.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acp_lab.compiled import kernel
from acp_lab.geometry.arrays import FloatArray, IntArray
from acp_lab.tracking.frame_view import Estimate
from acp_lab.tracking.motions import Beside, RigidMotion
from acp_lab.tracking.pose_descent_kernel import descend
from acp_lab.tracking.priors import sum_of
from acp_lab.tracking.solvers import GaussNewton, Problem, Solver
from acp_lab.tracking.targets.contour_regions import ContourMeasure, newton_steps


@dataclass(frozen=True, eq=False)
class ContourLevel:
    """One level on lines across the outline alone.

    Attributes:
        problem, motion, measure: what is minimised; precision: of the measure.
        relative, absolute, towards: (6, 6) of the priors, see `pose_descent.PoseLevel`.
        solver: how it goes down.
    """

    problem: Problem
    motion: RigidMotion
    measure: ContourMeasure
    precision: float
    relative: FloatArray
    absolute: FloatArray
    towards: FloatArray
    solver: GaussNewton

    def minimise(self, start: Estimate) -> tuple[Estimate, ...]:
        """See `solvers.minimise`."""
        view, found = start.view, np.empty((self.solver.steps, 4, 4))
        scale, directions = np.array(np.broadcast_to(self.problem.scale, 6)), self.measure.directions
        count = _descend_lines(
            np.array(start.cam_T_obj), self.relative, self.absolute, self.towards, np.array(view.prior), scale,
            self.solver.damping, found, np.array(view.part.box_centre), view.camera.numbers, self.motion.points_obj,
            directions, self.motion.rows(start, directions), self.precision, *self.measure.posteriors,
            self.measure.start,
        )  # fmt: skip
        return tuple(view.at_pose(pose) for pose in found[:count])

    def information(self, at: Estimate, beside: Beside | None = None) -> FloatArray:
        """(6 + k, 6 + k) what the image says at an estimate, without priors, of the pose and of k unknowns beside."""
        return self.problem.information(at, beside).matrix


def contour_level(problem: Problem, solver: Solver) -> ContourLevel | None:
    """The level in this form; None where it is of another one, which `solvers.minimise` takes."""
    motion, (first, *others) = problem.motion, problem.measures
    if others or not isinstance(first.measure, ContourMeasure):
        return None
    if not (isinstance(motion, RigidMotion) and motion.keeps_rows and isinstance(solver, GaussNewton)):
        return None
    if solver.last_px > 0.0:
        return None
    prior = sum_of(problem.priors)
    if prior is None:
        return None
    information = prior.relative, prior.absolute, prior.towards
    return ContourLevel(problem, motion, first.measure, first.precision, *information, solver)


@kernel(
    "i8(f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[::1], f8, f8[:, :, ::1], f8[::1], f8[::1],"
    " f8[:, ::1], f8[:, ::1], f8[:, ::1], f8, f8[:, ::1], f8[::1], f8[::1], f8, f8, i8[::1], f8[:, ::1])"
)
def _descend_lines(
    start: FloatArray, relative: FloatArray, absolute: FloatArray, towards: FloatArray, expected: FloatArray,
    scale: FloatArray, damping: float, found: FloatArray, centre_obj: FloatArray, camera: FloatArray,
    points_obj: FloatArray, directions: FloatArray, rows: FloatArray, precision: float, posteriors: FloatArray,
    variance: FloatArray, certainty: FloatArray, segment_px: float, rate: float, lines: IntArray, points: FloatArray,
) -> int:  # fmt: skip
    """Fill found (k, 4, 4) with the pose after each step, at most k; returns how many there are.

    posteriors to points are `found` to `start` of `contour_regions.newton_steps`; the others: see
    `pose_descent_kernel.descend`.
    """
    count = len(points)
    moved, way = points.copy(), np.zeros(count)
    pulls, strengths = np.empty(count), np.empty(count)
    no_edges, no_trust, no_mixture = np.empty((count, 0)), np.zeros(count), np.array([1.0, 1.0, 0.0])
    pose = start.copy()
    for number in range(len(found)):
        if number > 0:
            for i in range(count):
                x, y, z = points_obj[i, 0], points_obj[i, 1], points_obj[i, 2]
                depth = pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * z + pose[2, 3]
                u = camera[0] * (pose[0, 0] * x + pose[0, 1] * y + pose[0, 2] * z + pose[0, 3]) / depth + camera[2]
                v = camera[1] * (pose[1, 0] * x + pose[1, 1] * y + pose[1, 2] * z + pose[1, 3]) / depth + camera[3]
                moved[i, 0], moved[i, 1] = u, v
                way[i] = (u - points[i, 0]) * directions[i, 0] + (v - points[i, 1]) * directions[i, 1]
        pulls[:] = 0.0
        strengths[:] = 0.0
        newton_steps(
            posteriors, variance, certainty, segment_px, rate, lines, moved, points, directions, pulls, strengths
        )
        for i in range(count):  # `descend` takes off how far the points have come
            pulls[i] += way[i]
            strengths[i] *= precision
        done = descend(
            pose, relative, absolute, towards, expected, scale, damping, 0.0, found[number : number + 1], centre_obj,
            camera, points_obj, points, directions, rows, no_edges, no_edges, no_trust, no_mixture, pulls, strengths,
        )  # fmt: skip
        if done == 0:
            return number
        pose[:] = found[number]
    return len(found)
