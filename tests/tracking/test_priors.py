"""What is believed beside the image, in px of the control points."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.cad.part import Part
from acp_lab.errors import TrackingError
from acp_lab.geometry.pose_step import move_pose
from acp_lab.tracking.frame_view import View
from acp_lab.tracking.motions import ControlPointVariables, PoseVariables
from acp_lab.tracking.priors import ControlPointDamping, RigidityPrior
from tests.made_parts import looking_at
from tests.tracking.views import prior_of, view_at


@pytest.fixture
def view(part: Part) -> View:
    return view_at(part, looking_at(part, np.array([0.8, 0.6, 1.0]), 330.0, 0.3))


def test_damping_costs_the_mean_squared_motion_of_the_control_points(view: View, rng: np.random.Generator) -> None:
    start = prior_of(view)
    prior = ControlPointDamping(0.5).bind(PoseVariables(), start)
    for step in rng.normal(size=(5, 6)) * ([1e-4] * 3 + [0.01] * 3):
        moved = view.at_pose(move_pose(view.prior, view.part.box_centre, step))
        motion = moved.control_points - start.control_points
        assert step @ prior.hessian @ step == pytest.approx(0.5 * (motion**2).sum(1).mean(), rel=1e-2)
        # Wherever the estimate is: what was done is done, only moving on costs.
        np.testing.assert_array_equal(prior.gradient(moved), np.zeros(6))
        assert prior.loss(moved) == 0.0


def test_damping_of_free_control_points_is_in_the_same_units(view: View) -> None:
    prior = ControlPointDamping(0.5).bind(ControlPointVariables(), prior_of(view))
    step = np.tile([3.0, -4.0], 4)
    assert step @ prior.hessian @ step == pytest.approx(0.5 * 25.0)
    np.testing.assert_array_equal(prior.gradient(prior_of(view)), np.zeros(8))


def test_the_rigidity_prior_sees_what_no_rigid_motion_makes(view: View, rng: np.random.Generator) -> None:
    start = prior_of(view)
    prior = RigidityPrior(3.0).bind(ControlPointVariables(), start)
    # Two directions of eight, each with the weight.
    np.testing.assert_allclose(np.linalg.eigvalsh(prior.hessian), [0.0] * 6 + [3.0] * 2, atol=1e-9)
    assert prior.loss(start) == pytest.approx(0.0, abs=1e-6)
    for step in rng.normal(size=(10, 6)) * ([0.002] * 3 + [0.1] * 3):
        moved = view.at_pose(move_pose(view.prior, view.part.box_centre, step))
        moved_px = np.abs(moved.control_points - start.control_points).max()
        assert np.sqrt(2.0 * prior.loss(moved) / 3.0) < 0.02 * moved_px
    bend = np.array([[1.0, 0.0], [-1.0, 0.0], [1.0, 0.0], [-1.0, 0.0]])
    bent = view.at_points(start.control_points + bend)
    assert prior.loss(bent) > 0.5 * 3.0 * 0.5**2
    # Going back is what is asked for: there the gradient ends, and on the way it is that of the loss.
    np.testing.assert_allclose(prior.gradient(bent), prior.hessian @ -bend.ravel(), atol=1e-3)
    for k in range(8):
        nudge = 1e-4 * np.eye(8)[k].reshape(4, 2)
        ahead, behind = (prior.loss(view.at_points(bent.control_points + side * nudge)) for side in (1.0, -1.0))
        assert (ahead - behind) / 2e-4 == pytest.approx(-prior.gradient(bent)[k], abs=1e-6)


@pytest.mark.parametrize("kind", [ControlPointDamping, RigidityPrior])
@pytest.mark.parametrize("weight", [0.0, -1.0, float("inf"), float("nan")])
def test_a_prior_without_weight_is_refused(kind: type, weight: float) -> None:
    with pytest.raises(TrackingError, match=r"^priors\.weight = .*: give a number above 0, or leave the prior out$"):
        kind(weight=weight)
