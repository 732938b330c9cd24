"""Gauss-Newton on a pose as one call of machine code: the inner loop of methods that linearise once per level.

`solvers.minimise` says what is computed, step by step and for any method; this computes the same, to rounding, for
what the default method is made of: a rigid motion whose rows stay those of the level's start, edge points with image
edges to choose from, beside them lines that pull with a fixed strength, and priors that know the predicted pose. All of
it lies in a few arrays, so that no step has to go through Python.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acp_lab.generator.base import GeneratedEdges
from acp_lab.geometry.arrays import FloatArray
from acp_lab.tracking.contour_descent import ContourLevel, contour_level
from acp_lab.tracking.frame_view import Estimate
from acp_lab.tracking.motions import Beside, RigidMotion
from acp_lab.tracking.pose_descent_kernel import add_up_pose, descend
from acp_lab.tracking.priors import sum_of
from acp_lab.tracking.solvers import GaussNewton, Problem, Solver
from acp_lab.tracking.targets.normals import NormalMeasure
from acp_lab.tracking.targets.regions import RegionMeasure


@dataclass(frozen=True, eq=False)
class PoseLevel:
    """One level of a method that varies a pose, in arrays.

    Attributes:
        edges: its n edge points.
        view_numbers: (4,) fx, fy, cx, cy of the camera, px; centre_obj: (3,) mm, the part's.
        points_obj: (n, 3) mm; points: (n, 2) px, where they are at the level's start; directions: (n, 2) unit;
            rows: (n, 6), how they move along these by a pose step.
        targets, scores: (n, m) of the image edges, see `targets.normals`; trust: (n,) of the points.
        mixture: (3,) sigma px, outlier mass, precision of the image edges.
        pulls, strengths: (n,) px along the directions and information per squared px, of fixed lines.
        relative, absolute: (6, 6) information of the priors: relative to what the image says in all, and as it is;
            towards: (6, 6) the share of the latter that holds at `expected`, (4, 4).
        scale: (6,) of each variable per px; solver: how it goes down.
    """

    edges: GeneratedEdges
    view_numbers: FloatArray
    centre_obj: FloatArray
    points_obj: FloatArray
    points: FloatArray
    directions: FloatArray
    rows: FloatArray
    targets: FloatArray
    scores: FloatArray
    trust: FloatArray
    mixture: FloatArray
    pulls: FloatArray
    strengths: FloatArray
    relative: FloatArray
    absolute: FloatArray
    towards: FloatArray
    expected: FloatArray
    scale: FloatArray
    solver: GaussNewton

    def minimise(self, start: Estimate) -> tuple[Estimate, ...]:
        """See `solvers.minimise`."""
        found = np.empty((self.solver.steps, 4, 4))
        count = descend(
            np.array(start.cam_T_obj), self.relative, self.absolute, self.towards, self.expected, self.scale,
            self.solver.damping, self.solver.last_px, found, *self._with(self.rows),
        )  # fmt: skip
        return tuple(start.view.at_pose(pose) for pose in found[:count])

    def information(self, at: Estimate, beside: Beside | None = None) -> FloatArray:
        """(6 + k, 6 + k) what the image says at an estimate, without priors, of the pose and of k unknowns beside."""
        rows = self.rows
        if beside is not None:
            rows = np.concatenate((rows, beside(self.edges, self.directions)), axis=1)
        count = rows.shape[1]
        matrix, vector = np.empty((count, count)), np.empty(count)
        add_up_pose(np.array(at.cam_T_obj), matrix, vector, *self._with(rows))
        return matrix

    def _with(self, rows: FloatArray) -> tuple[FloatArray, ...]:
        return (
            self.centre_obj, self.view_numbers, self.points_obj, self.points, self.directions, rows,
            self.targets, self.scores, self.trust, self.mixture, self.pulls, self.strengths,
        )  # fmt: skip


def pose_level(problem: Problem, start: Estimate, solver: Solver) -> PoseLevel | ContourLevel | None:
    """The level as arrays; None where it is of another form, which `solvers.minimise` takes."""
    motion = problem.motion
    if not (isinstance(solver, GaussNewton) and isinstance(motion, RigidMotion) and motion.keeps_rows):
        return None
    first, *others = problem.measures
    edges = first.measure
    if not isinstance(edges, NormalMeasure):
        return contour_level(problem, solver)
    pulls, strengths = np.zeros(len(edges.points)), np.zeros(len(edges.points))
    for other in others:
        lines = other.measure
        # Lines along other directions than the edge points' have rows of their own.
        if not isinstance(lines, RegionMeasure) or lines.directions is not edges.normals:
            return None
        pulls, strengths = lines.residuals, other.precision * lines.weights
    if len(others) > 1:
        return None
    prior = sum_of(problem.priors)
    if prior is None:
        return None
    view = start.view
    return PoseLevel(
        edges.edges,
        view.camera.numbers,
        np.array(view.part.box_centre),
        motion.points_obj,
        edges.points,
        edges.normals,
        motion.rows(start, edges.normals),
        edges.targets,
        edges.scores,
        edges.trust,
        np.array([edges.sigma_px, edges.outlier, first.precision]),
        pulls,
        strengths,
        prior.relative,
        prior.absolute,
        prior.towards,
        np.array(view.prior),
        np.zeros(6) + problem.scale,
        solver,
    )
