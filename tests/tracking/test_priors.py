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
    for step in rng.normal(size=(5, 6)) * ([1e-4] * 3 + [0.01] * 3):
        prior = ControlPointDamping(0.5).bind(PoseVariables(), start)
        moved = view.at_pose(move_pose(view.prior, view.part.box_centre, step))
        motion = moved.control_points - start.control_points
        cost = prior.weight * float(((prior.residual(start) - prior.jacobian @ step) ** 2).sum())
        assert cost == pytest.approx(0.5 * (motion**2).sum(1).mean(), rel=1e-2)
        # Wherever the estimate is: what was done is done, only moving on costs.
        np.testing.assert_array_equal(prior.residual(moved), np.zeros(8))


def test_damping_of_free_control_points_is_in_the_same_units(view: View) -> None:
    start = prior_of(view)
    prior = ControlPointDamping(0.5).bind(ControlPointVariables(), start)
    step = np.tile([3.0, -4.0], 4)
    assert prior.weight * float(((prior.jacobian @ step) ** 2).sum()) == pytest.approx(0.5 * 25.0)


def test_the_rigidity_prior_sees_what_no_rigid_motion_makes(view: View, rng: np.random.Generator) -> None:
    start = prior_of(view)
    prior = RigidityPrior(1.0).bind(ControlPointVariables(), start)
    assert prior.jacobian.shape == (2, 8)
    np.testing.assert_allclose(prior.jacobian @ prior.jacobian.T, np.eye(2), atol=1e-9)
    np.testing.assert_allclose(prior.residual(start), 0.0, atol=1e-3)
    for step in rng.normal(size=(10, 6)) * ([0.002] * 3 + [0.1] * 3):
        moved = view.at_pose(move_pose(view.prior, view.part.box_centre, step))
        moved_px = np.abs(moved.control_points - start.control_points).max()
        assert np.abs(prior.residual(moved)).max() < 0.02 * moved_px
    bent = np.array([[1.0, 0.0], [-1.0, 0.0], [1.0, 0.0], [-1.0, 0.0]])
    residual = prior.residual(view.at_points(start.control_points + bent))
    assert np.linalg.norm(residual) > 0.5
    # The residual is what is still to go: a step that goes there costs nothing.
    np.testing.assert_allclose(prior.jacobian @ -bent.ravel(), residual, atol=1e-3)


@pytest.mark.parametrize("kind", [ControlPointDamping, RigidityPrior])
@pytest.mark.parametrize("weight", [0.0, -1.0, float("inf"), float("nan")])
def test_a_prior_without_weight_is_refused(kind: type, weight: float) -> None:
    with pytest.raises(TrackingError, match=r"^priors\.weight = .*: give a number above 0, or leave the prior out$"):
        kind(weight=weight)
