"""Each reading of e(I) against differences, quadrature and the numbers that decide which of them can be used."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from acp_lab.tracking.losses import (
    LOSS_FORMS,
    edge_loss,
    printed,
    reference_bce,
    saturating,
)

ROBUST = ("saturating", "geman-mcclure", "tukey")
MINIMISED = (*ROBUST, "logistic")


@pytest.mark.parametrize("form", LOSS_FORMS)
@given(distance=st.floats(0.01, 60.0), alpha=st.floats(1.0, 40.0))
def test_derivatives_are_those_of_the_values(form: str, distance: float, alpha: float) -> None:
    if form == "printed" and abs(distance - alpha) < 0.5:
        return  # differences across a pole mean nothing
    step = 1e-4
    ahead, behind = (edge_loss(form, np.array([distance + side]), alpha).values for side in (step, -step))  # type: ignore[arg-type]
    derivative = edge_loss(form, np.array([distance]), alpha).derivatives  # type: ignore[arg-type]
    np.testing.assert_allclose(derivative, (ahead - behind) / (2 * step), rtol=1e-4, atol=1e-5)


def test_the_printed_formula_has_its_pole_at_alpha() -> None:
    below, above = printed(np.array([14.9, 15.1]), 15.0).values
    assert below == pytest.approx(10.5, abs=0.05)
    assert above == pytest.approx(-9.5, abs=0.05)
    # The nearer to the pole from above, the lower: what a minimiser would look for.
    values = printed(np.array([15.001, 15.01, 16.0, 100.0]), 15.0).values
    assert (np.diff(values) > 0.0).all()


def test_the_logistic_is_flat_on_the_edge_and_the_printed_one_too() -> None:
    for form in ("logistic", "printed"):
        assert edge_loss(form, np.zeros(1), 15.0).derivatives[0] == pytest.approx(3.06e-7, rel=0.01)  # type: ignore[arg-type]


@pytest.mark.parametrize("alpha", [1.5, 7.0, 30.0])
@pytest.mark.parametrize("distance", [0.3, 4.0, 25.0, 400.0])
def test_the_saturating_loss_is_the_integral_of_its_weight(alpha: float, distance: float) -> None:
    expected, _ = quad(lambda d: float(saturating(np.array([d]), alpha).derivatives[0]), 0.0, distance, limit=400)
    assert saturating(np.array([distance]), alpha).values[0] == pytest.approx(expected, rel=1e-5, abs=1e-8)


@pytest.mark.parametrize("form", MINIMISED)
def test_losses_grow_and_stay_bounded(form: str) -> None:
    distances = np.concatenate([np.linspace(0.0, 80.0, 400), [1e3, 1e4]])
    values = edge_loss(form, distances, 9.0).values  # type: ignore[arg-type]
    assert np.isfinite(values).all()
    assert (np.diff(values) >= -1e-9).all()
    assert values[-1] == pytest.approx(values[-2], rel=1e-3)


@pytest.mark.parametrize("form", ROBUST)
def test_a_missing_edge_counts_less(form: str) -> None:
    distances = np.array([0.5, 8.0, 40.0])
    near, at_the_brink, far = edge_loss(form, distances, 9.0).least_squares_weights(distances)  # type: ignore[arg-type]
    assert near > at_the_brink > far
    assert far < 0.02 * near


@pytest.mark.parametrize("form", MINIMISED)
def test_weighted_residuals_are_the_gradient(form: str) -> None:
    distances = np.linspace(0.3, 50.0, 60)
    loss = edge_loss(form, distances, 9.0)  # type: ignore[arg-type]
    np.testing.assert_allclose(loss.least_squares_weights(distances) * distances, loss.derivatives)


def test_bce_prefers_the_target_and_has_its_own_derivative() -> None:
    target = np.array([0.0, 1.0, 1.0, 0.0])
    belief = np.array([0.2, 0.7, 0.4, 0.9])
    step = 1e-6
    difference = (reference_bce(belief + step, target).values - reference_bce(belief - step, target).values) / (
        2 * step
    )
    np.testing.assert_allclose(reference_bce(belief, target).derivatives, difference, rtol=1e-5)
    assert reference_bce(target, target).values.max() < 1e-5
