"""Training of the edge image generator: repeatable, resumable, and it does learn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
import torch

from acp_lab.cad.part import Part
from acp_lab.cad.raycast import RayCaster
from acp_lab.control_points.coplanar_points import mid_section_points
from acp_lab.control_points.view_regions import ALL_REGIONS
from acp_lab.generator.painted.checkpoint import Checkpoint, load_checkpoint
from acp_lab.generator.painted.config import AutoencoderConfig, AutoencoderReport, NetworkShape
from acp_lab.generator.painted.edge_images import EdgeImageConfig
from acp_lab.generator.painted.image_generator import POINT_SETS, AutoencoderGenerator, RegionAutoencoder
from acp_lab.generator.painted.training import TrainedRegion, one_cycle, train_autoencoder
from acp_lab.geometry.arrays import FloatArray

pytestmark = pytest.mark.usefixtures("one_torch_thread")

REGION = ALL_REGIONS[4]
TINY = AutoencoderConfig(
    images=EdgeImageConfig(size=32, frame="prediction", views=16, held_out=3),
    shape=NetworkShape(latent=8, widths=(8, 8, 4), hidden=16),
    autoencoder_epochs=2,
    latent_epochs=1,
    fine_tune_epochs=2,
    second_epochs=1,
    batch=8,
)


class Stop(Exception):
    """Ctrl-C."""


def stop_after(epochs: int) -> Callable[[int, int], None]:
    def progress(done: int, total: int) -> None:
        if done == epochs:
            raise Stop

    return progress


@pytest.fixture(scope="module")
def w_obj(part: Part) -> FloatArray:
    """Control points that are not the middle section's."""
    return mid_section_points(part.box_min, part.box_max, REGION.axis) + np.array([0.0, 0.0, 4.0])


@pytest.fixture(scope="module")
def in_one_go(part: Part, caster: RayCaster, w_obj: FloatArray) -> TrainedRegion:
    return train_autoencoder(part, caster, REGION, w_obj, TINY, seed=3)


def assert_same(first: TrainedRegion, other: TrainedRegion) -> None:
    assert sorted(first.autoencoder.tensors) == sorted(other.autoencoder.tensors)
    for name, value in first.autoencoder.tensors.items():
        np.testing.assert_array_equal(value, other.autoencoder.tensors[name], err_msg=name)
    np.testing.assert_array_equal(first.grid, other.grid)
    assert replace(first.report, train_s=0.0) == replace(other.report, train_s=0.0)


def test_the_same_seed_gives_the_same_networks(
    part: Part, caster: RayCaster, w_obj: FloatArray, in_one_go: TrainedRegion
) -> None:
    torch.manual_seed(7)  # whatever else was drawn before does not matter
    state = torch.random.get_rng_state()
    assert_same(in_one_go, train_autoencoder(part, caster, REGION, w_obj, TINY, seed=3))
    assert torch.equal(state, torch.random.get_rng_state()), "training disturbs the random numbers of others"
    other = train_autoencoder(part, caster, REGION, w_obj, TINY, seed=4)
    assert not np.array_equal(other.grid, in_one_go.grid)


def test_more_threads_change_nothing(
    part: Part, caster: RayCaster, w_obj: FloatArray, in_one_go: TrainedRegion
) -> None:
    torch.set_num_threads(3)  # the fixture sets it back
    assert_same(in_one_go, train_autoencoder(part, caster, REGION, w_obj, TINY, seed=3))
    assert torch.get_num_threads() == 3


@pytest.mark.parametrize("stops", [(1,), (2,), (3, 5), (6,)], ids=str)
def test_an_interrupted_training_goes_on_to_the_same_numbers(
    part: Part, caster: RayCaster, w_obj: FloatArray, in_one_go: TrainedRegion, stops: tuple[int, ...], tmp_path: Path
) -> None:
    path = tmp_path / "half.safetensors"
    for stop in stops:
        with pytest.raises(Stop):
            train_autoencoder(part, caster, REGION, w_obj, TINY, 3, stop_after(stop), path)
    told: list[tuple[int, int]] = []
    trained = train_autoencoder(
        part, caster, REGION, w_obj, TINY, 3, lambda done, total: told.append((done, total)), path
    )
    assert told == [(done, 6) for done in range(stops[-1] + 1, 7)]
    assert_same(in_one_go, trained)


def test_a_checkpoint_of_something_else_is_not_taken_up(
    part: Part, caster: RayCaster, w_obj: FloatArray, tmp_path: Path
) -> None:
    path = tmp_path / "half.safetensors"
    with pytest.raises(Stop):
        train_autoencoder(part, caster, REGION, w_obj, TINY, 3, stop_after(4), path)
    settings = [(w_obj, TINY, 4), (w_obj, replace(TINY, batch=4), 3), (w_obj + 1.0, TINY, 3)]
    for points, config, seed in settings:
        told: list[int] = []

        def first_only(done: int, total: int, told: list[int] = told) -> None:
            told.append(done)
            raise Stop

        copy = tmp_path / "copy.safetensors"
        copy.write_bytes(path.read_bytes())
        with pytest.raises(Stop):
            train_autoencoder(part, caster, REGION, points, config, seed, first_only, copy)
        assert told == [1]


def test_fine_tuning_can_be_switched_off(part: Part, caster: RayCaster, w_obj: FloatArray) -> None:
    told: list[int] = []
    trained = train_autoencoder(
        part, caster, REGION, w_obj, replace(TINY, fine_tune_epochs=0), 0, lambda done, total: told.append(total)
    )
    assert told == [4] * 4
    assert trained.report.fine_tune_loss == 0.0
    assert trained.report.second_loss > 0.0


def test_what_comes_back(in_one_go: TrainedRegion, w_obj: FloatArray, part: Part) -> None:
    stored = in_one_go.autoencoder
    assert stored.size == 32
    assert in_one_go.grid.shape == (3 * 34 - 2, 3 * 34 - 2)
    generator = AutoencoderGenerator({4: stored})
    np.testing.assert_array_equal(generator.points_obj(4, "regressed"), w_obj)
    np.testing.assert_array_equal(
        generator.points_obj(4, "mid-section"), mid_section_points(part.box_min, part.box_max, REGION.axis)
    )
    values = asdict(in_one_go.report)
    assert AutoencoderReport.from_json(values) == in_one_go.report
    del values["bias_percent"]  # parts of earlier versions do not know it
    assert AutoencoderReport.from_json(values).bias_percent is None
    back = RegionAutoencoder.from_arrays(stored.arrays())
    assert sorted(back.tensors) == sorted(stored.tensors)
    assert {name.split(".")[0] for name in stored.tensors} == {"decoder", *POINT_SETS}
    with pytest.raises(ValueError, match="not an auto-encoder"):
        RegionAutoencoder.from_arrays({**stored.arrays(), "sizes": stored.sizes + 5})


@pytest.mark.slow
def test_it_learns(part: Part, caster: RayCaster, w_obj: FloatArray) -> None:
    """A small one learns to paint views it never saw; coarsely, but far better than chance."""
    config = AutoencoderConfig(
        images=EdgeImageConfig(size=64, views=120, held_out=12, shift=0.02, roll_deg=1.0, scale=0.01, overlap=0.0),
        shape=NetworkShape(latent=48, widths=(32, 24, 16), hidden=64),
        autoencoder_epochs=8,
        latent_epochs=8,
        fine_tune_epochs=8,
        second_epochs=8,
        batch=8,
    )
    report = train_autoencoder(part, caster, REGION, w_obj, config, seed=0).report
    for quality in (report.generated, report.mid_section, report.reconstructed):
        assert quality.generated_to_true_px < 1.2
        assert quality.true_to_generated_px < 1.5
        assert quality.f_score > 0.5
    assert report.bias_percent is not None
    assert 0.0 < report.bias_percent < 20.0


# ---- small pieces --------------------------------------------------------------------------------------------


def test_the_learning_rate_rises_and_falls() -> None:
    rates = [one_cycle(share) for share in np.linspace(0.0, 1.0, 101)]
    top = int(np.argmax(rates))
    assert rates[0] == pytest.approx(0.04)
    assert (top, rates[top]) == (20, 1.0)
    assert rates[-1] == pytest.approx(0.0)
    assert (np.diff(rates[: top + 1]) > 0).all()
    assert (np.diff(rates[top:]) < 0).all()


def test_checkpoints_come_back_whole_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "folder" / "half.safetensors"
    made = Checkpoint("mine", 2, 3, 40, 12.5, (0.5, 0.25, 0.125), {"weight": torch.arange(6.0).reshape(2, 3)})
    assert load_checkpoint(path, "mine") is None
    made.save(path)
    back = load_checkpoint(path, "mine")
    assert back == replace(made, tensors=back.tensors if back else {})
    assert back is not None
    torch.testing.assert_close(back.tensors["weight"], made.tensors["weight"])
    assert load_checkpoint(path, "another's") is None
    assert [p.name for p in path.parent.iterdir()] == ["half.safetensors"]
    path.write_bytes(path.read_bytes()[:-5])
    assert load_checkpoint(path, "mine") is None
    path.write_bytes(b"")
    assert load_checkpoint(path, "mine") is None


def test_a_checkpoint_that_was_read_holds_its_file_no_longer(tmp_path: Path) -> None:
    """Windows replaces no file that is mapped; elsewhere, what is mapped changes with the file."""
    path = tmp_path / "half.safetensors"
    values = torch.arange(100_000.0)
    Checkpoint("mine", 0, 1, 1, 0.0, (), {"values": values}).save(path)
    back = load_checkpoint(path, "mine")
    assert back is not None
    with path.open("r+b") as file:
        file.write(bytes(path.stat().st_size))
    torch.testing.assert_close(back.tensors["values"], values)
