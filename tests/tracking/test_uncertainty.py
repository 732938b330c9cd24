"""The covariance of a pose: what it is made of, that errors are as it says, and where there is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from acp_lab.cad.models_info import Symmetries
from acp_lab.errors import TrackingError
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import transform
from acp_lab.geometry.pose_step import move_pose, pose_step_between
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.tracking.learning.knowledge import Off
from acp_lab.tracking.method import ACP, ACP_EDGES
from acp_lab.tracking.prediction import LastPosePrediction
from acp_lab.tracking.tracker import Tracker
from acp_lab.tracking.uncertainty import ExpectedError, PoseUncertainty, spread
from tests.made_parts import bracket, looking_at
from tests.tracking.rendered import AS_DRAWN, draw, poses, prepared

CAMERA = Camera(width=320, height=256, fx=420.0, fy=425.0, cx=159.5, cy=127.5)
ONE = PoseUncertainty(1.0, 0.0, 0.0, 0.0)


def information() -> np.ndarray:
    rows = np.random.default_rng(3).normal(size=(40, 8))
    return np.asarray(rows.T @ rows)


def test_of_known_breaks_it_is_the_inverse_of_the_image_s_information() -> None:
    covariance = ONE.covariance(information(), 0.7)
    np.testing.assert_allclose(covariance @ information()[:6, :6], np.eye(6), atol=1e-6)
    twice = replace(ONE, image=2.0).covariance(information(), 0.7)
    np.testing.assert_allclose(twice, 2.0 * covariance, rtol=1e-6)


def test_of_unknown_breaks_it_is_what_is_left_of_the_inverse_of_all() -> None:
    covariance = PoseUncertainty(1.0, 1e4, 1e4, 0.0).covariance(information(), 0.7)
    np.testing.assert_allclose(covariance, np.linalg.inv(information())[:6, :6], rtol=1e-5)


@pytest.mark.parametrize(("breaks", "column"), [({"outline_mm": 0.4}, 6), ({"crease_mm": 0.4}, 7)])
def test_a_break_moves_the_pose_by_what_looks_like_it(breaks: dict[str, float], column: int) -> None:
    """The pose gives way by gain x break, and what the image says of the break itself narrows that."""
    image = information()
    pull = image[:6, column]
    gain = np.linalg.solve(image[:6, :6], pull)
    left = image[column, column] - pull @ gain
    covariance = replace(ONE, **breaks).covariance(image, 0.7)
    known = np.linalg.inv(image[:6, :6])
    expected = known + np.outer(gain, gain) / (left + 1.0 / 0.4**2)
    np.testing.assert_allclose(covariance, expected, rtol=1e-5, atol=1e-9)


def test_whole_numbers_will_do() -> None:
    found = PoseUncertainty(image=2, outline_mm=1, crease_mm=3, shift_px=0).covariance(information(), 1)
    expected = PoseUncertainty(2.0, 1.0, 3.0, 0.0).covariance(information(), 1.0)
    np.testing.assert_array_equal(found, expected)


def test_shifts_are_in_px() -> None:
    covariance = replace(ONE, shift_px=0.2).covariance(1e12 * np.eye(8), 0.7)
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), [1e-6] * 3 + [0.14] * 3, rtol=1e-4)
    turn_deg, shift_mm = spread(covariance)
    np.testing.assert_allclose([turn_deg, shift_mm], [np.degrees(1e-6), 0.14], rtol=1e-4)


def test_a_direction_that_the_image_says_nothing_of_is_finite_and_large() -> None:
    rows = information()
    rows[2] = rows[:, 2] = 0.0
    covariance = PoseUncertainty().covariance(rows, 0.7)
    assert np.isfinite(covariance).all()
    assert np.linalg.eigvalsh(covariance).min() > 0.0
    assert covariance[2, 2] > 1e6


def test_edges_of_no_known_sample_leave_the_breaks_out() -> None:
    rows = information()
    rows[6:] = rows[:, 6:] = 0.0
    covariance = PoseUncertainty(1.0, 0.3, 1.0, 0.0).covariance(rows, 0.7)
    np.testing.assert_allclose(covariance, np.linalg.inv(rows[:6, :6]), rtol=1e-5)


def test_all_terms_together_are_those_of_a_slow_twin() -> None:
    config, known = PoseUncertainty(2.0, 0.1, 0.4, 0.2), information()
    before = known.copy()
    own = known + np.diag(1e-9 * known.diagonal() + 1e-9)
    prior = np.diag([0.0] * 6 + [1.0 / 0.1**2, 1.0 / 0.4**2])
    expected = np.linalg.inv(own / 2.0 + prior)[:6, :6] + np.diag([0.0] * 3 + [(0.2 * 0.7) ** 2] * 3)
    covariance = config.covariance(known, 0.7)
    np.testing.assert_allclose(covariance, expected, rtol=1e-9, atol=1e-15)
    np.testing.assert_array_equal(covariance, covariance.T)
    np.testing.assert_array_equal(known, before)


def test_the_expected_error_is_that_of_poses_drawn_from_the_covariance() -> None:
    part, rng = bracket(), np.random.default_rng(8)
    pose = looking_at(part, np.array([0.8, 0.6, 1.0]), 330.0, 0.3)
    root = rng.normal(size=(6, 6)) * np.repeat([2e-3, 0.3], 3)[:, None]
    covariance = root @ root.T
    squared = []
    for step in rng.multivariate_normal(np.zeros(6), covariance, 4000):
        moved = transform(move_pose(pose, part.box_centre, step), part.vertices)
        squared.append(((moved - transform(pose, part.vertices)) ** 2).sum(1).mean())
    expected = ExpectedError(part).rms_mm(covariance, pose)
    assert expected == pytest.approx(np.sqrt(np.mean(squared)), rel=0.05)


def test_of_a_round_part_turns_about_its_axis_are_no_error() -> None:
    part = bracket()
    offset, axis = part.box_centre + np.array([5.0, 0.0, 0.0]), np.array([0.0, 0.0, 2.0])
    round_part = replace(part, symmetries=Symmetries(np.zeros((0, 4, 4)), ((tuple(axis), tuple(offset)),)))
    pose = looking_at(part, np.array([0.8, 0.6, 1.0]), 330.0, 0.3)
    turn = pose[:3, :3] @ axis
    about = np.concatenate([turn, np.cross(turn, -(pose[:3, :3] @ (offset - part.box_centre)))])
    free, rest = np.outer(about, about), np.diag([1e-6] * 3 + [0.01] * 3)
    # That step keeps the axis where it is.
    moved = move_pose(pose, part.box_centre, 1e-4 * about)
    for point in (offset, offset + axis):
        np.testing.assert_allclose(transform(moved, point), transform(pose, point), atol=1e-4)
    assert ExpectedError(round_part).rms_mm(free, pose) == pytest.approx(0.0, abs=1e-4)
    assert ExpectedError(part).rms_mm(free, pose) > 10.0
    of_rest = [ExpectedError(one).rms_mm(rest, pose) for one in (round_part, part)]
    assert 0.5 * of_rest[1] < of_rest[0] < of_rest[1]


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


def test_an_image_without_noise_is_refused() -> None:
    with pytest.raises(TrackingError, match=r"uncertainty\.image = 0"):
        PoseUncertainty(image=0.0)


@pytest.mark.parametrize("name", ["image", "outline_mm", "crease_mm", "shift_px"])
@pytest.mark.parametrize("value", [-0.1, float("nan"), float("inf")])
def test_nonsense_is_refused(name: str, value: float) -> None:
    with pytest.raises(TrackingError, match=f"uncertainty.{name}"):
        PoseUncertainty(**{name: value})


def test_it_needs_a_prediction_that_weighs_images() -> None:
    with pytest.raises(TrackingError, match="uncertainty"):
        replace(ACP, prediction=LastPosePrediction(), sight=Off())
