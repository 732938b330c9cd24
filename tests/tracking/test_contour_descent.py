"""The compiled loop of a level of the region tracker against `solvers.minimise`, which computes the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from acp_lab.generator.base import GeneratedEdges
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose import disturb_pose
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame
from acp_lab.tracking import frame_solver
from acp_lab.tracking.contour_descent import ContourLevel
from acp_lab.tracking.frame_solver import FrameSolver
from acp_lab.tracking.frame_view import Estimate
from acp_lab.tracking.method import REGION
from acp_lab.tracking.motions import PoseVariables
from acp_lab.tracking.pose_descent import pose_level
from acp_lab.tracking.priors import ControlPointDamping, MotionPrior, TikhonovPrior
from acp_lab.tracking.schedule import Level
from acp_lab.tracking.solvers import GaussNewton, LevenbergMarquardt, Problem, WeightedMeasure, minimise
from acp_lab.tracking.sources.lift import EdgeLifter
from acp_lab.tracking.tracker import Tracker
from tests.tracking.rendered import MadeSequence

VIEW = 4
COARSE, FINE = Level(38, 5.0), Level(10, 1.5)
STEPS = GaussNewton(steps=4, damping=0.0)


@pytest.fixture
def frame(sequence: MadeSequence) -> Frame:
    (found,) = sequence.frames(1)
    assert isinstance(found, Frame)
    return found


class Levels:
    """Problems of one frame beside its true pose, with colours that were learnt there."""

    def __init__(self, model: PreparedPart, frame: Frame, truth: FloatArray) -> None:
        self._model, self._frame, self._truth = model, frame, truth
        self._solver = FrameSolver(model, REGION)
        seen = self._solver.look(frame.image, frame.camera, truth, VIEW)
        assert seen is not None
        at = seen.view.at_pose(truth)
        edges = self._solver.source.generate(at, 300)
        seen.targets[0].bind(edges, at, FINE).judge(edges, edges, at).learn(True)

    def problem(self, level: Level, linearise: str = "level") -> tuple[Problem, Estimate]:
        part, truth = self._model.part, self._truth
        start = disturb_pose(truth, part.box_centre, 1.0, 1.0, np.random.default_rng(3))
        prior = disturb_pose(truth, part.box_centre, 0.5, 0.5, np.random.default_rng(4))
        information = np.diag([3e4, 3e4, 3e4, 2.0, 2.0, 0.5])
        seen = self._solver.look(self._frame.image, self._frame.camera, prior, VIEW, information=information)
        assert seen is not None
        at = seen.view.at_pose(start)
        edges = self._solver.source.generate(at, level.samples)
        variables = PoseVariables(linearise=linearise)  # type: ignore[arg-type]
        motion = variables.motion(self._solver.source, edges, at, EdgeLifter(part, self._model.edges), level.samples)
        measure = seen.targets[0].bind(edges, at, level)
        configs = (TikhonovPrior(), ControlPointDamping(), MotionPrior())
        priors = [prior for config in configs if (prior := config.bind(variables, at)) is not None]
        return Problem(motion, [WeightedMeasure(measure, 0.3)], priors, variables.scale(at.view)), at


@pytest.fixture
def levels(model: PreparedPart, frame: Frame, sequence: MadeSequence) -> Levels:
    return Levels(model, frame, sequence.first_pose)


def compiled(problem: Problem, start: Estimate, solver: GaussNewton = STEPS) -> ContourLevel:
    found = pose_level(problem, start, solver)
    assert isinstance(found, ContourLevel)
    return found


@pytest.mark.parametrize("level", [COARSE, FINE], ids=["coarse", "fine"])
@pytest.mark.parametrize("damping", [0.0, 0.05])
@pytest.mark.parametrize("left_out", [None, 0, 1, 2])
def test_every_step_is_that_of_the_general_solver(
    levels: Levels, level: Level, damping: float, left_out: int | None
) -> None:
    problem, start = levels.problem(level)
    problem = replace(problem, priors=[prior for k, prior in enumerate(problem.priors) if k != left_out])
    solver = replace(STEPS, damping=damping)
    expected = minimise(problem, start, solver)
    found = compiled(problem, start, solver).minimise(start)
    assert len(found) == len(expected) == solver.steps
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one.cam_T_obj, other.cam_T_obj, rtol=0.0, atol=1e-9)
    # The first step goes to the mean, the next ones by the slope: both have to go somewhere to prove anything.
    assert np.abs(found[0].cam_T_obj - start.cam_T_obj).max() > 0.05
    assert np.abs(found[1].cam_T_obj - found[0].cam_T_obj).max() > 1e-3


def test_what_the_image_says_is_the_same(levels: Levels) -> None:
    problem, start = levels.problem(FINE)
    np.testing.assert_array_equal(compiled(problem, start).information(start), problem.information(start).matrix)

    def beside(edges: GeneratedEdges, directions: FloatArray) -> FloatArray:
        return directions * edges.points

    found = compiled(problem, start).information(start, beside)
    assert found.shape == (8, 8)
    np.testing.assert_array_equal(found, problem.information(start, beside).matrix)


def test_a_part_that_would_go_behind_the_camera_stays(levels: Levels) -> None:
    problem, start = levels.problem(FINE)
    behind = start.cam_T_obj.copy()
    behind[2, 3] -= 1000.0
    level = compiled(problem, start)
    there = Estimate(replace(start.view, prior=behind), pose=start.cam_T_obj)
    pulled = replace(level, absolute=1e9 * np.eye(6), towards=1e9 * np.eye(6))
    assert pulled.minimise(there) == ()
    assert len(pulled.minimise(start)) == STEPS.steps


def test_other_forms_are_left_to_the_general_solver(levels: Levels) -> None:
    problem, start = levels.problem(FINE)
    assert pose_level(problem, start, LevenbergMarquardt()) is None
    assert pose_level(problem, start, replace(STEPS, last_px=0.1)) is None
    assert pose_level(levels.problem(FINE, linearise="step")[0], start, STEPS) is None
    assert pose_level(replace(problem, measures=[*problem.measures] * 2), start, STEPS) is None


def test_the_whole_method_goes_the_same_way(
    model: PreparedPart, sequence: MadeSequence, monkeypatch: pytest.MonkeyPatch
) -> None:
    def poses() -> list[FloatArray]:
        tracker = Tracker(model, REGION)
        first, *others = sequence.frames(5)
        assert isinstance(first, Frame)
        tracker.start(first, sequence.first_pose)
        return [tracker.track(frame).cam_T_obj for frame in others]

    found = poses()
    monkeypatch.setattr(frame_solver, "pose_level", lambda *_: None)
    for one, other in zip(found, poses(), strict=True):
        np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-8)
    assert np.abs(found[-1] - sequence.first_pose).max() > 0.1
