"""How far a start pose is believed, beside what the image shows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from acp_lab.cad.part import Part
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose_step import move_pose, pose_step_between
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.frame_solver import FrameSolver
from acp_lab.tracking.frame_view import View
from acp_lab.tracking.learning.knowledge import Matches
from acp_lab.tracking.method import ACP
from acp_lab.tracking.stopwatch import Stopwatch
from acp_lab.tracking.weighed_start import image_covariance, weighed_start
from tests.made_parts import looking_at
from tests.tracking.rendered import CAMERA, draw

BIAS_MM = 0.25


@pytest.fixture
def found(part: Part, model: PreparedPart) -> tuple[View, FloatArray, Matches]:
    """View, pose and matches of a solved frame."""
    truth = looking_at(part, np.array([0.8, 0.6, 1.0]), 330.0, 0.3)
    solver, frame = FrameSolver(model, ACP), Frame(0, draw([(part, truth)]), CAMERA)
    seen = solver.look(frame.image, CAMERA, truth, 4)
    assert seen is not None
    solution = solver.solve(seen, seen.view.at_pose(truth), Stopwatch())
    assert solution is not None
    assert solution.judgement.matches is not None
    return seen.view, solution.cam_T_obj, solution.judgement.matches


Weigh = Callable[[FloatArray], FloatArray]


@pytest.fixture
def weighed(part: Part, found: tuple[View, FloatArray, Matches]) -> Weigh:
    """From a start's error (6,) deg and mm beside the pose that the image shows, what is left of it afterwards."""
    view, pose, matches = found

    def weigh(error: FloatArray) -> FloatArray:
        step = np.concatenate([np.radians(error[:3]), error[3:]])
        start = move_pose(pose, part.box_centre, step)
        fused = weighed_start(replace(view, prior=start), pose, matches, BIAS_MM)
        left = pose_step_between(pose, fused, part.box_centre)
        return np.concatenate([np.degrees(left[:3]), left[3:]])

    return weigh


def test_the_image_is_surest_across_the_line_of_sight(found: tuple[View, FloatArray, Matches]) -> None:
    _, _, matches = found
    deviations = np.sqrt(np.diagonal(image_covariance(matches, BIAS_MM)))
    assert deviations[5] > 5.0 * deviations[3:5].max()
    # The bias is what makes the distance unsure, and grows with it.
    assert deviations[5] > 4.0 * np.sqrt(image_covariance(matches, 0.0)[5, 5])
    assert np.sqrt(image_covariance(matches, 2.0 * BIAS_MM)[5, 5]) == pytest.approx(2.0 * deviations[5], rel=0.1)


def test_a_start_that_is_exact_where_it_can_be_checked_keeps_its_distance(weighed: Weigh) -> None:
    left = weighed(np.array([0.0, 0.0, 0.0, 0.02, -0.01, 2.0]))
    assert left[5] > 1.6
    assert np.abs(left[3:5]).max() < 0.1


def test_a_start_that_is_wrong_where_it_can_be_checked_loses_its_distance(weighed: Weigh) -> None:
    left = weighed(np.array([6.0, -5.0, 6.0, 20.0, -18.0, 2.0]))
    assert abs(left[5]) < 0.3
    far = weighed(np.array([6.0, -5.0, 6.0, 5.0, -4.0, 20.0]))
    assert abs(far[5]) < 4.0
    for each in (left, far):
        assert np.abs(each[:3]).max() < 0.5
        assert np.abs(each[3:5]).max() < 0.1


def test_the_worse_the_start_the_nearer_the_result_to_the_image(weighed: Weigh) -> None:
    shares = []
    for error in (0.1, 1.0, 4.0, 10.0):
        left = weighed(np.array([0.0, 0.0, error, error, -error, 8.0]))
        shares.append(left[5] / 8.0)
    assert shares == sorted(shares, reverse=True)
    assert shares[0] > 0.8
    assert shares[-1] < 0.25


def test_without_a_bias_the_image_is_believed(part: Part, found: tuple[View, FloatArray, Matches]) -> None:
    view, pose, matches = found
    start = move_pose(pose, part.box_centre, np.array([0.02, 0.0, 0.01, 2.0, 1.0, 6.0]))
    fused = weighed_start(replace(view, prior=start), pose, matches, 1e-6)
    np.testing.assert_allclose(fused, pose, atol=0.25)


def test_a_start_beyond_all_errors_is_left_to_the_image(part: Part, found: tuple[View, FloatArray, Matches]) -> None:
    view, pose, matches = found
    start = move_pose(pose, part.box_centre, np.array([0.0, 0.0, 0.0, 1e5, 0.0, 0.0]))
    np.testing.assert_array_equal(weighed_start(replace(view, prior=start), pose, matches, BIAS_MM), pose)


def test_a_pose_that_looks_alike_does_not_move_a_start_that_the_frame_agrees_with(
    part: Part, found: tuple[View, FloatArray, Matches]
) -> None:
    view, pose, matches = found
    start = move_pose(pose, part.box_centre, np.array([0.06, -0.04, 0.0, 4.0, -3.0, 5.0]))
    off = [
        np.linalg.norm(pose_step_between(start, weighed, part.box_centre)[3:])
        for agreement in (0.95, 0.85, 0.3, None)
        for weighed in [weighed_start(replace(view, prior=start), pose, matches, BIAS_MM, agreement)]
    ]
    assert off[0] < 0.1
    assert off[1] < 0.3
    # What the frame does not agree with is no pose of it.
    assert off[2] > 5.0
    assert off[3] > 5.0


def test_the_better_the_agreement_the_more_of_the_start_is_kept(
    part: Part, found: tuple[View, FloatArray, Matches]
) -> None:
    view, pose, matches = found
    start = move_pose(pose, part.box_centre, np.array([0.004, 0.004, 0.0, 0.3, -0.2, 3.0]))
    farther_mm = [
        float(pose_step_between(pose, weighed, part.box_centre)[5])
        for agreement in (1.0, 0.85, 0.65)
        for weighed in [weighed_start(replace(view, prior=start), pose, matches, BIAS_MM, agreement)]
    ]
    assert farther_mm == sorted(farther_mm, reverse=True)
    assert farther_mm[0] > farther_mm[2] + 0.1
