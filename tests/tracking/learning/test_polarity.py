"""The common shift of outlines towards their bright side: told from a motion where both polarities are seen."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.errors import TrackingError
from acp_lab.geometry.arrays import BoolArray, FloatArray
from acp_lab.tracking.learning.polarity import EdgePolarity, PolarityConfig

COUNT = 240
ANGLES = np.linspace(0.0, 2.0 * np.pi, COUNT, endpoint=False)
NORMALS = np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=1)  # outward, of a disc
OUTLINE = np.ones(COUNT, bool)
BRIGHT_TO_THE_LEFT = np.where(NORMALS[:, 0] < 0.0, 3.0, -3.0)
"""Gradients along the normals: the ground is brighter than the part on the left, darker on the right."""


def jacobian() -> FloatArray:
    """(n, 6) of a disc before a camera: shifts in the image, scale by distance, turns that squeeze."""
    x, y = NORMALS.T
    return np.column_stack([0.3 * x * y, 0.3 * x**2, np.zeros(COUNT), x, y, -np.ones(COUNT)]) * 1.7


def learnt(
    residuals: FloatArray, gradients: FloatArray, frames: int = 1, rate: float = 1.0, outline: BoolArray = OUTLINE
) -> EdgePolarity:
    """After frames in which the shift that is known already is taken off."""
    polarity = EdgePolarity(PolarityConfig())
    for _ in range(frames):
        beside = residuals - polarity.shift_px * np.sign(gradients) * outline
        polarity.measure(gradients, outline.astype(float), beside, jacobian(), rate)
    return polarity


def noise(seed: int = 0) -> FloatArray:
    return np.random.default_rng(seed).normal(0.0, 0.1, COUNT)


@pytest.mark.parametrize("shift_px", [-0.5, 0.4])
def test_a_shift_is_learnt_beside_a_motion(shift_px: float) -> None:
    """Gradients of both signs all around: every third edge point has the other one."""
    gradients = np.where(np.arange(COUNT) % 3 == 0, -4.0, 4.0)
    motion = jacobian() @ np.array([0.1, -0.1, 0.0, 0.2, -0.3, 0.15])
    found = learnt(shift_px * np.sign(gradients) + motion + noise(), gradients, frames=8)
    # A little less than what is there: without evidence there is no shift.
    assert 0.75 < found.shift_px / shift_px < 1.05


def test_a_motion_is_no_shift() -> None:
    motion = jacobian() @ np.array([0.1, -0.1, 0.0, 0.2, -0.3, 0.15])
    found = learnt(motion + noise(), np.where(np.arange(COUNT) % 3 == 0, -4.0, 4.0), frames=8)
    assert abs(found.shift_px) < 0.05


def test_where_a_motion_explains_it_as_well_it_stays_small() -> None:
    # Bright all around: the same as another distance.
    assert abs(learnt(np.full(COUNT, 0.5) + noise(), np.full(COUNT, 4.0), frames=20).shift_px) < 0.02
    # Bright on the left, dark on the right: mostly like a shift of the part.
    sideways = learnt(0.5 * np.sign(BRIGHT_TO_THE_LEFT) + noise(), BRIGHT_TO_THE_LEFT, frames=1)
    assert 0.0 < sideways.shift_px < 0.4


def test_a_part_that_is_smaller_than_its_model_is_no_shift() -> None:
    """As one with broken edges is; half of the points are inner creases, which say that it is no nearer."""
    outline = np.arange(COUNT) % 2 == 0
    residuals = np.where(outline, -0.4, 0.0) + noise()
    for gradients in (np.full(COUNT, -4.0), np.where(np.arange(COUNT) % 5 < 2, -4.0, 4.0)):
        assert abs(learnt(residuals, gradients, frames=8, outline=outline).shift_px) < 0.06


def test_wrong_image_edges_hardly_count() -> None:
    gradients = np.where(np.arange(COUNT) % 3 == 0, -4.0, 4.0)
    residuals = 0.4 * np.sign(gradients) + noise()
    residuals[::5] = 4.0 * np.sign(gradients[::5])
    assert 0.25 < learnt(residuals, gradients, frames=8).shift_px < 0.45


def test_inner_creases_and_unseen_points_say_nothing() -> None:
    gradients = np.where(np.arange(COUNT) % 3 == 0, -4.0, 4.0)
    residuals = 0.4 * np.sign(gradients)
    assert learnt(residuals, gradients, outline=np.zeros(COUNT, bool)).shift_px == pytest.approx(0.0, abs=1e-12)
    unseen = np.full(COUNT, np.nan)
    unseen[:20] = residuals[:20]
    assert learnt(unseen, gradients).shift_px == 0.0
    assert EdgePolarity(PolarityConfig()).measure(gradients, OUTLINE.astype(float), unseen, jacobian(), 1.0) == 0.0


def test_it_follows_slowly_and_only_so_far() -> None:
    gradients = np.where(np.arange(COUNT) % 3 == 0, -4.0, 4.0)
    at_once, slowly = (learnt(0.4 * np.sign(gradients), gradients, rate=rate) for rate in (1.0, 0.1))
    assert slowly.shift_px == pytest.approx(0.1 * at_once.shift_px)
    far = EdgePolarity(PolarityConfig(largest_px=0.2))
    moved = far.measure(gradients, OUTLINE.astype(float), 0.4 * np.sign(gradients), jacobian(), 1.0)
    assert moved == far.shift_px == pytest.approx(0.2)


@pytest.mark.parametrize(
    "values", [{"spread_px": 0.0}, {"scatter_px": float("nan")}, {"alike": -1.0}, {"rate": 1.5}, {"largest_px": 0.0}]
)
def test_nonsense_is_refused(values: dict[str, float]) -> None:
    with pytest.raises(TrackingError, match=f"learning.polarity.{next(iter(values))}"):
        PolarityConfig(**values)


def test_the_fit_is_that_of_its_slow_twin(rng: np.random.Generator) -> None:
    """A robust fit of shift, size and pose step, once plainly and once more around what it found."""
    gradients = rng.normal(0.0, 4.0, COUNT)
    outward = rng.choice([-1.0, 0.0, 1.0], COUNT)
    residuals = 0.3 * np.sign(gradients) * np.abs(outward) + jacobian() @ rng.normal(0.0, 0.1, 6) + noise(3)
    residuals[rng.random(COUNT) < 0.2] = np.nan
    polarity = EdgePolarity(PolarityConfig())
    polarity.shift_px = before = 0.1
    moved = polarity.measure(gradients, outward, residuals, jacobian(), rate=1.0)

    config, rows = polarity.config, np.isfinite(residuals)
    doubt = config.alike * (config.scatter_px / config.spread_px) ** 2
    seen = residuals[rows]
    columns = np.column_stack([np.sign(gradients) * np.abs(outward), outward, jacobian()])[rows]
    columns[:, 2:] /= np.abs(columns[:, 2:]).max(axis=0).clip(1e-12)
    found = np.zeros(8)
    for _ in range(2):
        weights = 1.0 / (1.0 + ((seen - columns @ found) / config.scatter_px) ** 2) ** 2
        matrix = columns.T @ (weights[:, None] * columns) + np.diag([doubt] + [1e-6] * 7)
        found = np.linalg.solve(matrix, columns.T @ (weights * seen) - np.eye(8)[0] * doubt * before)
    assert moved == pytest.approx(found[0], abs=1e-6)
    assert abs(moved) > 0.05
