"""Watching a training: every epoch of every stage, what it paints by then, and no difference to the result."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from acp_lab.cad.part import Part
from acp_lab.cad.raycast import RayCaster
from acp_lab.control_points.coplanar_points import mid_section_points
from acp_lab.control_points.view_regions import ALL_REGIONS
from acp_lab.generator.painted.config import AutoencoderConfig, NetworkShape
from acp_lab.generator.painted.edge_images import EdgeImageConfig
from acp_lab.generator.painted.image_generator import AutoencoderGenerator
from acp_lab.generator.painted.training import GRID_ROWS, TrainedRegion, train_autoencoder
from acp_lab.generator.painted.watch import STAGE_NAMES, Watch, WatchedEpoch

pytestmark = pytest.mark.usefixtures("one_torch_thread")

REGION = ALL_REGIONS[4]
TINY = AutoencoderConfig(
    images=EdgeImageConfig(size=32, views=16, held_out=GRID_ROWS + 1),
    shape=NetworkShape(latent=8, widths=(8, 8, 4), hidden=16),
    autoencoder_epochs=2,
    latent_epochs=1,
    fine_tune_epochs=2,
    second_epochs=1,
    batch=8,
)


def trained(part: Part, caster: RayCaster, watch: Watch | None = None) -> TrainedRegion:
    w_obj = mid_section_points(part.box_min, part.box_max, REGION.axis)
    return train_autoencoder(part, caster, REGION, w_obj, TINY, 3, watch=watch)


def test_every_epoch_is_shown_and_nothing_is_changed(part: Part, caster: RayCaster) -> None:
    seen: list[WatchedEpoch] = []
    watched, alone = trained(part, caster, seen.append), trained(part, caster)
    for name, value in alone.autoencoder.tensors.items():
        np.testing.assert_array_equal(watched.autoencoder.tensors[name], value, err_msg=name)
    assert replace(watched.report, train_s=0.0) == replace(alone.report, train_s=0.0)

    stages = [STAGE_NAMES[k] for k in (0, 0, 1, 2, 2, 3)]
    assert [(view.stage, view.epoch, view.done) for view in seen] == [
        (stage, epoch, done) for done, (stage, epoch) in enumerate(zip(stages, (1, 2, 1, 1, 2, 1), strict=True), 1)
    ]
    assert {view.total for view in seen} == {6}
    assert seen[1].loss == watched.report.autoencoder_loss
    for view in seen:
        assert view.truth.shape == view.painted.shape == (GRID_ROWS, 32, 32)
        np.testing.assert_array_equal(view.truth, seen[0].truth)
        mean_square = ((view.painted - view.truth) ** 2).mean((1, 2))
        assert view.inverse_psnr == pytest.approx(np.mean(-0.1 / np.log10(mean_square)), rel=1e-4)
        cross = view.truth * np.log(view.painted) + (1.0 - view.truth) * np.log(1.0 - view.painted)
        assert view.bce == pytest.approx(-cross.mean(), rel=1e-4)
        assert view.held_out_loss == pytest.approx(view.bce + 0.5 * view.inverse_psnr)
    assert np.abs(seen[1].painted - seen[0].painted).max() > 1e-4


def test_codes_and_pictures_are_the_two_halves_of_the_generator(part: Part, caster: RayCaster) -> None:
    generator = AutoencoderGenerator({4: trained(part, caster).autoencoder})
    points = np.array([[[6.0, 7.0], [25.0, 6.5], [24.0, 26.0], [7.0, 25.0]]])
    codes = generator.latent_codes(points, 4, "mid-section")
    assert codes.shape == (1, 8)
    np.testing.assert_array_equal(generator.painted(codes, 4), generator.edge_images(points, 4, "mid-section"))
    assert np.abs(generator.painted(codes + 1.0, 4) - generator.painted(codes, 4)).max() > 1e-5
