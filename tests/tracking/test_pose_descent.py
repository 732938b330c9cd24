"""The compiled loop of a level against `solvers.minimise`, which computes the same step by step."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from acp_lab.generator.base import GeneratedEdges
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import disturb_pose
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.frame_solver import FrameSolver
from acp_lab.tracking.frame_view import Estimate
from acp_lab.tracking.method import ACP
from acp_lab.tracking.motions import PoseVariables
from acp_lab.tracking.pose_descent import PoseLevel, pose_level
from acp_lab.tracking.priors import ControlPointDamping, MotionPrior, TikhonovPrior
from acp_lab.tracking.schedule import Level
from acp_lab.tracking.solvers import (
    GaussNewton,
    LevenbergMarquardt,
    NormalEquations,
    Problem,
    WeightedMeasure,
    minimise,
)
from acp_lab.tracking.sources.lift import EdgeLifter
from acp_lab.tracking.targets.normals import NormalSearch
from tests.tracking.rendered import MadeSequence

REGION = 4
COARSE, FINE = Level(14, 4.0, 200), Level(5, 1.0, 300)
PRIORS = (ControlPointDamping(), MotionPrior(), TikhonovPrior())
STEPS = GaussNewton(steps=4, damping=0.0, last_px=0.05)


@pytest.fixture
def frame(sequence: MadeSequence) -> Frame:
    (found,) = sequence.frames(1)
    assert isinstance(found, Frame)
    return found


@pytest.fixture
def truth(sequence: MadeSequence) -> FloatArray:
    return sequence.first_pose


class Levels:
    """Problems of one frame near its true pose, with colours that were learnt there."""

    def __init__(self, model: PreparedPart, frame: Frame, truth: FloatArray) -> None:
        self.solver = FrameSolver(model, ACP)
        self._model, self._frame, self._truth = model, frame, truth
        seen = self.solver.look(frame.image, frame.camera, truth, REGION)
        assert seen is not None
        edges = self.solver.source.generate(seen.view.at_pose(truth), 300)
        for target in seen.targets:
            target.bind(edges, seen.view.at_pose(truth), FINE).judge(edges, edges, seen.view.at_pose(truth)).learn(True)

    def problem(
        self, level: Level, linearise: str = "level", search: NormalSearch | None = None
    ) -> tuple[Problem, Estimate]:
        """Of a level that starts beside the truth."""
        part, truth = self._model.part, self._truth
        start = disturb_pose(truth, part.box_centre, 1.0, 1.0, np.random.default_rng(3))
        prior = disturb_pose(truth, part.box_centre, 0.5, 0.5, np.random.default_rng(4))
        information = np.diag([3e4, 3e4, 3e4, 2.0, 2.0, 0.5])
        seen = self.solver.look(self._frame.image, self._frame.camera, prior, REGION, information=information)
        assert seen is not None
        at = seen.view.at_pose(start)
        edges = self.solver.source.generate(at, level.samples)
        variables = PoseVariables(linearise=linearise)  # type: ignore[arg-type]
        motion = variables.motion(self.solver.source, edges, at, EdgeLifter(part, self._model.edges), level.samples)
        targets = [target.bind(edges, at, level) for target in seen.targets]
        if search is not None:
            targets[0] = search.see(seen.view, self.solver.knowledge).bind(edges, at, level)
        priors = [prior for config in PRIORS if (prior := config.bind(variables, at)) is not None]
        measures = [WeightedMeasure(targets[0], 6.0), WeightedMeasure(targets[1], 1.8)]
        return Problem(motion, measures, priors, variables.scale(at.view)), at


def beside(edges: GeneratedEdges, directions: FloatArray) -> FloatArray:
    """Two unknowns beside the pose, for example."""
    return np.stack([edges.weights, directions[:, 0] * edges.points[:, 1]], axis=1)


class _Pull:
    """A prior of its own kind."""

    def equations(self, at: Estimate, total: float) -> NormalEquations:
        return NormalEquations(np.eye(6), np.ones(6))

    def loss(self, at: Estimate, total: float) -> float:
        return 0.0


@pytest.fixture
def levels(model: PreparedPart, frame: Frame, truth: FloatArray) -> Levels:
    return Levels(model, frame, truth)


def compiled(problem: Problem, start: Estimate, solver: GaussNewton = STEPS) -> PoseLevel:
    found = pose_level(problem, start, solver)
    assert found is not None
    return found


@pytest.mark.parametrize("level", [COARSE, FINE], ids=["coarse", "fine"])
@pytest.mark.parametrize("damping", [0.0, 0.05])
def test_every_step_is_that_of_the_general_solver(levels: Levels, level: Level, damping: float) -> None:
    problem, start = levels.problem(level)
    solver = replace(STEPS, damping=damping, last_px=0.0)
    expected = minimise(problem, start, solver)
    found = compiled(problem, start, solver).minimise(start)
    assert len(found) == len(expected) == solver.steps
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one.cam_T_obj, other.cam_T_obj, rtol=0.0, atol=1e-9)
    assert np.abs(found[0].cam_T_obj - start.cam_T_obj).max() > 0.1, "a step that goes nowhere proves nothing"


@pytest.mark.parametrize("last_px", [0.01, 0.2, 2.0])
def test_it_stops_where_the_general_solver_does(levels: Levels, last_px: float) -> None:
    problem, start = levels.problem(FINE)
    solver = replace(STEPS, steps=12, last_px=last_px)
    assert len(compiled(problem, start, solver).minimise(start)) == len(minimise(problem, start, solver)) < 12


def test_what_the_image_says_is_the_same(levels: Levels) -> None:
    problem, start = levels.problem(FINE)
    expected = problem.information(start).matrix
    np.testing.assert_allclose(compiled(problem, start).information(start), expected, rtol=1e-9)
    with_breaks = problem.information(start, beside).matrix
    assert with_breaks.shape == (8, 8)
    np.testing.assert_allclose(with_breaks[:6, :6], expected, rtol=1e-12)
    np.testing.assert_allclose(compiled(problem, start).information(start, beside), with_breaks, rtol=1e-9)


@pytest.mark.parametrize("left_out", range(len(PRIORS) + 1))
def test_each_prior_and_the_colours_count_as_they_do_there(levels: Levels, left_out: int) -> None:
    problem, start = levels.problem(FINE)
    if left_out == len(PRIORS):
        fewer = replace(problem, measures=problem.measures[:1])
    else:
        fewer = replace(problem, priors=[p for k, p in enumerate(problem.priors) if k != left_out])
    (one, *_), (other, *_) = compiled(fewer, start).minimise(start), minimise(fewer, start, STEPS)
    np.testing.assert_allclose(one.cam_T_obj, other.cam_T_obj, rtol=0.0, atol=1e-9)
    (whole, *_) = minimise(problem, start, STEPS)
    assert np.abs(whole.cam_T_obj - other.cam_T_obj).max() > 1e-7, "it counts at all"


def test_a_part_that_would_go_behind_the_camera_stays(levels: Levels) -> None:
    problem, start = levels.problem(FINE)
    behind = start.cam_T_obj.copy()
    behind[2, 3] -= 1000.0
    pulled = replace(compiled(problem, start), absolute=1e9 * np.eye(6), towards=1e9 * np.eye(6), expected=behind)
    assert pulled.minimise(start) == ()
    behind[2, 3] += 1010.0
    assert len(replace(pulled, expected=behind).minimise(start)) > 0


def test_points_behind_the_camera_say_nothing(levels: Levels) -> None:
    problem, start = levels.problem(FINE)
    level = compiled(problem, start)
    turned = level.points_obj.copy()
    behind = np.arange(len(turned)) % 3 == 0
    turned[behind] -= 1e4 * start.cam_T_obj[2, :3]
    silent = replace(level, trust=np.where(behind, 0.0, level.trust), strengths=np.where(behind, 0.0, level.strengths))
    found, expected = replace(level, points_obj=turned).information(start), silent.information(start)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())
    assert np.abs(expected).max() < 0.9 * np.abs(level.information(start)).max()


def test_other_forms_are_left_to_the_general_solver(levels: Levels) -> None:
    problem, start = levels.problem(FINE)
    assert pose_level(problem, start, LevenbergMarquardt()) is None
    assert pose_level(levels.problem(FINE, linearise="step")[0], start, STEPS) is None
    assert pose_level(levels.problem(FINE, search=NormalSearch(bind="step"))[0], start, STEPS) is None
    assert pose_level(replace(problem, measures=problem.measures[::-1]), start, STEPS) is None
    three = [*problem.measures, problem.measures[1]]
    assert pose_level(replace(problem, measures=three), start, STEPS) is None
    assert pose_level(replace(problem, priors=[_Pull()]), start, STEPS) is None
