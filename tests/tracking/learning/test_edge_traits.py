"""What the edges of a part have in common: found whatever the pose, and only as far as edges tell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from acp_lab.geometry.arrays import FloatArray
from acp_lab.tracking.learning.edge_traits import EdgeTraits, TraitEvidence, _agree

SPREAD_PX, DEPTH_MM, SHIFT_MM = 0.2, 500.0, 20.0
TRUE = np.array([0.9, -1.1])


def evidence(
    traits: FloatArray = TRUE, known: FloatArray | None = None, step: FloatArray | None = None, count: int = 400,
    seed: int = 0, noise_px: float = 0.1,
) -> TraitEvidence:  # fmt: skip
    """A frame whose edges are told with known traits; step: (rad, mm) by which its pose is off."""
    rng = np.random.default_rng(seed)
    slopes = rng.normal(0.0, 0.3, (count, 2))
    jacobian = rng.normal(0.0, 1.0, (count, 6)) * np.array([60.0, 60.0, 60.0, 1.5, 1.5, 0.2])
    # The CAD's edge is where the true traits put it; the solved place is a pose step off.
    told_with = np.zeros(2) if known is None else known
    residuals = slopes @ (told_with - traits) + noise_px * rng.standard_normal(count)
    if step is not None:
        residuals = residuals + jacobian @ step
    return TraitEvidence(residuals, slopes, np.full(count, SPREAD_PX), jacobian, DEPTH_MM, told_with)


def learnt(*frames: TraitEvidence, share: float = 0.1, memory: float = 0.7) -> EdgeTraits:
    traits = EdgeTraits(2, share, memory, SHIFT_MM)
    for frame in frames:
        traits.learn(frame)
    return traits


@pytest.mark.parametrize("step", [np.zeros(6), np.array([0.01, -0.01, 0.005, 0.4, -0.3, 8.0])], ids=["exact", "off"])
def test_traits_are_found_whatever_the_pose(step: FloatArray) -> None:
    np.testing.assert_allclose(learnt(evidence(step=step)).values, TRUE, atol=0.15)


def test_the_step_is_what_it_seems_to_be_without_traits() -> None:
    """That the pose is left out is what finds them: taken as exact, a pose that is off is taken for traits."""
    frame = evidence(step=np.array([0.01, -0.01, 0.005, 0.4, -0.3, 8.0]), seed=3, count=80)
    weighted = frame.slopes_px.T @ frame.slopes_px
    alone = -np.linalg.solve(weighted, frame.slopes_px.T @ frame.residuals_px)
    found = learnt(frame).values
    assert np.linalg.norm(alone - TRUE) > 2 * np.linalg.norm(found - TRUE)


def test_what_is_known_already_stays() -> None:
    traits = learnt(evidence())
    for seed in range(1, 6):
        traits.learn(evidence(known=traits.values, seed=seed))
    np.testing.assert_allclose(traits.values, TRUE, atol=0.1)


def test_places_are_taken_as_they_were_told() -> None:
    """Traits may have changed since: forgotten in a first frame that settles, learnt from the same frame before."""
    traits = learnt(evidence())
    seen = evidence(known=traits.values.copy(), seed=1)
    traits.forget()
    traits.learn(seen)
    np.testing.assert_allclose(traits.values, TRUE, atol=0.15)
    again = learnt(evidence(), evidence())
    np.testing.assert_allclose(again.values, TRUE, atol=0.15)


def test_a_part_that_changes_is_followed() -> None:
    traits = learnt(*(evidence() for _ in range(3)))
    for seed in range(1, 12):
        traits.learn(evidence(-TRUE, known=traits.values, seed=seed))
    np.testing.assert_allclose(traits.values, -TRUE, atol=0.15)


def test_a_usual_part_is_expected() -> None:
    """Few edges that say little leave the traits near 0; those that say nothing, at 0."""
    few = learnt(evidence(count=60), share=0.001).values
    assert np.linalg.norm(few) < 0.5 * np.linalg.norm(TRUE)
    assert not learnt(evidence(count=40)).values.any()
    assert not learnt(evidence(), share=0.0).values.any()


def test_edges_that_were_not_found_or_told_do_not_count() -> None:
    frame = evidence()
    residuals, spreads = frame.residuals_px.copy(), frame.spreads_px.copy()
    residuals[::5], spreads[1::5] = np.nan, 0.0
    others = np.setdiff1d(np.arange(400), np.concatenate([np.arange(0, 400, 5), np.arange(1, 400, 5)]))
    some = replace(frame, residuals_px=residuals, spreads_px=spreads)
    rest = replace(
        frame, residuals_px=residuals[others], slopes_px=frame.slopes_px[others], spreads_px=spreads[others],
        jacobian=frame.jacobian[others],
    )  # fmt: skip
    np.testing.assert_allclose(learnt(some).values, learnt(rest).values, atol=1e-9)


def test_edges_of_something_else_count_little() -> None:
    frame = evidence()
    residuals = frame.residuals_px.copy()
    residuals[::6] += 1.5
    np.testing.assert_allclose(learnt(replace(frame, residuals_px=residuals)).values, TRUE, atol=0.3)


def test_a_network_that_knows_of_none_learns_none() -> None:
    frame = evidence()
    none = EdgeTraits(0, 0.1, 0.7, SHIFT_MM)
    none.learn(replace(frame, slopes_px=np.zeros((400, 0)), told_with=np.zeros(0)))
    assert not none.are_learnt
    assert len(none.values) == 0


def test_forgetting_is_beginning_anew() -> None:
    traits = learnt(evidence(-TRUE))
    traits.forget()
    assert not traits.values.any()
    traits.learn(evidence())
    np.testing.assert_array_equal(traits.values, learnt(evidence()).values)


def test_sums_are_those_of_the_plain_twin() -> None:
    """The pose step is what least squares leave out, with weights of Student's distribution."""
    frame, share, doubt = evidence(step=np.array([0.002, 0.0, 0.0, 0.1, 0.0, 1.0]), seed=7), 0.1, np.full(6, 1e-3)
    matrix, vector = np.empty((8, 8)), np.empty(8)
    assert _agree(
        frame.residuals_px, frame.slopes_px, frame.jacobian, frame.spreads_px, doubt, share, matrix, vector
    ) == 400  # fmt: skip
    columns, found = np.concatenate([frame.jacobian, -frame.slopes_px], 1), np.zeros(8)
    for _ in range(4):
        left = frame.residuals_px - columns @ found
        weights = share * 4.0 / (3.0 * SPREAD_PX**2 + left**2)
        whole = columns.T @ (weights[:, None] * columns) + np.diag([*doubt, 0.0, 0.0])
        side = columns.T @ (weights * frame.residuals_px)
        found = np.linalg.solve(whole + np.diag([0.0] * 6 + [1.0] * 2), side)
    gain = np.linalg.solve(whole[:6, :6], np.concatenate([whole[:6, 6:], side[:6, None]], 1))
    np.testing.assert_allclose(matrix[6:, 6:], whole[6:, 6:] - whole[6:, :6] @ gain[:, :2], rtol=1e-6)
    np.testing.assert_allclose(vector[6:], side[6:] - whole[6:, :6] @ gain[:, 2], rtol=1e-6)
