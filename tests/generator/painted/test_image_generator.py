"""t(I) of stored networks: shapes, the derivative, threads, and what is refused. Untrained networks serve."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from acp_lab.errors import PreparationError
from acp_lab.generator.painted.autoencoder import Decoder
from acp_lab.generator.painted.config import NetworkShape
from acp_lab.generator.painted.image_generator import (
    POINT_SETS,
    AutoencoderGenerator,
    PointSet,
    RegionAutoencoder,
    one_thread,
)
from acp_lab.generator.painted.latent_regressor import LatentRegressor

pytestmark = pytest.mark.usefixtures("one_torch_thread")

SHAPE = NetworkShape(size=32, latent=12, widths=(8, 8, 4), hidden=16)
POINTS = np.array([[6.0, 7.0], [25.0, 6.5], [24.0, 26.0], [7.0, 25.0]])


def untrained(seed: int = 0) -> RegionAutoencoder:
    torch.manual_seed(seed)
    decoder = Decoder(SHAPE)
    # Freshly made networks answer next to nothing to their inputs.
    with torch.no_grad():
        for parameter in decoder.parameters():
            parameter.mul_(3.0 if parameter.ndim > 1 else 0.0)
    regressors: dict[PointSet, LatentRegressor] = {name: LatentRegressor(SHAPE) for name in POINT_SETS}
    for regressor in regressors.values():
        regressor.standardise(POINTS.ravel() + np.random.default_rng(seed).normal(0.0, 2.0, (200, 8)))
    points_obj: dict[PointSet, np.ndarray] = {
        name: np.full((4, 3), float(number)) for number, name in enumerate(POINT_SETS)
    }
    return RegionAutoencoder.of_networks(SHAPE, decoder, regressors, points_obj)


@pytest.fixture(scope="module")
def generator() -> AutoencoderGenerator:
    return AutoencoderGenerator({5: untrained(1), 2: untrained(0)}, "bolt")


def test_images_of_one_and_of_many(generator: AutoencoderGenerator) -> None:
    assert (generator.name, generator.regions, generator.size) == ("autoencoder", (2, 5), 32)
    one = generator.edge_image(POINTS, 2)
    assert one.shape == (32, 32)
    assert one.dtype == np.float32
    assert 0.0 < one.min() < one.max() < 1.0
    many = generator.edge_images(np.stack([POINTS, POINTS + 1.0]), 2)
    np.testing.assert_allclose(many[0], one, atol=1e-6)
    assert np.abs(many[1] - one).max() > 1e-4
    assert np.abs(generator.edge_image(POINTS, 5) - one).max() > 1e-3
    assert np.abs(generator.edge_image(POINTS, 2, "mid-section") - one).max() > 1e-3


@pytest.mark.parametrize("point_set", POINT_SETS)
def test_derivatives_agree_with_differences(generator: AutoencoderGenerator, point_set: PointSet) -> None:
    image, derivatives = generator.edge_image_derivatives(POINTS, 2, point_set)
    np.testing.assert_allclose(image, generator.edge_image(POINTS, 2, point_set), atol=1e-6)
    assert derivatives.shape == (32, 32, 8)
    assert derivatives.dtype == np.float32
    for k, step in enumerate(0.1 * np.eye(8).reshape(8, 4, 2)):
        ahead, behind = (generator.edge_image(POINTS + side * step, 2, point_set) for side in (1.0, -1.0))
        expected = (ahead.astype(float) - behind) / 0.2
        np.testing.assert_allclose(derivatives[:, :, k], expected, atol=2e-2 * np.abs(derivatives).max())
    assert np.abs(derivatives).max() > 1e-4


def test_the_points_it_was_trained_with(generator: AutoencoderGenerator) -> None:
    np.testing.assert_array_equal(generator.points_obj(2), np.zeros((4, 3)))
    np.testing.assert_array_equal(generator.points_obj(2, "mid-section"), np.ones((4, 3)))


def test_a_region_that_was_not_trained_is_refused(generator: AutoencoderGenerator) -> None:
    message = r"bolt: the auto-encoder of view region 3 is not trained \(only 2, 5\); run acp-lab prepare .*--regions 3"
    for ask in (generator.edge_image, generator.edge_image_derivatives):
        with pytest.raises(PreparationError, match=message):
            ask(POINTS, 3)
    with pytest.raises(PreparationError, match=message):
        generator.points_obj(3)
    with pytest.raises(PreparationError, match="bolt: no auto-encoder"):
        AutoencoderGenerator({}, "bolt")


def test_a_damaged_network_is_told_with_its_mend() -> None:
    whole = untrained()
    name = "decoder.3.weight"
    for tensors in (
        {key: value for key, value in whole.tensors.items() if key != name},
        {**whole.tensors, name: whole.tensors[name][:3]},
    ):
        broken = AutoencoderGenerator({0: RegionAutoencoder(tensors, whole.sizes, whole.points_obj)}, "bolt")
        with pytest.raises(PreparationError, match=r"bolt: .* region 0 is damaged .*--no-resume") as caught:
            broken.edge_image(POINTS, 0)
        assert "\n" not in str(caught.value)


def test_one_thread_and_back() -> None:
    torch.set_num_threads(2)
    try:
        with one_thread():
            assert torch.get_num_threads() == 1
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(1)


def test_only_matrices_are_rounded() -> None:
    for name, value in untrained().tensors.items():
        is_weight = name.endswith(".weight")
        assert value.dtype == (np.float16 if is_weight else np.float32), name


@pytest.mark.slow
def test_a_prepared_part_can_be_read_without_torch() -> None:
    code = (
        "import sys, acp_lab.prepared_part; "
        "from acp_lab.generator.painted import edge_points, image_generator; "
        "assert 'torch' not in sys.modules"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=Path(__file__).parents[2], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
