"""Where torch computes. The tests of the GPU skip, saying so, on a machine without one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from acp_lab.cad.part import Part
from acp_lab.cad.raycast import RayCaster
from acp_lab.control_points.coplanar_points import mid_section_points
from acp_lab.control_points.view_regions import ALL_REGIONS
from acp_lab.errors import PreparationError
from acp_lab.generator.device import Device, repeatable_convolutions, torch_device
from acp_lab.generator.painted import image_generator, training
from acp_lab.generator.painted.autoencoder import Decoder
from acp_lab.generator.painted.config import AutoencoderConfig, NetworkShape
from acp_lab.generator.painted.edge_images import EdgeImageConfig
from acp_lab.generator.painted.image_generator import POINT_SETS, AutoencoderGenerator, RegionAutoencoder
from acp_lab.generator.painted.latent_regressor import LatentRegressor
from acp_lab.generator.painted.training import TrainedRegion, train_autoencoder

needs_gpu = pytest.mark.skipif(not torch.cuda.is_available(), reason="torch finds no GPU on this machine")
REGION = ALL_REGIONS[4]
POINTS = np.array([[6.0, 7.0], [25.0, 6.5], [24.0, 26.0], [7.0, 25.0]])
TINY = AutoencoderConfig(
    images=EdgeImageConfig(size=32, views=16, held_out=3),
    shape=NetworkShape(latent=8, widths=(8, 8, 4), hidden=16),
    fine_tune_epochs=2,
    second_epochs=1,
    batch=8,
)


def test_the_cpu_is_always_there() -> None:
    assert torch_device("cpu") == torch.device("cpu")
    with pytest.raises(PreparationError, match="--device tpu: choose auto, cpu or cuda"):
        torch_device("tpu")  # type: ignore[arg-type]


def test_auto_takes_a_gpu_where_there_is_one(monkeypatch: pytest.MonkeyPatch) -> None:
    for there, expected in ((True, "cuda"), (False, "cpu")):
        monkeypatch.setattr(torch.cuda, "is_available", lambda there=there: there)
        assert torch_device("auto").type == expected
        assert torch_device("cpu").type == "cpu"


def test_a_gpu_that_is_not_there_is_told(monkeypatch: pytest.MonkeyPatch, part: Part, caster: RayCaster) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    w_obj = mid_section_points(part.box_min, part.box_max, REGION.axis)
    with pytest.raises(PreparationError, match="--device cuda: torch finds no GPU on this machine: give --device cpu"):
        train_autoencoder(part, caster, REGION, w_obj, TINY, seed=0, device="cuda")


def test_settings_of_convolutions_are_as_before_afterwards() -> None:
    before = (torch.backends.cudnn.deterministic, torch.backends.cudnn.benchmark)
    for name, repeatable in (("cpu", before[0]), ("cuda", True)):
        with repeatable_convolutions(torch.device(name)):
            assert torch.backends.cudnn.deterministic == repeatable
        assert (torch.backends.cudnn.deterministic, torch.backends.cudnn.benchmark) == before


def trained_on(device: str, part: Part, caster: RayCaster) -> TrainedRegion:
    w_obj = mid_section_points(part.box_min, part.box_max, REGION.axis)
    return train_autoencoder(part, caster, REGION, w_obj, TINY, seed=3, device=device)  # type: ignore[arg-type]


def untrained(device: Device) -> AutoencoderGenerator:
    """Of a part "bolt"."""
    networks = Decoder(TINY.shape), {name: LatentRegressor(TINY.shape) for name in POINT_SETS}
    stored = RegionAutoencoder.of_networks(TINY.shape, *networks, {name: np.zeros((4, 3)) for name in POINT_SETS})
    return AutoencoderGenerator({REGION.index: stored}, "bolt", device)


def test_a_missing_gpu_is_not_taken_for_a_damaged_network(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with pytest.raises(PreparationError, match=r"^--device cuda: torch finds no GPU on this machine"):
        untrained("cuda").edge_image(np.zeros((4, 2)), REGION.index)


def test_tensors_of_two_devices_never_meet(monkeypatch: pytest.MonkeyPatch, part: Part, caster: RayCaster) -> None:
    """Training and painting as on a GPU, on torch's device without memory, which is there on every machine."""

    def without_memory(device: str) -> torch.device:
        return torch.device("meta" if device == "cuda" else device)

    for module in (training, image_generator):
        monkeypatch.setattr(module, "torch_device", without_memory)
    # What is read back has no values there.
    monkeypatch.setattr(torch.Tensor, "item", lambda _: 0.5)
    to_cpu = torch.Tensor.cpu
    monkeypatch.setattr(torch.Tensor, "cpu", lambda t: torch.zeros(t.shape) if t.is_meta else to_cpu(t))
    stored = {REGION.index: trained_on("cuda", part, caster).autoencoder}
    generator = AutoencoderGenerator(stored, "part", "cuda")
    assert generator.edge_image(POINTS, 4).shape == (32, 32)
    assert generator.edge_image_derivatives(POINTS, 4)[1].shape == (32, 32, 8)


@needs_gpu
def test_a_gpu_trains_to_the_same_weights_twice(part: Part, caster: RayCaster) -> None:
    first, again = (trained_on("cuda", part, caster) for _ in range(2))
    for name, value in first.autoencoder.tensors.items():
        np.testing.assert_array_equal(value, again.autoencoder.tensors[name], err_msg=name)
    assert replace(first.report, train_s=0.0) == replace(again.report, train_s=0.0)


@needs_gpu
def test_a_gpu_paints_what_the_cpu_paints(part: Part, caster: RayCaster) -> None:
    stored = {REGION.index: trained_on("cuda", part, caster).autoencoder}
    on_cpu, on_gpu = (AutoencoderGenerator(stored, "part", device) for device in ("cpu", "cuda"))  # type: ignore[arg-type]
    np.testing.assert_allclose(on_gpu.edge_image(POINTS, 4), on_cpu.edge_image(POINTS, 4), atol=1e-3)
    for ours, theirs in zip(
        on_gpu.edge_image_derivatives(POINTS, 4), on_cpu.edge_image_derivatives(POINTS, 4), strict=True
    ):
        np.testing.assert_allclose(ours, theirs, atol=1e-2)


def test_a_full_gpu_is_not_taken_for_a_damaged_network(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(networks: object, on: torch.device) -> None:
        raise torch.OutOfMemoryError("CUDA out of memory")

    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(image_generator._Networks, "moved", full)
    with pytest.raises(PreparationError, match=r"^bolt: the GPU has no memory left"):
        untrained("cuda").edge_image(np.zeros((4, 2)), REGION.index)
