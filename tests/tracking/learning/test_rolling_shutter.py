"""The time between a picture's rows, told by the residuals of edges that move."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from acp_lab.errors import TrackingError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.tracking.learning.rolling_shutter import RollingShutter, ShutterConfig, _one_side, _take_in
from acp_lab.tracking.sources.rigid import RigidSource
from tests.made_parts import bracket, looking_at
from tests.tracking.rendered import CAMERA, prepared
from tests.tracking.views import prior_of, view_at

PART = bracket()
MODEL = prepared(PART)
AT = prior_of(view_at(PART, looking_at(PART, np.array([0.8, 0.6, 1.0]), 260.0, 0.3)))
EDGES = RigidSource(MODEL.best_generator(), 0.0).generate(AT, 200)
JACOBIAN = AT.lines(MODEL.edges.points_obj[EDGES.sample_ids], EDGES.normals).jacobian
SIZE_PX = np.array([CAMERA.width, CAMERA.height], float)
LATE = (EDGES.points - CAMERA.project(AT.centre_cam[None])) / SIZE_PX
OUTWARD = EDGES.outline.astype(float)
EXACT = ShutterConfig(gain=1.0)


def motions(count: int, mm: float, seed: int = 0) -> list[FloatArray]:
    """(6,) of frames; mm: how far the part moves in each, anywhere."""
    rng, found = np.random.default_rng(seed), []
    for _ in range(count):
        shift = rng.normal(size=3) * [1.0, 1.0, 0.3]
        found.append(np.concatenate([rng.normal(0.0, 0.01, 3), mm * shift / np.linalg.norm(shift)]))
    return found


def learn(
    shutter: RollingShutter,
    readout: tuple[float, float],
    motion: FloatArray,
    seed: int,
    noise_px: float = 0.3,
    shown: float = 1.0,
    steady_px: FloatArray | float = 0.0,
) -> None:
    """A frame whose pose is a little off, and that was solved with what the shutter is taken for.

    shown: how much of what a shutter does that is not expected residuals show; steady_px: (n,) beside that.
    """
    rng, expected = np.random.default_rng(seed), np.zeros(2) if shutter.readout is None else shutter.readout
    motion_px = JACOBIAN @ motion
    residuals_px = shown * LATE @ (np.array(readout) - expected) * motion_px + steady_px
    residuals_px += rng.normal(0.0, noise_px, len(EDGES))
    residuals_px += JACOBIAN @ np.array([0.002, -0.001, 0.001, 0.2, -0.1, 0.4]) + 0.2 * OUTWARD
    residuals_px[rng.random(len(EDGES)) < 0.1] = np.nan
    gradients = rng.choice([-20.0, 20.0], len(EDGES))
    shutter.learn(expected, SIZE_PX, LATE, EDGES.normals, motion_px, residuals_px, gradients, OUTWARD, JACOBIAN)


@pytest.mark.parametrize("readout", [(0.0, 0.9), (0.0, 0.4), (0.0, -0.7), (0.8, 0.0)])
def test_it_is_learnt_along_its_side_and_the_other_is_none(readout: tuple[float, float]) -> None:
    shutter = RollingShutter(EXACT)
    for number, motion in enumerate(motions(10, 9.0)):
        learn(shutter, readout, motion, number)
    assert shutter.readout is not None
    np.testing.assert_allclose(shutter.readout, readout, atol=0.12)
    assert np.count_nonzero(shutter.readout) == 1


@pytest.mark.parametrize("readout", [0.9, 0.4])
@pytest.mark.parametrize("shown", [0.4, 1.0])
def test_it_settles_near_what_is_true_however_much_of_it_residuals_show(readout: float, shown: float) -> None:
    shutter, found = RollingShutter(ShutterConfig()), list[float]()
    for number, motion in enumerate(motions(40, 9.0)):
        learn(shutter, (0.0, readout), motion, number, shown=shown)
        found.append(0.0 if shutter.readout is None else float(shutter.readout[1]))
    np.testing.assert_allclose(found[12:], readout, atol=0.2)
    # Once it is believed it is not taken back and believed again.
    first = next(k for k, value in enumerate(found) if value)
    assert all(found[first:])


def stretched_down(by_px: float) -> FloatArray:
    """(n,) px along the normals that a picture shows edges farther off that is stretched by so many px in all."""
    return np.asarray(by_px * LATE[:, 1] * EDGES.normals[:, 1])


def test_a_picture_that_is_deformed_while_the_part_moves_one_way_is_no_shutter() -> None:
    # As a focal length that is a hundredth off along one side of the picture would have it.
    down, shutter = np.array([0.0, 0.0, 0.0, 0.0, 4.0, 0.0]), RollingShutter(ShutterConfig())
    steady_px = stretched_down(0.01 * CAMERA.height)
    for number in range(100):
        learn(shutter, (0.0, 0.0), down, number, steady_px=steady_px)
        assert shutter.readout is None
    # And where it then moves the other way it is clear that it was none.
    for number in range(30):
        learn(shutter, (0.0, 0.0), -down, number, steady_px=steady_px)
        assert shutter.readout is None


def test_a_shutter_of_a_picture_that_is_deformed_is_learnt() -> None:
    shutter = RollingShutter(ShutterConfig())
    for number, motion in enumerate(motions(20, 9.0)):
        learn(shutter, (0.0, 0.9), motion, number, steady_px=stretched_down(1.0))
    assert shutter.readout is not None
    np.testing.assert_allclose(shutter.readout, (0.0, 0.9), atol=0.2)


def test_a_picture_that_is_read_at_once_is_taken_for_that() -> None:
    shutter = RollingShutter(ShutterConfig())
    for number, motion in enumerate(motions(60, 9.0)):
        learn(shutter, (0.0, 0.0), motion, number)
        assert shutter.readout is None


def test_a_part_that_rests_tells_nothing() -> None:
    shutter = RollingShutter(ShutterConfig())
    for number in range(20):
        learn(shutter, (0.0, 0.9), np.zeros(6), number)
    assert shutter.readout is None


def test_what_errs_alike_in_all_frames_of_a_slow_turn_is_no_shutter() -> None:
    # As a shutter would have it, by some hundredths of a px: edges may well lie that far off, and stay there.
    slow, fast = RollingShutter(EXACT), RollingShutter(EXACT)
    motion = np.array([0.0, 0.0, 0.0, 0.2, 0.3, 0.0])
    for number in range(300):
        learn(slow, (0.0, 0.9), motion, number, noise_px=0.05)
    for number in range(10):
        learn(fast, (0.0, 0.9), 30.0 * motion, number)
    assert slow.readout is None
    assert fast.readout is not None


def test_a_camera_that_is_set_otherwise_is_learnt_anew() -> None:
    shutter = RollingShutter(EXACT)
    for number, motion in enumerate(motions(30, 9.0)):
        learn(shutter, (0.0, 0.9), motion, number)
    for number, motion in enumerate(motions(60, 9.0, seed=1)):
        learn(shutter, (0.0, 0.3), motion, number)
    assert shutter.readout is not None
    np.testing.assert_allclose(shutter.readout, (0.0, 0.3), atol=0.15)


def test_the_evidence_of_a_frame_is_what_the_plain_formulas_say() -> None:
    rng, count = np.random.default_rng(4), len(EDGES)
    kept, gradients = rng.normal(size=(6, count)), rng.normal(size=count)
    residuals_px = kept.T @ rng.normal(0.0, 0.2, 6) + rng.normal(0.0, 0.4, count)
    residuals_px[::7] = np.nan
    information, pull = np.empty((6, 6)), np.empty(6)
    weight = _take_in(kept, residuals_px, gradients, OUTWARD, JACOBIAN, 0.5, information, pull)

    seen = np.isfinite(residuals_px)
    jacobian = JACOBIAN[seen] / np.abs(JACOBIAN[seen]).max(0)
    beside = np.column_stack([np.sign(gradients) * np.abs(OUTWARD), OUTWARD])[seen]
    rows, residuals = np.column_stack([kept.T[seen], beside, jacobian]), residuals_px[seen]
    ridge, found = np.diag([1e-3] * 6 + [1e-6] * 8), np.zeros(14)
    for _ in range(3):
        weights = 1.0 / (1.0 + ((residuals - rows @ found) / 0.5) ** 2) ** 2
        matrix, vector = rows.T @ (weights[:, None] * rows), rows.T @ (weights * residuals)
        found = np.linalg.solve(matrix + ridge, vector)
    matrix[6:, 6:] += ridge[6:, 6:]
    of_rest = matrix[:6, 6:] @ np.linalg.inv(matrix[6:, 6:])
    np.testing.assert_allclose(information, (matrix[:6, :6] - of_rest @ matrix[6:, :6]) / 0.25, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(pull, (vector[:6] - of_rest @ vector[6:]) / 0.25, rtol=1e-6, atol=1e-6)
    assert weight == pytest.approx(float(weights.sum()))


def test_each_side_is_asked_as_if_the_other_were_none() -> None:
    rng = np.random.default_rng(6)
    rows, pull = rng.normal(size=(30, 6)), rng.normal(size=6)
    precision, shares, variances = rows.T @ rows, np.empty(2), np.empty(2)
    _one_side(precision, pull, shares, variances)
    for side in range(2):
        unknown = [side, 2, 3, 4, 5]
        covariance = np.linalg.inv(precision[np.ix_(unknown, unknown)])
        assert shares[side] == pytest.approx(covariance[0] @ pull[unknown])
        assert variances[side] == pytest.approx(covariance[0, 0])
    _one_side(precision, 1e3 * pull, shares, variances)
    np.testing.assert_array_equal(np.abs(shares), 1.0)


def test_few_edges_tell_nothing() -> None:
    shutter, motion_px = RollingShutter(EXACT), JACOBIAN @ motions(1, 9.0)[0]
    residuals_px = 0.9 * LATE[:, 1] * motion_px
    residuals_px[29:] = np.nan
    for _ in range(10):
        shutter.learn(
            np.zeros(2), SIZE_PX, LATE, EDGES.normals, motion_px, residuals_px, np.ones(len(EDGES)), OUTWARD, JACOBIAN
        )
    assert shutter.readout is None


@pytest.mark.parametrize("name", [field.name for field in fields(ShutterConfig)])
@pytest.mark.parametrize("value", [0.0, float("nan")])
def test_impossible_settings_are_refused(name: str, value: float) -> None:
    with pytest.raises(TrackingError, match=f"learning.shutter.{name}"):
        ShutterConfig(**{name: value})
