"""Training of the visibility network: repeatable, and good on views it never saw."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import torch

from acp_lab.cad.edges import EdgeSamples, facing, sample_edges, visible_samples
from acp_lab.cad.part import Part
from acp_lab.cad.raycast import RayCaster
from acp_lab.control_points.canonical_frame import eye_position
from acp_lab.control_points.view_regions import ALL_REGIONS, sample_directions
from acp_lab.generator.painted.config import AutoencoderConfig
from acp_lab.generator.templates import RAY_OFFSET_IN_DIAMETERS
from acp_lab.generator.visibility import RegionNetwork, VisibilityNetwork
from acp_lab.generator.visibility_training import (
    TrainingConfig,
    TrainingReport,
    _make_views,
    _network,
    _Views,
    train_region,
)
from tests.made_parts import looking_at

REGION = ALL_REGIONS[4]
TINY = TrainingConfig(views=60, held_out=10, epochs=3, batch=20, hidden=16)
SMALL = TrainingConfig(views=250, held_out=60, epochs=40, batch=25, peak_rate=1e-2, hidden=64)


@pytest.fixture(scope="module", autouse=True)
def one_thread() -> Iterator[None]:
    """Matrices this small gain nothing from a second one, and two that wait for each other on a busy machine crawl."""
    import torch

    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@pytest.fixture(scope="module")
def edges(part: Part) -> EdgeSamples:
    """A third as many as usual."""
    return sample_edges(part, spacing_mm=1.5)


def test_the_same_seed_gives_the_same_weights(part: Part, edges: EdgeSamples, caster: RayCaster) -> None:
    import torch

    torch.manual_seed(1)
    first, report = train_region(part, edges, caster, REGION, TINY, seed=3)
    torch.manual_seed(2)  # whatever else was drawn before does not matter
    state = torch.random.get_rng_state()
    again, report_again = train_region(part, edges, caster, REGION, TINY, seed=3)
    assert torch.equal(state, torch.random.get_rng_state()), "training disturbs the random numbers of others"
    for name, value in vars(first).items():
        np.testing.assert_array_equal(value, getattr(again, name), err_msg=name)
    assert report == report_again
    other, _ = train_region(part, edges, caster, REGION, TINY, seed=4)
    assert not np.array_equal(first.weight1, other.weight1)


def test_views_that_are_held_out_have_no_say_in_the_network(
    part: Part, edges: EdgeSamples, caster: RayCaster, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither in its weights, nor in how its inputs are scaled or for which samples it answers."""
    network, _ = train_region(part, edges, caster, REGION, TINY, seed=3)

    def others_held_out(*args: Any) -> _Views:
        views = _make_views(*args)
        views.inputs[TINY.views :] += 5.0
        views.asked[TINY.views :] = True
        return views

    monkeypatch.setattr("acp_lab.generator.visibility_training._make_views", others_held_out)
    again, _ = train_region(part, edges, caster, REGION, TINY, seed=3)
    for name, value in vars(network).items():
        np.testing.assert_array_equal(value, getattr(again, name), err_msg=name)


def test_shapes_and_types_are_those_that_are_stored(part: Part, edges: EdgeSamples, caster: RayCaster) -> None:
    told: list[tuple[int, int]] = []
    network, report = train_region(
        part, edges, caster, REGION, TINY, seed=0, progress=lambda done, total: told.append((done, total))
    )
    m = len(network.rows)
    shapes = {
        "weight1": (16, 8),
        "bias1": (16,),
        "weight2": (16, 16),
        "bias2": (16,),
        "weight3": (m, 16),
        "bias3": (m,),
    }
    for name, shape in shapes.items():
        value = getattr(network, name)
        assert value.shape == shape, name
        assert value.dtype == np.float32, name
    assert network.rows.dtype == np.int32
    assert (np.diff(network.rows) > 0).all()
    assert 0 < m <= len(edges)
    assert told == [(1, 3), (2, 3), (3, 3)]
    assert report.region == REGION.index
    assert 0.0 < report.final_loss < 1.0


@pytest.fixture(scope="module")
def trained(part: Part, edges: EdgeSamples, caster: RayCaster) -> tuple[RegionNetwork, TrainingReport]:
    return train_region(part, edges, caster, REGION, SMALL, seed=0)


def test_views_it_never_saw_are_answered_well(
    part: Part, edges: EdgeSamples, caster: RayCaster, trained: tuple[RegionNetwork, TrainingReport]
) -> None:
    network, report = trained
    generator = VisibilityNetwork(part, edges, {REGION.index: network}, None)
    both = called = free = hidden = called_hidden = 0
    for number, direction in enumerate(sample_directions(REGION, 0.5 * part.box_size, 60, seed=99)):
        pose = looking_at(part, direction, (2.0 + 0.1 * number) * part.diameter, roll_rad=0.1 * number)
        eye_obj = eye_position(pose)
        shows = facing(edges, eye_obj).shows
        truth = visible_samples(edges, caster, eye_obj, RAY_OFFSET_IN_DIAMETERS * part.diameter)
        answer = np.zeros(len(edges), bool)
        answer[generator.visible(pose, REGION.index, 10**6).ids] = True
        both, called, free = both + (answer & truth).sum(), called + answer.sum(), free + truth.sum()
        hidden, called_hidden = hidden + (shows & ~truth).sum(), called_hidden + (shows & ~truth & ~answer).sum()
    assert both / called > 0.98
    assert both / free > 0.98
    # Hidden samples are rare: who calls everything free reaches such numbers, but finds none of them.
    assert called_hidden / hidden > 0.6
    assert report.precision == pytest.approx(both / called, abs=0.02)
    assert report.recall == pytest.approx(both / free, abs=0.02)


def test_the_fast_settings_train_less() -> None:
    fast, full = TrainingConfig.fast(), TrainingConfig()
    assert fast.views * fast.epochs < full.views * full.epochs / 4
    assert (fast.hidden, fast.overlap) == (full.hidden, full.overlap)


def test_the_usual_views_leave_no_gap_in_the_region(part: Part) -> None:
    """From anywhere in the region the nearest training view is a few degrees away; a tenth of them leaves holes."""
    config, half_size = TrainingConfig(), 0.5 * part.box_size
    asked = sample_directions(REGION, half_size, 2000, seed=5)
    gaps = {}
    for views in (config.views, config.views // 10):
        trained = sample_directions(REGION, half_size, views, config.overlap, seed=0)
        gaps[views] = np.degrees(np.arccos(np.clip((asked @ trained.T).max(1), -1.0, 1.0))).max()
    assert gaps[config.views] < 7.0 < 10.0 < gaps[config.views // 10]


def test_all_views_asked_for_are_made(
    part: Part, edges: EdgeSamples, caster: RayCaster, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Enough(Exception):
        pass

    counts = []

    def counted(*args: object, **options: object) -> np.ndarray:
        counts.append(args[2])
        raise Enough

    monkeypatch.setattr("acp_lab.generator.visibility_training.sample_directions", counted)
    with pytest.raises(Enough):
        train_region(part, edges, caster, REGION, TrainingConfig(), seed=0)
    assert counts == [TrainingConfig().views + TrainingConfig().held_out]
    printed = AutoencoderConfig.as_printed().images
    assert TrainingConfig().views == printed.views == 1000, "paper IV-A: about 1000 views per region"


def test_no_gpu_is_asked_for_its_random_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    """One that is full, or another's alone, would end a training that runs on the CPU."""

    def full(device: object = None) -> torch.Tensor:
        raise torch.OutOfMemoryError

    monkeypatch.setattr(torch.cuda, "device_count", lambda: 1)
    monkeypatch.setattr(torch.cuda, "get_rng_state", full)
    assert len(_network(4, 2, 0)) == 5
