"""The paper's path from end to end: a tiny auto-encoder is trained, saved, loaded, and tracks."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from acp_lab.tracking.method_tracker import MethodTracker

from acp_lab.cad.part import Part
from acp_lab.cad.raycast import make_caster
from acp_lab.control_points.coplanar_points import mid_section_points
from acp_lab.control_points.view_regions import ALL_REGIONS
from acp_lab.generator.painted.config import AutoencoderConfig, NetworkShape
from acp_lab.generator.painted.edge_images import EdgeImageConfig
from acp_lab.generator.painted.training import train_autoencoder
from acp_lab.prepared_part import PreparedPart, Trained
from acp_lab.tracking.method import ACP_PAPER, DIRECT_6DOF, UNOPTIMISED_POINTS, MethodConfig
from tests.made_parts import box, looking_at
from tests.tracking.rendered import STEP, MadeSequence, add_percent, draw, poses, prepared

REGION = 4
TINY = AutoencoderConfig(
    images=EdgeImageConfig(size=64, views=96, held_out=8, overlap=0.1, nearest=2.5, farthest=6.0),
    shape=NetworkShape(size=64, latent=32, widths=(16, 16, 8), hidden=64),
    autoencoder_epochs=5,
    latent_epochs=4,
    fine_tune_epochs=4,
    second_epochs=4,
)


@pytest.fixture(scope="module")
def plate() -> Part:
    return box((60.0, 40.0, 4.0))


@pytest.fixture(scope="module")
def sequence(plate: Part) -> MadeSequence:
    truth = poses(plate, looking_at(plate, np.array([0.4, 0.3, 1.0]), 260.0, 0.3), 5, 0.5 * STEP)
    return MadeSequence([draw([(plate, pose)], seed) for seed, pose in enumerate(truth)], {1: truth})


@pytest.fixture(scope="module")
def model(plate: Part, tmp_path_factory: pytest.TempPathFactory) -> PreparedPart:
    w = mid_section_points(plate.box_min, plate.box_max, ALL_REGIONS[REGION].axis)
    trained = train_autoencoder(plate, make_caster(plate), ALL_REGIONS[REGION], w, TINY, seed=0)
    folder: Path = tmp_path_factory.mktemp("parts") / plate.name
    replace(
        prepared(plate),
        regressed_points=Trained({REGION: w}, {REGION: {"region": REGION}}),
        autoencoders=Trained({REGION: trained.autoencoder}, {REGION: trained.report}),
    ).save(folder)
    return PreparedPart.load(folder)


@pytest.mark.slow
@pytest.mark.parametrize("method", [ACP_PAPER, DIRECT_6DOF, UNOPTIMISED_POINTS], ids=lambda method: method.name)
def test_the_paper_and_its_ablations_follow_a_plate(
    method: MethodConfig, plate: Part, model: PreparedPart, sequence: MadeSequence
) -> None:
    run = MethodTracker(model, method).run(sequence, sequence.first_pose)
    assert run.method == method.name
    assert {result.region for result in run.results[1]} == {REGION}
    for result in run.results[1]:
        truth = sequence.truth(result.frame_id, 1)
        assert truth is not None
        assert add_percent(plate, result.cam_T_obj, truth) < 8.0
