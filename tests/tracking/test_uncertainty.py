"""The covariance of a pose: what it is made of, that errors are as it says, and where there is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from acp_lab.errors import TrackingError
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose_step import pose_step_between
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.tracking.learning.knowledge import Off
from acp_lab.tracking.method import ACP, ACP_EDGES
from acp_lab.tracking.prediction import LastPosePrediction
from acp_lab.tracking.tracker import Tracker
from acp_lab.tracking.uncertainty import PoseUncertainty, spread
from tests.made_parts import bracket, looking_at
from tests.tracking.rendered import AS_DRAWN, draw, poses, prepared

CAMERA = Camera(width=320, height=256, fx=420.0, fy=425.0, cx=159.5, cy=127.5)
ONE = PoseUncertainty(1.0, 0.0, 0.0, 0.0)


def information() -> np.ndarray:
    rows = np.random.default_rng(3).normal(size=(40, 6))
    return np.asarray(rows.T @ rows)


def test_of_the_image_alone_it_is_the_inverse_of_its_information() -> None:
    covariance = ONE.covariance(information(), np.array([0.0, 0.0, 300.0]), CAMERA, 40.0)
    np.testing.assert_allclose(covariance @ information(), np.eye(6), atol=1e-6)
    twice = replace(ONE, image=2.0).covariance(information(), np.array([0.0, 0.0, 300.0]), CAMERA, 40.0)
    np.testing.assert_allclose(twice, 2.0 * covariance)


def test_outlines_that_lie_off_look_like_another_distance() -> None:
    sure, centre = 1e12 * np.eye(6), np.array([30.0, -40.0, 300.0])
    covariance = replace(ONE, outline_mm=0.1).covariance(sure, centre, CAMERA, 40.0)
    # dz / z = length / radius, along the ray.
    towards = centre / np.linalg.norm(centre)
    np.testing.assert_allclose(
        np.sqrt(towards @ covariance[3:, 3:] @ towards), 0.1 * np.linalg.norm(centre) / 40.0, rtol=1e-6
    )
    across = np.cross(towards, [1.0, 0.0, 0.0])
    assert across @ covariance[3:, 3:] @ across < 1e-9
    assert np.abs(covariance[:3, :3]).max() < 1e-9


def test_turns_and_shifts_are_in_px() -> None:
    sure, centre = 1e12 * np.eye(6), np.array([0.0, 0.0, 420.0])
    covariance = replace(ONE, turn_px=0.5, shift_px=0.2).covariance(sure, centre, CAMERA, 40.0)
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), [0.5 / 40.0] * 3 + [0.2] * 3, rtol=1e-4)
    turn_deg, shift_mm = spread(covariance)
    np.testing.assert_allclose([turn_deg, shift_mm], [np.degrees(0.5 / 40.0), 0.2], rtol=1e-4)


def test_a_direction_that_the_image_says_nothing_of_is_finite_and_large() -> None:
    rows = information()
    rows[2] = rows[:, 2] = 0.0
    covariance = PoseUncertainty().covariance(rows, np.array([0.0, 0.0, 300.0]), CAMERA, 40.0)
    assert np.isfinite(covariance).all()
    assert np.linalg.eigvalsh(covariance).min() > 0.0
    assert covariance[2, 2] > 1e6


def test_all_terms_together_are_those_of_a_slow_twin() -> None:
    config, centre, radius = PoseUncertainty(2.0, 0.1, 0.4, 0.2), np.array([30.0, -40.0, 300.0]), 40.0
    known = information()
    before = known.copy()
    towards, mm_per_px = np.concatenate([np.zeros(3), centre / radius]), 300.0 / CAMERA.fx
    own = 2.0 * np.linalg.inv(known + np.diag(1e-9 * known.diagonal() + 1e-9))
    rim = np.repeat([0.4 * mm_per_px / radius, 0.2 * mm_per_px], 3)
    expected = own + 0.1**2 * np.outer(towards, towards) + np.diag(rim**2)
    covariance = config.covariance(known, centre, CAMERA, radius)
    np.testing.assert_allclose(covariance, expected, rtol=1e-10, atol=1e-15)
    np.testing.assert_array_equal(covariance, covariance.T)
    np.testing.assert_array_equal(known, before)


def test_drawn_sequences_are_about_as_exact_as_it_says() -> None:
    part = bracket()
    truths = poses(part, looking_at(part, np.array([0.8, 0.6, 1.0]), 330.0, 0.3), 12)
    tracker, squared = Tracker(prepared(part), AS_DRAWN), []
    tracker.start(Frame(0, draw([(part, truths[0])], 0, CAMERA), CAMERA), truths[0])
    for index, truth in enumerate(truths[1:], start=1):
        result = tracker.track(Frame(index, draw([(part, truth)], index, CAMERA), CAMERA))
        assert result.covariance is not None
        error = pose_step_between(truth, result.cam_T_obj, part.box_centre)
        squared.append(float(error @ np.linalg.solve(result.covariance, error)))
    # Cleaner than what the terms were fitted to: within, and not by orders of magnitude.
    assert max(squared) < chi2.ppf(0.95, 6)
    assert np.median(squared) > 0.01


def test_a_pose_that_was_not_solved_has_none() -> None:
    part = bracket()
    start = looking_at(part, np.array([0.8, 0.6, 1.0]), 330.0, 0.3)
    frame = Frame(0, draw([(part, start)], 0, CAMERA), CAMERA)
    tracker = Tracker(prepared(part))
    tracker.start(frame, start)
    assert tracker.track(UnreadableFrame(1, CAMERA, "gone")).covariance is None
    for method in (ACP_EDGES, replace(ACP, uncertainty=Off())):
        silent = Tracker(prepared(part), method)
        silent.start(frame, start)
        assert silent.track(replace(frame, index=1)).covariance is None


@pytest.mark.parametrize("name", ["image", "outline_mm", "turn_px", "shift_px"])
@pytest.mark.parametrize("value", [-0.1, float("nan"), float("inf")])
def test_nonsense_is_refused(name: str, value: float) -> None:
    with pytest.raises(TrackingError, match=f"uncertainty.{name}"):
        PoseUncertainty(**{name: value})


def test_it_needs_a_prediction_that_weighs_images() -> None:
    with pytest.raises(TrackingError, match="uncertainty"):
        replace(ACP, prediction=LastPosePrediction(), sight=Off())
