"""The bound on made data with known noise: right within sampling error, smaller with more samples, never lowered by a
nuisance."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from acp_lab.errors import ParameterError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.pose_step import centre_position, move_pose
from acp_lab.sequences.frame import Frame
from acp_lab.studies.pose_bound import (
    WITHOUT_PROFILES,
    EdgeEvidence,
    allowed_error,
    edge_evidence,
    least_covariance,
    shown_step,
)
from acp_lab.tracking.frame_solver import FrameSolver
from acp_lab.tracking.method import ACP
from tests.made_parts import bracket, looking_at
from tests.tracking.rendered import CAMERA, add_percent, draw, prepared

PART = bracket(shift=(-400.0, -300.0, -500.0))
PRIORS = [0.0, 0.3, np.array([0.0, 0.4]), np.inf]


def made(count: int = 300, seed: int = 0) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Jacobian (n, 6), scatter (n,) and two nuisances (n, 2) of made samples, in units as different as rad and mm.

    The last variable, depth, looks much like a shared offset.
    """
    rng = np.random.default_rng(seed)
    jacobian = rng.normal(size=(count, 6)) * [80.0, 60.0, 90.0, 1.5, 1.4, 0.1]
    outline, scale = rng.random(count) < 0.6, 1.5 + 0.1 * rng.normal(size=count)
    jacobian[:, 5] += 0.2 * scale
    return jacobian, rng.uniform(0.2, 0.6, count), np.stack([scale * outline, scale * ~outline], 1)


@pytest.mark.parametrize("shared_mm", PRIORS)
def test_the_best_estimate_from_noise_scatters_as_the_bound_says(shared_mm: FloatArray | float) -> None:
    jacobian, scatter, shared = made()
    bound = least_covariance(jacobian, scatter, shared, shared_mm)
    rng, draws = np.random.default_rng(1), 4000
    deviation = np.broadcast_to(shared_mm, 2)
    # What nothing is known of may be anything: here it is 5 mm.
    offsets = rng.normal(size=(draws, 2)) * np.where(np.isinf(deviation), 5.0, deviation)
    noise = rng.normal(size=(draws, len(scatter))) * scatter + offsets @ shared.T
    # Least squares over pose and nuisances, each nuisance with what is known of it as one more equation.
    kept = deviation > 0.0
    rows = np.concatenate([np.hstack([jacobian, shared[:, kept]]) / scatter[:, None],
                           np.hstack([np.zeros((kept.sum(), 6)), np.diag(1.0 / deviation[kept])])])  # fmt: skip
    seen = np.concatenate([noise / scatter, np.zeros((draws, kept.sum()))], axis=1)
    found = np.linalg.lstsq(rows, seen.T, rcond=None)[0][:6].T
    root = np.linalg.cholesky(bound)
    whitened = np.linalg.solve(root, found.T)
    # A variance of 4000 draws is known to 2.2%.
    np.testing.assert_allclose(whitened @ whitened.T / draws, np.eye(6), atol=0.1)


@pytest.mark.parametrize(("wrong", "widest"), [(0.0, 1.2), (0.1, 1.6)])
@pytest.mark.parametrize("shared_mm", [0.0, 0.3, np.inf])
def test_what_samples_show_scatters_hardly_more_than_the_bound(
    shared_mm: float, wrong: float, widest: float
) -> None:
    """Also where a tenth of the image edges are others than the part's."""
    jacobian, scatter, shared = made()
    bound = least_covariance(jacobian, scatter, shared, shared_mm)
    rng, off = np.random.default_rng(2), np.array([0.003, 0.0, -0.002, 0.1, 0.2, -0.4])
    found = []
    for _ in range(400):
        offsets = rng.normal(size=2) * min(shared_mm, 5.0)
        residuals = jacobian @ off + shared @ offsets + rng.normal(size=len(scatter)) * scatter
        residuals[rng.random(len(scatter)) < wrong] += 4.0
        found.append(shown_step(jacobian, residuals, scatter, shared, shared_mm) - off)
    root = np.linalg.cholesky(bound)
    whitened = np.linalg.solve(root, np.array(found).T)
    variance = whitened @ whitened.T / 400
    # A variance of 400 draws is known to 7%.
    assert 0.8 < np.diagonal(variance).mean() < widest


@pytest.mark.parametrize("shared_mm", PRIORS)
def test_more_samples_allow_less_error(shared_mm: FloatArray | float) -> None:
    jacobian, scatter, shared = made()
    fewer = least_covariance(jacobian[:100], scatter[:100], shared[:100], shared_mm)
    more = least_covariance(jacobian, scatter, shared, shared_mm)
    assert np.linalg.eigvalsh(_relative(fewer, more)).min() > 1.0


def test_the_same_samples_four_times_halve_the_error() -> None:
    jacobian, scatter, shared = made()
    once = least_covariance(jacobian, scatter, shared, np.inf)
    often = least_covariance(np.tile(jacobian, (4, 1)), np.tile(scatter, 4), np.tile(shared, (4, 1)), np.inf)
    np.testing.assert_allclose(4.0 * often, once, rtol=1e-6)


def test_a_nuisance_never_lowers_the_error() -> None:
    jacobian, scatter, shared = made()
    found = [least_covariance(jacobian, scatter, shared, shared_mm) for shared_mm in (0.0, 0.05, 0.3, 2.0, np.inf)]
    for less, more in pairwise(found):
        assert np.linalg.eigvalsh(_relative(more, less)).min() > 1.0 - 1e-9
    assert found[-1][5, 5] > 1.2 * found[0][5, 5]
    # One that no sample shows costs nothing, nor do samples that say nothing.
    unseen = np.column_stack([shared, np.zeros(len(shared))])
    np.testing.assert_allclose(least_covariance(jacobian, scatter, unseen, np.inf), found[-1], rtol=1e-9)
    mute = np.where(np.arange(len(scatter)) < 100, np.inf, scatter)
    np.testing.assert_allclose(
        least_covariance(jacobian, mute, shared, 0.3),
        least_covariance(jacobian[100:], scatter[100:], shared[100:], 0.3),
        rtol=1e-9,
    )


def test_what_cannot_be_told_is_refused() -> None:
    jacobian, scatter, shared = made()
    # Depth that looks just like a shared offset.
    blind = np.column_stack([jacobian[:, :5], shared.sum(1)])
    least_covariance(blind, scatter, shared, 0.3)
    with pytest.raises(ParameterError, match="do not fix all variables"):
        least_covariance(blind, scatter, shared, np.inf)
    with pytest.raises(ParameterError, match="do not fix all variables"):
        least_covariance(jacobian[:4], scatter[:4], shared[:4], 0.0)
    for bad in (np.nan, -0.1):
        with pytest.raises(ParameterError, match="standard deviations"):
            least_covariance(jacobian, scatter, shared, bad)
    with pytest.raises(ParameterError, match="standard deviations"):
        least_covariance(jacobian, 0.0 * scatter, shared, 0.3)


def test_allowed_errors_are_those_of_poses_that_scatter_so() -> None:
    truth = looking_at(PART, np.array([0.8, 0.6, 1.0]), 330.0, 0.3)
    deviation = np.array([0.01, 0.02, 0.01, 0.5, 0.5, 3.0])
    found = allowed_error(PART, truth, np.diag(deviation**2))
    rng = np.random.default_rng(3)
    add = np.array([
        0.01 * add_percent(PART, move_pose(truth, PART.box_centre, rng.normal(size=6) * deviation), truth)
        for _ in range(600)
    ])  # fmt: skip
    assert found.mean == pytest.approx(add.mean(), rel=0.1)
    for limit, share in found.within.items():
        assert share == pytest.approx((add < limit).mean(), abs=0.09)
    assert 0.1 < found.within[0.02] < 0.9


def test_shared_offset_and_scatter_are_read_off_an_image() -> None:
    """Outlines that lie 0.2 mm further in are measured so; what they share does not count as scatter."""
    truth = looking_at(PART, np.array([0.8, 0.6, 1.0]), 330.0, 0.3)
    solver, found = FrameSolver(prepared(PART), WITHOUT_PROFILES), list[EdgeEvidence]()
    for inset_mm in (0.0, 0.2):
        shown = bracket(shift=(-400.0, -300.0, -500.0), inset_mm=inset_mm)
        evidence = edge_evidence(solver, Frame(0, draw([(shown, truth)]), CAMERA), truth)
        assert evidence is not None
        found.append(evidence)
    plain, inset = found
    assert abs(plain.shared_mm[0]) < 0.08
    # Both faces of an edge lie further in, which moves it by up to 1.4 times as much.
    assert -0.32 < inset.shared_mm[0] - plain.shared_mm[0] < -0.15
    assert inset.stretches.shape == (len(inset.outline), len(inset.stretches_mm))
    assert len(inset.stretches_mm) > 10
    assert (inset.spread_mm > 0.0).all()
    assert np.median(inset.scatter_px[inset.outline]) < 1.5 * np.median(plain.scatter_px[plain.outline]) < 0.6
    depth_mm = centre_position(truth, PART.box_centre)[2]
    np.testing.assert_allclose(np.abs(inset.px_per_mm), CAMERA.fx / depth_mm, rtol=0.2)
    bounds = [least_covariance(inset.jacobian, inset.scatter_px, inset.classes, mm) for mm in (0.0, np.inf)]
    assert bounds[1][5, 5] > 4.0 * bounds[0][5, 5]
    shared = np.hstack([inset.classes, inset.stretches])
    deviations = np.r_[0.0, 0.0, np.full(shared.shape[1] - 2, 0.1)]
    local = least_covariance(inset.jacobian, inset.scatter_px, shared, deviations)
    assert np.linalg.eigvalsh(_relative(local, bounds[0])).min() > 1.0
    assert edge_evidence(solver, Frame(0, np.zeros_like(draw([])), CAMERA), truth) is None


def test_stretches_scatter_about_what_their_class_shares() -> None:
    """Made samples: classes, stretches and scatter are told apart within sampling error."""
    rng = np.random.default_rng(5)
    stretch = np.repeat(np.arange(200), 30)
    outline = stretch % 2 == 0
    sign = rng.choice([-2.0, 2.0], len(stretch))  # 2 px per mm, normals either way
    own_mm = rng.normal(0.0, 0.1, 200)
    offset_mm = np.where(outline, -0.25, 0.15) + own_mm[stretch]
    residuals_px = sign * offset_mm + rng.normal(0.0, np.where(outline, 0.2, 0.4))
    nowhere = np.zeros((len(stretch), 3))
    evidence = EdgeEvidence(np.zeros((len(stretch), 6)), residuals_px, sign, outline, stretch, nowhere)
    np.testing.assert_allclose(evidence.shared_mm, [-0.25, 0.15], atol=0.04)
    # The robust deviation of 100 numbers is known to 12%; of each stretch the median's own scatter comes on top.
    np.testing.assert_allclose(evidence.spread_mm, 0.1, rtol=0.4)
    np.testing.assert_allclose(evidence.scatter_px, np.where(outline, 0.2, 0.4), rtol=0.06)
    assert [outline for outline, _ in evidence.stretches_mm.values()] == [i % 2 == 0 for i in range(200)]
    few = EdgeEvidence(
        np.zeros((9, 6)), np.ones(9), np.ones(9), np.ones(9, bool), np.zeros(9, np.int64), np.zeros((9, 3))
    )
    assert np.isnan(few.shared_mm).all()
    assert np.isinf(few.scatter_px).all()


def _relative(above: FloatArray, below: FloatArray) -> FloatArray:
    root = np.linalg.inv(np.linalg.cholesky(below))
    return np.asarray(root @ above @ root.T)


def test_evidence_of_a_method_that_reads_profiles_is_refused() -> None:
    truth = looking_at(PART, np.array([1.0, 0.7, 0.5]), 300.0)
    with pytest.raises(ParameterError, match="give a method such as WITHOUT_PROFILES"):
        edge_evidence(FrameSolver(prepared(PART), ACP), Frame(0, draw([(PART, truth)]), CAMERA), truth)
