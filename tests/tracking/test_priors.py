"""What is believed beside the image: in px of the control points, or as sure as the prediction is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from acp_lab.cad.part import Part
from acp_lab.errors import TrackingError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose_step import move_pose, pose_step_between
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.frame_solver import FrameSolver
from acp_lab.tracking.frame_view import Estimate, View
from acp_lab.tracking.method import ACP
from acp_lab.tracking.motions import ControlPointVariables, PoseVariables
from acp_lab.tracking.priors import ControlPointDamping, MotionPrior, RigidityPrior
from acp_lab.tracking.stopwatch import Stopwatch
from tests.made_parts import looking_at
from tests.tracking.rendered import MadeSequence
from tests.tracking.views import prior_of, view_at

# Information of a frame, per squared px; what these priors weigh is relative to it.
TOTAL = 900.0


@pytest.fixture
def view(part: Part) -> View:
    return view_at(part, looking_at(part, np.array([0.8, 0.6, 1.0]), 330.0, 0.3))


def test_damping_costs_the_mean_squared_motion_of_the_control_points(view: View, rng: np.random.Generator) -> None:
    start = prior_of(view)
    prior = ControlPointDamping(0.5).bind(PoseVariables(), start)
    for step in rng.normal(size=(5, 6)) * ([1e-4] * 3 + [0.01] * 3):
        moved = view.at_pose(move_pose(view.prior, view.part.box_centre, step))
        motion = moved.control_points - start.control_points
        equations = prior.equations(moved, TOTAL)
        assert step @ equations.hessian @ step == pytest.approx(0.5 * (motion**2).sum(1).mean(), rel=1e-2)
        # Wherever the estimate is: what was done is done, only moving on costs.
        np.testing.assert_array_equal(equations.downhill, np.zeros(6))
        assert prior.loss(moved, TOTAL) == 0.0


def test_damping_of_free_control_points_is_in_the_same_units(view: View) -> None:
    start = prior_of(view)
    equations = ControlPointDamping(0.5).bind(ControlPointVariables(), start).equations(start, TOTAL)
    step = np.tile([3.0, -4.0], 4)
    assert step @ equations.hessian @ step == pytest.approx(0.5 * 25.0)
    np.testing.assert_array_equal(equations.downhill, np.zeros(8))


def test_the_rigidity_prior_sees_what_no_rigid_motion_makes(view: View, rng: np.random.Generator) -> None:
    start = prior_of(view)
    prior = RigidityPrior(3.0).bind(ControlPointVariables(), start)
    # Two directions of eight, each with the weight.
    hessian = prior.equations(start, TOTAL).hessian
    np.testing.assert_allclose(np.linalg.eigvalsh(hessian), [0.0] * 6 + [3.0] * 2, atol=1e-9)
    assert prior.loss(start, TOTAL) == pytest.approx(0.0, abs=1e-6)
    for step in rng.normal(size=(10, 6)) * ([0.002] * 3 + [0.1] * 3):
        moved = view.at_pose(move_pose(view.prior, view.part.box_centre, step))
        moved_px = np.abs(moved.control_points - start.control_points).max()
        assert np.sqrt(2.0 * prior.loss(moved, TOTAL) / 3.0) < 0.02 * moved_px
    bend = np.array([[1.0, 0.0], [-1.0, 0.0], [1.0, 0.0], [-1.0, 0.0]])
    bent = view.at_points(start.control_points + bend)
    assert prior.loss(bent, TOTAL) > 0.5 * 3.0 * 0.5**2
    # Going back is what is asked for: there the gradient ends, and on the way it is that of the loss.
    gradient = prior.equations(bent, TOTAL).downhill
    np.testing.assert_allclose(gradient, hessian @ -bend.ravel(), atol=1e-3)
    for k in range(8):
        nudge = 1e-4 * np.eye(8)[k].reshape(4, 2)
        ahead, behind = (prior.loss(view.at_points(bent.control_points + side * nudge), TOTAL) for side in (1.0, -1.0))
        assert (ahead - behind) / 2e-4 == pytest.approx(-gradient[k], abs=1e-6)


# ---- the motion prior ----------------------------------------------------------------------------------------

VARIABLES = [PoseVariables(), ControlPointVariables()]


def information(rng: np.random.Generator) -> FloatArray:
    """(6, 6) of about 3 degrees and 5 mm, not diagonal."""
    mixed = (np.eye(6) + 0.3 * rng.standard_normal((6, 6))) / np.repeat([0.05, 5.0], 3)
    found: FloatArray = mixed.T @ mixed
    return found


def stepped(at: Estimate, variables: ControlPointVariables | PoseVariables, step: FloatArray) -> Estimate:
    """An estimate after a step of the variables."""
    if isinstance(variables, PoseVariables):
        return at.view.at_pose(move_pose(at.cam_T_obj, at.view.part.box_centre, step))
    return at.view.at_points(at.control_points + step.reshape(4, 2))


@pytest.mark.parametrize("variables", VARIABLES, ids=["pose", "control points"])
def test_the_motion_priors_equations_are_those_of_its_loss(
    view: View, rng: np.random.Generator, variables: ControlPointVariables | PoseVariables
) -> None:
    view = replace(view, prior_information=information(rng))
    for weight, step in zip(
        (1.0, 1.0, 0.5, 0.2, 0.2), rng.normal(size=(5, 6)) * np.repeat([0.01, 1.0], 3), strict=True
    ):
        pose = move_pose(view.prior, view.part.box_centre, step)
        at = view.at_pose(pose)
        if isinstance(variables, ControlPointVariables):
            at = view.at_points(at.control_points)
        prior = MotionPrior(weight).bind(variables, at)
        assert prior is not None
        expected = weight * 0.5 * step @ view.prior_information @ step / TOTAL
        assert prior.loss(at, TOTAL) == pytest.approx(expected, rel=1e-4)
        equations = prior.equations(at, TOTAL)
        slopes = []
        for nudge in np.eye(variables.count):
            size = 1e-5 if isinstance(variables, PoseVariables) else 1e-3
            ahead, behind = (prior.loss(stepped(at, variables, s * size * nudge), TOTAL) for s in (1.0, -1.0))
            slopes.append((ahead - behind) / (2.0 * size))
        # Turns do not add up quite, and PnP is not quite least squares.
        slack = 0.03 * np.abs(equations.downhill).max()
        np.testing.assert_allclose(slopes, -equations.downhill, atol=slack)
        # One undamped step along the rigid motions is back at the prediction.
        back = np.linalg.pinv(equations.hessian, rcond=1e-9) @ equations.downhill
        again = stepped(at, variables, back).cam_T_obj
        off = pose_step_between(view.prior, again, view.part.box_centre)
        assert np.abs(off / np.repeat([0.01, 1.0], 3)).max() < 0.1


def test_a_prediction_that_does_not_know_how_sure_it_is_is_no_prior(view: View) -> None:
    assert view.prior_information is None
    for variables in VARIABLES:
        assert MotionPrior().bind(variables, prior_of(view)) is None


@pytest.mark.parametrize("variables", VARIABLES, ids=["pose", "control points"])
def test_the_surer_the_prediction_the_less_the_image_says(
    part: Part, model: PreparedPart, sequence: MadeSequence, variables: ControlPointVariables | PoseVariables
) -> None:
    (frame,) = sequence.frames(1)
    assert isinstance(frame, Frame)
    truth = sequence.first_pose
    predicted = move_pose(truth, part.box_centre, np.array([0.01, -0.01, 0.0, 0.8, -0.5, 0.0]))
    solver = FrameSolver(model, replace(ACP, variables=variables, priors=(MotionPrior(1.0), ControlPointDamping(1e-9))))

    def solved(sure: float | None) -> FloatArray:
        told = None if sure is None else sure * np.diag(np.repeat([0.01, 1.0], 3) ** -2)
        seen = solver.look(frame.image, frame.camera, predicted, 4, information=told)
        assert seen is not None
        found = solver.solve(seen, seen.view.at_pose(predicted), Stopwatch())
        assert found is not None
        return found.cam_T_obj

    alone = solved(None)
    ways = [pose_step_between(predicted, solved(sure), part.box_centre) for sure in (1e-7, 1.0, 1e2, 1e4, 1e9)]
    np.testing.assert_allclose(ways[0], pose_step_between(predicted, alone, part.box_centre), atol=1e-4)
    lengths = np.linalg.norm(np.array(ways) / np.repeat([0.01, 1.0], 3), axis=1)
    assert (np.diff(lengths) < -0.1 * lengths[:-1]).all()
    assert lengths[0] > 1.0
    assert lengths[-1] < 1e-4


@pytest.mark.parametrize("kind", [ControlPointDamping, MotionPrior, RigidityPrior])
@pytest.mark.parametrize("weight", [0.0, -1.0, float("inf"), float("nan")])
def test_a_prior_without_weight_is_refused(kind: type, weight: float) -> None:
    with pytest.raises(TrackingError, match=r"^priors\.weight = .*: give a number above 0, or leave the prior out$"):
        kind(weight=weight)
