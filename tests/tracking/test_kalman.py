"""The Kalman filter of a pose: against its plain matrices, and against simulated tracks whose noise is known."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.stats import chi2

from acp_lab.errors import TrackingError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import transform
from acp_lab.geometry.pose_step import move_pose, pose_step_between
from acp_lab.tracking.kalman import KalmanPrediction, PoseKalman
from tests.made_parts import box, looking_at

PART = box(shift=(500.0, -200.0, 100.0))
CENTRE = PART.box_centre
START = looking_at(PART, np.array([1.0, 0.5, 0.2]), 250.0, 0.4)
# Neither widened by the innovation nor by the speed: then all is linear.
PLAIN = KalmanPrediction(turn_deg=0.5, shift_mm=0.4, speed_share=0.0, most_widening=1.0, first_speed=10.0)
TURNING = np.array([0.01, -0.005, 0.02, 0.6, -0.4, 1.0])


def started(config: KalmanPrediction = PLAIN) -> PoseKalman:
    found = config.predictor(CENTRE)
    found.restart(START)
    return found


def acceleration_variance(config: KalmanPrediction) -> FloatArray:
    """(6,) of turn (rad) and shift (mm)."""
    variance: FloatArray = np.repeat([np.radians(config.turn_deg), config.shift_mm], 3) ** 2
    return variance


def fused(motion: PoseKalman, measured: FloatArray, image: FloatArray) -> FloatArray:
    """(4, 4) where a solver ends that weighs the image, of information (6, 6), against the prediction."""
    predicted, prior = motion.predict(), motion.information()
    off = pose_step_between(predicted, measured, CENTRE)
    return move_pose(predicted, CENTRE, np.linalg.solve(prior + image, image @ off))


def spd(rng: np.random.Generator, deviations: FloatArray) -> FloatArray:
    """(6, 6) an information whose covariance is not diagonal."""
    mixed = np.eye(6) + 0.3 * rng.standard_normal((6, 6))
    found: FloatArray = np.linalg.inv(np.diag(deviations) @ mixed @ mixed.T @ np.diag(deviations))
    return found


@dataclass
class Plain:
    """Twelve states in a vector: where the part is beside `START`, and its velocity; the textbook's equations."""

    config: KalmanPrediction

    def __post_init__(self) -> None:
        first = np.repeat([np.radians(self.config.first_turn_deg), self.config.first_shift_mm], 3)
        self.state = np.zeros(12)
        self.covariance = np.diag(np.concatenate([first, self.config.first_speed * first]) ** 2)

    def predict(self) -> None:
        change = np.block([[np.eye(6), np.eye(6)], [np.zeros((6, 6)), np.eye(6)]])
        by_acceleration = np.concatenate([0.5 * np.eye(6), np.eye(6)])
        noise = by_acceleration @ np.diag(acceleration_variance(self.config)) @ by_acceleration.T
        self.state = change @ self.state
        self.covariance = change @ self.covariance @ change.T + noise

    def update(self, measured: FloatArray, covariance: FloatArray) -> None:
        sees = np.concatenate([np.eye(6), np.zeros((6, 6))], 1)
        gain = self.covariance @ sees.T @ np.linalg.inv(sees @ self.covariance @ sees.T + covariance)
        self.state = self.state + gain @ (measured - sees @ self.state)
        self.covariance = (np.eye(12) - gain @ sees) @ self.covariance


def test_it_is_the_textbooks_filter_of_twelve_states(rng: np.random.Generator) -> None:
    """About one axis and along any way, where pose steps add up; with a frame without image among them."""
    motion, plain = started(), Plain(PLAIN)
    only = np.array([1.0, 0, 0, 1, 1, 1])
    for frame in range(8):
        plain.predict()
        np.testing.assert_allclose(motion.predict(), move_pose(START, CENTRE, only * plain.state[:6]), atol=1e-9)
        np.testing.assert_allclose(motion.information(), np.linalg.inv(plain.covariance[:6, :6]), rtol=1e-8)
        if frame == 4:
            motion.coast()
            np.testing.assert_allclose(motion.last, move_pose(START, CENTRE, only * plain.state[:6]), atol=1e-9)
            continue
        # Turns about other axes would not add up: they stay zero if nothing couples them to what is measured.
        image = spd(rng, np.repeat([2e-3, 0.2], 3))
        image[np.ix_([1, 2], [0, 3, 4, 5])] = image[np.ix_([0, 3, 4, 5], [1, 2])] = 0.0
        off = only * frame * TURNING + only * 0.3 * rng.standard_normal(6) * np.repeat([0.01, 1.0], 3)
        motion.observe(fused(motion, move_pose(START, CENTRE, off), image), 1.0, image)
        plain.update(off, np.linalg.inv(image))
        np.testing.assert_allclose(motion.last, move_pose(START, CENTRE, plain.state[:6]), atol=1e-9)


def test_the_innovation_of_simulated_tracks_is_what_chance_allows() -> None:
    """Accelerations and measurements as noisy as the filter is told: its own statistics must hold over 40 tracks.

    With noise of the image that is small beside the prediction's, what a solver finds is what the image shows.
    """
    measured = np.repeat([5e-4, 0.03], 3)
    image = np.diag(measured**-2)
    first = np.repeat([np.radians(PLAIN.first_turn_deg), PLAIN.first_shift_mm], 3)
    normalised, own = [], []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        motion = started()
        pose = move_pose(START, CENTRE, first * rng.standard_normal(6))
        velocity = PLAIN.first_speed * first * rng.standard_normal(6)
        for _ in range(12):
            acceleration = np.sqrt(acceleration_variance(PLAIN)) * rng.standard_normal(6)
            pose = move_pose(pose, CENTRE, velocity + 0.5 * acceleration)
            velocity = velocity + acceleration
            seen = move_pose(pose, CENTRE, measured * rng.standard_normal(6))
            off = pose_step_between(motion.predict(), seen, CENTRE)
            spread = np.linalg.inv(motion.information()) + np.linalg.inv(image)
            normalised.append(off @ np.linalg.solve(spread, off))
            motion.observe(fused(motion, seen, image), 1.0, image)
            own.append(motion.innovation)
    count = 6 * len(normalised)
    low, high = chi2.ppf([0.025, 0.975], count) / count
    assert low < np.sum(normalised) / count < high
    # What the filter reports of itself, per degree of freedom, is nearly the same here.
    assert np.mean(own) == pytest.approx(1.0, abs=0.05)


def test_the_information_is_symmetric_and_positive_definite_all_the_way(rng: np.random.Generator) -> None:
    motion, pose = started(KalmanPrediction()), START
    for frame in range(200):
        pose = move_pose(pose, CENTRE, TURNING + np.repeat([0.01, 0.3], 3) * rng.standard_normal(6))
        deviations = 10.0 ** rng.uniform(-5.0, 0.0) * np.repeat([0.01, 1.0], 3)
        image = spd(rng, deviations)
        information = motion.information()
        np.testing.assert_allclose(information, information.T, rtol=1e-6, atol=1e-9 * np.abs(information).max())
        assert np.linalg.eigvalsh(0.5 * (information + information.T)).min() > 0.0
        match frame % 7:
            case 3:
                motion.coast()
            case 5:
                motion.observe(pose, 0.0, image)
            case _:
                motion.observe(pose, 1.0, image)


def variance_mm(motion: PoseKalman) -> float:
    """mm^2, of the predicted shift."""
    return float(np.trace(np.linalg.inv(motion.information())[3:, 3:]))


@pytest.mark.parametrize("kick_mm", [1.0, 3.0])
def test_surprises_widen_the_prediction_and_calm_narrows_it_again(kick_mm: float) -> None:
    config = replace(PLAIN, most_widening=30.0)
    motion, calm = started(config), started(config)
    image = np.diag(np.repeat([1e-4, 0.02], 3) ** -2.0)

    def rests(*motions: PoseKalman) -> None:
        for each in motions:
            each.observe(each.predict(), 1.0, image)

    for _ in range(20):
        rests(motion, calm)
    usual = variance_mm(motion)
    kick = np.array([0.0, 0, 0, kick_mm, 0, 0])
    motion.observe(move_pose(motion.predict(), CENTRE, kick), 1.0, image)
    rests(calm)
    assert (motion.innovation > 4.0) == (kick_mm > 2.0)
    assert motion.innovation > 1.0
    # By the innovation, yet at most four times in one frame: what is known of the velocity is the same in both.
    once = variance_mm(motion)
    expected = min(motion.innovation, 4.0) * 3.0 * 0.25 * config.shift_mm**2
    known = variance_mm(calm) - 3.0 * 0.25 * config.shift_mm**2
    assert once == pytest.approx(known + expected, rel=1e-3)
    for _ in range(10):
        motion.observe(move_pose(motion.predict(), CENTRE, 30.0 * kick), 1.0, image)
    widest = 30.0 * 3.0 * 0.25 * config.shift_mm**2
    assert widest < variance_mm(motion) < 1.1 * widest, "no wider than most_widening allows"
    for _ in range(40):
        rests(motion)
    assert variance_mm(motion) == pytest.approx(usual, rel=1e-3)


def test_what_moves_fast_is_predicted_less_surely() -> None:
    """By a share of the speed, turns and shifts each by their own."""
    slow, fast = started(replace(PLAIN, speed_share=0.2)), started(replace(PLAIN, speed_share=0.2))
    image = np.diag(np.repeat([1e-4, 0.02], 3) ** -2.0)
    pose = START
    for _ in range(30):
        pose = move_pose(pose, CENTRE, np.array([0.0, 0, 0, 5.0, 0, 0]))
        fast.observe(pose, 1.0, image)
        slow.observe(START, 1.0, image)
    added = np.linalg.inv(fast.information()) - np.linalg.inv(slow.information())
    # Steady states differ by the velocity's own variance, too; hence at least.
    assert 0.25 * (0.2 * 5.0) ** 2 < added[3, 3] < 2.0 * (0.2 * 5.0) ** 2
    np.testing.assert_allclose(added[:3, :3], 0.0, atol=1e-8)


def test_frames_without_an_image_make_it_less_sure_each_time() -> None:
    motion = started()
    for step in range(1, 4):
        motion.observe(move_pose(START, CENTRE, step * TURNING), 1.0, 1e6 * np.eye(6))
    spreads, poses = [], []
    for _ in range(5):
        expected = motion.predict()
        spreads.append(np.linalg.inv(motion.information()))
        motion.coast()
        np.testing.assert_array_equal(motion.last, expected)
        poses.append(motion.last)
    for before, after in pairwise(spreads):
        assert np.linalg.eigvalsh(after - before).min() > 0.0
    # The motion goes on.
    steps = [pose_step_between(a, b, CENTRE) for a, b in pairwise(poses)]
    np.testing.assert_allclose(steps, np.tile(steps[0], (4, 1)), atol=1e-9)
    np.testing.assert_allclose(steps[0], TURNING, rtol=0.1, atol=1e-3)


def test_a_pose_that_fits_nothing_is_not_taken_in() -> None:
    for quality, holds in ((0.29, True), (0.3, True), (0.31, False)):
        motion = started(replace(PLAIN, hold_below=0.3))
        seen = [move_pose(START, CENTRE, step * TURNING) for step in range(1, 5)]
        for pose in seen[:3]:
            motion.observe(pose, 1.0, 1e6 * np.eye(6))
        assert motion.moves
        before = variance_mm(motion)
        motion.observe(seen[3], quality, 1e6 * np.eye(6))
        np.testing.assert_array_equal(motion.last, seen[2] if holds else seen[3])
        assert motion.moves is not holds
        assert (np.abs(motion.predict() - motion.last).max() < 1e-12) == holds
        assert (variance_mm(motion) > 1.2 * before) == holds


def test_after_a_restart_nothing_of_the_past_is_left() -> None:
    motion = started(KalmanPrediction())
    for step in range(1, 6):
        motion.observe(move_pose(START, CENTRE, step * step * TURNING), 1.0, 1e4 * np.eye(6))
    assert motion.moves
    assert motion.innovation > 0.0
    motion.restart(START)
    fresh = started(KalmanPrediction())
    assert not motion.moves
    assert motion.innovation == 0.0
    np.testing.assert_array_equal(motion.predict(), fresh.predict())
    np.testing.assert_array_equal(motion.information(), fresh.information())
    np.testing.assert_array_equal(motion.last, START)


def test_the_innovation_of_a_pose_is_its_normalised_distance_from_the_prediction() -> None:
    motion = started()
    motion.observe(move_pose(START, CENTRE, TURNING), 1.0, 1e4 * np.eye(6))
    assert motion.innovation_of(motion.predict()) == pytest.approx(0.0, abs=1e-12)
    for k in range(6):
        # One standard deviation along one axis of the covariance is one degree of freedom of six.
        spread, axes = np.linalg.eigh(np.linalg.inv(motion.information()))
        step = np.sqrt(spread[k]) * axes[:, k]
        off = move_pose(motion.predict(), CENTRE, 2.0 * step)
        assert motion.innovation_of(off) == pytest.approx(4.0 / 6.0, rel=1e-6)


def test_a_frame_of_unknown_information_counts_as_much_as_the_prediction() -> None:
    told, untold = started(), started()
    pose = move_pose(START, CENTRE, TURNING)
    told.observe(pose, 1.0, told.information())
    untold.observe(pose)
    np.testing.assert_allclose(untold.information(), told.information(), rtol=1e-9)


def test_the_origin_of_the_object_frame_plays_no_part() -> None:
    motion = started()
    for step in range(1, 30):
        motion.observe(move_pose(START, CENTRE, np.array([0.0, 0.1 * step, 0, 0, 0, 0])), 1.0, 1e8 * np.eye(6))
    np.testing.assert_allclose(transform(motion.predict(), CENTRE), transform(START, CENTRE), atol=1e-6)


def test_before_any_pose_there_is_nothing_to_predict() -> None:
    with pytest.raises(ValueError, match="no pose observed yet"):
        PLAIN.predictor(CENTRE).predict()


@pytest.mark.parametrize(
    ("setting", "value"), [("turn_deg", 0.0), ("shift_mm", -1.0), ("first_speed", float("nan")), ("speed_share", -0.1)]
)
def test_settings_that_no_motion_has_are_refused(setting: str, value: float) -> None:
    with pytest.raises(TrackingError, match=f"prediction.*{setting}"):
        KalmanPrediction(**{setting: value})


def test_before_the_first_pose_nothing_moves() -> None:
    assert not KalmanPrediction().predictor(np.zeros(3)).moves


# ---- whether anybody has to look for the part ----------------------------------------------------------------

CAMERA = Camera(640, 512, 600.0, 600.0, 319.5, 255.5)


def steady(config: KalmanPrediction, frames: int = 6) -> PoseKalman:
    """After frames in which the part moved as predicted."""
    motion = started(config)
    for _ in range(frames):
        motion.observe(motion.predict(), information=np.diag([1e8] * 3 + [1e4] * 3))
    return motion


def test_a_motion_that_goes_on_is_sure_and_one_that_was_not_seen_is_not() -> None:
    config = replace(PLAIN, sure_px=3.0)
    assert not started(config).is_sure(CAMERA), "nothing was seen yet"
    motion = steady(config)
    assert motion.is_sure(CAMERA)
    motion.coast()
    assert not motion.is_sure(CAMERA)
    motion = steady(config)
    motion.observe(motion.predict(), quality=0.0)
    assert not motion.is_sure(CAMERA)
    motion = steady(config)
    motion.restart(START)
    assert not motion.is_sure(CAMERA)


def test_a_surprise_makes_it_unsure() -> None:
    config = replace(PLAIN, sure_px=3.0, sure_innovation=0.5)
    for kick_mm, sure in ((0.05, True), (4.0, False)):
        motion = steady(config)
        kicked = move_pose(motion.predict(), CENTRE, np.array([0.0, 0.0, 0.0, kick_mm, 0.0, 0.0]))
        motion.observe(kicked, information=np.diag([1e8] * 3 + [1e4] * 3))
        assert motion.is_sure(CAMERA) == sure


def test_sure_is_a_matter_of_pixels() -> None:
    motion = steady(replace(PLAIN, sure_px=3.0))
    assert not motion.is_sure(replace(CAMERA, fx=60000.0))
    deviation_mm = np.sqrt(np.linalg.inv(motion.information())[[3, 4], [3, 4]].max())
    depth = float(transform(motion.predict(), CENTRE)[2])
    limit_px = CAMERA.fx * deviation_mm / depth
    assert steady(replace(PLAIN, sure_px=1.01 * limit_px)).is_sure(CAMERA)
    assert not steady(replace(PLAIN, sure_px=0.99 * limit_px)).is_sure(CAMERA)


def test_the_expected_motion_is_known_after_two_frames() -> None:
    found = started()
    assert found.motion is None
    pose = START
    for _ in range(12):
        pose = move_pose(pose, CENTRE, TURNING)
        found.observe(pose, 1.0, 1e4 * found.information())
    assert found.motion is not None
    np.testing.assert_allclose(found.motion, TURNING, rtol=0.05, atol=1e-3)
    found.restart(START)
    assert found.motion is None
