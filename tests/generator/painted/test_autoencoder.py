"""The networks' shapes, and the loss of eqs. 2 to 4 against NumPy and finite differences."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from acp_lab.errors import PreparationError
from acp_lab.generator.painted.autoencoder import Decoder, Encoder, autoencoder_loss, bce_loss, inverse_psnr_loss
from acp_lab.generator.painted.config import NetworkShape
from acp_lab.generator.painted.latent_regressor import LatentRegressor

pytestmark = pytest.mark.usefixtures("one_torch_thread")

SMALL = NetworkShape(size=32, latent=12, widths=(8, 8, 4), hidden=16)


@pytest.mark.parametrize("size", [16, 32, 128])
def test_image_to_code_to_image(size: int) -> None:
    shape = NetworkShape(size=size, latent=20, widths=(8, 8, 4))
    images = torch.rand(3, 1, size, size)
    code = Encoder(shape)(images)
    assert code.shape == (3, 20)
    torch.testing.assert_close(code.mean(1), torch.zeros(3), atol=1e-5, rtol=0.0)
    torch.testing.assert_close(code.square().mean(1), torch.ones(3), atol=1e-3, rtol=0.0)
    assert Decoder(shape)(code).shape == images.shape


@pytest.mark.parametrize("size", [0, 8, 100])
def test_sizes_that_do_not_fit_the_grids_are_refused(size: int) -> None:
    with pytest.raises(PreparationError, match=f"{size} px: choose a multiple of 16"):
        NetworkShape(size=size)


def printed_loss(images: np.ndarray, truth: np.ndarray) -> float:
    """Eqs. 2 to 4, letter by letter."""
    total = 0.0
    for image, true in zip(images, truth, strict=True):
        n = image.size
        bce = -np.sum(true * np.log(image) + (1 - true) * np.log(1 - image)) / n
        psnr = -1.0 / (10.0 * np.log10(np.sum((true - image) ** 2) / n))
        total += bce + 0.5 * psnr
    return total / len(images)


@given(seed=st.integers(0, 1000))
def test_the_loss_is_the_printed_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    logits = torch.from_numpy(rng.normal(0.0, 2.0, (2, 1, 6, 7)))
    truth = torch.from_numpy(rng.random((2, 1, 6, 7)))
    expected = printed_loss(torch.sigmoid(logits).numpy(), truth.numpy())
    assert float(autoencoder_loss(logits, truth)) == pytest.approx(expected, rel=1e-9)


def test_the_psnr_loss_is_one_over_psnr() -> None:
    truth = torch.zeros(1, 1, 4, 4)
    assert float(inverse_psnr_loss(truth + 0.1, truth)) == pytest.approx(1.0 / 20.0)
    # Better images, smaller loss: 40 dB, 60 dB.
    assert float(inverse_psnr_loss(truth + 0.01, truth)) == pytest.approx(1.0 / 40.0)


def test_the_gradient_agrees_with_differences() -> None:
    torch.manual_seed(0)
    logits = torch.randn(2, 1, 3, 3, dtype=torch.float64, requires_grad=True)
    truth = torch.rand(2, 1, 3, 3, dtype=torch.float64)
    assert torch.autograd.gradcheck(lambda x: autoencoder_loss(x, truth), (logits,))
    assert torch.autograd.gradcheck(lambda x: inverse_psnr_loss(torch.sigmoid(x), truth), (logits,))


def test_the_loss_of_certain_pixels_is_finite() -> None:
    logits = torch.tensor([[[[200.0, -200.0]]]])
    assert torch.isfinite(bce_loss(logits, torch.tensor([[[[0.0, 1.0]]]])))


# ---- the regressor -------------------------------------------------------------------------------------------


def test_control_points_are_whitened(rng: np.random.Generator) -> None:
    """Spread 1 along every axis, however much the coordinates hang together."""
    points = 60.0 + rng.standard_normal((4000, 8)) @ (rng.standard_normal((8, 8)) * np.geomspace(0.5, 20.0, 8))
    regressor = LatentRegressor(SMALL)
    regressor.standardise(points)
    white = (torch.from_numpy(points).float() - regressor.centre) @ regressor.axes
    np.testing.assert_allclose(np.cov(white.numpy().T), np.eye(8), atol=2e-3)
    assert regressor(torch.from_numpy(points[:5]).float()).shape == (5, 12)


def test_what_never_varied_is_not_blown_up(rng: np.random.Generator) -> None:
    points = np.repeat(rng.standard_normal((500, 1)), 8, axis=1)
    regressor = LatentRegressor(SMALL)
    regressor.standardise(points)
    assert float(regressor.axes.abs().max()) <= 1.0 / 0.05 + 1e-3
