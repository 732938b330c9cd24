"""What the network of edge profiles is trained on, how, and its command."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh
from safetensors.numpy import load_file

from acp_lab.cad.part import Part
from acp_lab.errors import InputFileError
from acp_lab.geometry.pose_step import move_pose
from acp_lab.tracking.learning.edge_profiles import FEATURES, ProfileConfig, save_network, shipped_network
from acp_lab.tracking.learning.edge_traits import EdgeTraits, TraitEvidence
from data_recipes import edge_profiles
from data_recipes.metal.random_parts import random_part
from data_recipes.metal.scene import make_scene
from data_recipes.profiles.examples import Examples, examples_of
from data_recipes.profiles.stills import (
    KNOWN_PARTS,
    SMEARED,
    Stills,
    plan_stills,
    read_stills,
    render_stills,
    write_stills,
)
from data_recipes.profiles.training import ProfileTraining, constant_loss, mean_loss, train, traits_of


@pytest.mark.parametrize("seed", range(0, 40, 4))
def test_random_parts_are_solid(seed: int) -> None:
    part = random_part(seed)
    mesh = trimesh.Trimesh(part.vertices, part.faces, process=False)
    assert mesh.is_volume
    assert mesh.body_count == 1
    np.testing.assert_allclose(part.vertices.min(0), -part.vertices.max(0), atol=1e-4)
    assert 70 <= np.linalg.norm(np.ptp(part.vertices, axis=0)) <= 125.01
    np.testing.assert_array_equal(part.vertices, random_part(seed).vertices)


def test_random_parts_differ() -> None:
    assert len({random_part(seed).vertices.tobytes() for seed in range(10)}) == 10


def test_no_part_that_checks_is_trained_on() -> None:
    from benchmarks.robustness import CHECKING

    assert not CHECKING & set(KNOWN_PARTS)


@pytest.fixture(scope="module")
def stills() -> Stills:
    return render_stills(3)


def test_scenes_are_the_same_every_time(stills: Stills) -> None:
    assert len(stills.images) == len(stills.cam_T_obj) == 6
    assert stills.images[0].shape == (stills.camera.height, stills.camera.width, 3)
    again = render_stills(3)
    np.testing.assert_array_equal(stills.cam_T_obj, again.cam_T_obj)
    assert np.abs(stills.images[2].astype(int) - again.images[2]).mean() < 0.5


def test_scenes_differ_in_all_that_matters() -> None:
    plans = [plan_stills(number) for number in range(40)]
    assert {plan.config.kind for plan in plans} == {"regular", "reflection", "rotation", "occlusion", "fast"}
    assert len({plan.config.edge_break_mm for plan in plans}) >= 5
    assert 0.2 < np.mean([plan.part.name in KNOWN_PARTS for plan in plans]) < 0.5
    # The views are far apart; what moves fast is exposed as if it did so between neighbouring frames.
    exposed = {plan.config.kind: plan.exposure_frames for plan in plans}
    assert exposed["fast"] > exposed["regular"]
    assert max(plan.exposure_frames for plan in plans) < 0.1
    smeared = [plan_stills(SMEARED + number) for number in range(10)]
    assert {plan.config.kind for plan in smeared} == {"fast"}
    assert np.mean([plan.exposure_frames for plan in smeared]) > 2 * exposed["fast"]
    assert len(smeared[0].passes) > len(plans[0].passes)


def test_motions_are_those_of_the_exposure(stills: Stills) -> None:
    """The poses are of its middle: half a motion on either side is what the truth says, but for its curvature."""
    plan, part = plan_stills(3), Part.from_mesh(stills.part.vertices, stills.part.faces, "part")
    scene = make_scene(plan.part, plan.config)
    for view in (0, 3):
        half = 0.5 * plan.exposure_frames
        begins, ends = (
            move_pose(stills.cam_T_obj[view], part.box_centre, side * 0.5 * stills.motions[view]) for side in (-1, 1)
        )
        np.testing.assert_allclose(begins, scene.truth.at(view - half), atol=0.02)
        np.testing.assert_allclose(ends, scene.truth.at(view + half), atol=0.02)
        assert np.linalg.norm(stills.motions[view, 3:]) > 0.2


def test_a_smeared_view_is_shown_with_its_smear_and_without(stills: Stills) -> None:
    still, slow, longer = (examples_of(replace(stills, motions=share * stills.motions)) for share in (0.0, 0.01, 4.0))
    assert not still.features[:, -1].any()
    assert len(slow) == len(still)
    assert np.expm1(longer.features[:, -1]).max() > 2.0
    unknown = longer.features[:, -1] == 0.0
    assert 0.3 < unknown.mean() < 0.7
    np.testing.assert_array_equal(longer.shifts_px[unknown][:50], still.shifts_px[:50])


def test_views_are_kept_in_a_file(stills: Stills, tmp_path: Path) -> None:
    path = tmp_path / "scene.npz"
    write_stills(path, stills)
    found = read_stills(path)
    np.testing.assert_array_equal(found.cam_T_obj, stills.cam_T_obj)
    np.testing.assert_array_equal(found.motions, stills.motions)
    np.testing.assert_array_equal(found.part.vertices, stills.part.vertices)
    assert found.camera == stills.camera
    assert found.edge_break_mm == stills.edge_break_mm
    # Nine tenths of JPEG's quality.
    assert np.abs(found.images[0].astype(int) - stills.images[0]).mean() < 5


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 cut off", b"no archive"])
def test_a_damaged_file_is_named(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "scene.npz"
    path.write_bytes(content)
    with pytest.raises(InputFileError, match=r"scene\.npz: holds no views"):
        read_stills(path)


def test_examples_say_where_the_cads_edges_are(stills: Stills) -> None:
    """With poses a px to the right of the true ones, upright edges lie a px to the right of the candidates."""
    examples = examples_of(stills)
    assert len(examples) > 1000
    assert examples.features.shape == (len(examples), FEATURES)
    assert np.abs(examples.shifts_px).max() < 2.5
    moved = examples_of(replace(stills, cam_T_obj=stills.cam_T_obj + _aside(stills, 1.0)))
    assert abs(_to_the_right(examples)) < 0.3
    assert _to_the_right(moved) == pytest.approx(1.0, abs=0.3)


def _to_the_right(examples: Examples) -> float:
    """Median px by which the CAD's upright edges lie to the right of their candidates."""
    normal_x = examples.features[:, FEATURES - 3]
    upright = np.abs(normal_x) > 0.9
    return float(np.median(examples.shifts_px[upright] / normal_x[upright]))


def _aside(stills: Stills, shift_px: float) -> np.ndarray:
    step = np.zeros_like(stills.cam_T_obj)
    step[:, 0, 3] = shift_px * stills.cam_T_obj[:, 2, 3] / stills.camera.fx
    return step


def test_a_hidden_part_teaches_nothing(stills: Stills) -> None:
    assert len(examples_of(replace(stills, visible=np.zeros(6)))) == 0


def made_examples(seed: int, trait: float = 0.0, count: int = 600) -> Examples:
    """A scene: the shift is what one feature says, more or less surely by another; a third says what a trait adds."""
    rng = np.random.default_rng(seed)
    features = rng.normal(0, 1, (count, FEATURES)).astype(np.float32)
    spread = np.where(features[:, 1] > 0, 0.5, 0.05)
    shifts = 0.4 * features[:, 0] + 0.5 * trait * features[:, 2] + spread * rng.standard_normal(count)
    jacobian = rng.normal(0, 1, (count, 6)).astype(np.float32)
    return Examples(features, shifts.astype(np.float32), jacobian, np.arange(count) % 6, np.ones(count, bool))


def made_scenes(count: int = 60) -> list[Examples]:
    traits = np.random.default_rng(99).standard_normal(count)
    return [made_examples(seed, float(trait)) for seed, trait in enumerate(traits)]


def test_training_finds_shift_and_spread(tmp_path: Path) -> None:
    losses = list[float]()
    config = ProfileTraining(hidden=16, epochs=12, traits=0)
    shown = [made_examples(seed) for seed in range(40)]
    network = train(shown, config, lambda done, loss: losses.append(loss))
    held_out = made_examples(99)
    assert losses[-1] < losses[0]
    assert mean_loss(network, held_out) < constant_loss(shown, [held_out]) - 0.4
    found = network(held_out.features)
    assert np.corrcoef(found[:, 0], held_out.features[:, 0])[0, 1] > 0.95
    says = held_out.features[:, 1]
    sure, unsure = (np.exp(found[rows, 1]).mean() for rows in (says < -1, says > 1))
    assert sure < 0.5 * unsure
    save_network(network, tmp_path / "weights.safetensors")
    arrays = load_file(tmp_path / "weights.safetensors")
    assert arrays.keys() == {"mean", "scale", *(f"{name}_{i}" for name in ("weight", "bias") for i in range(3))}


def test_training_finds_what_a_trait_moves() -> None:
    """Nobody tells it which feature says that, nor the traits of the scenes."""
    network = train(made_scenes(), ProfileTraining(hidden=16, epochs=12, traits=1))
    held_out = made_examples(1000, trait=1.5)
    slopes = network(held_out.features)[:, 2]
    assert abs(np.corrcoef(slopes, held_out.features[:, 2])[0, 1]) > 0.9
    assert mean_loss(network, held_out) < mean_loss(network, held_out, with_traits=False) - 0.3


def test_traits_are_those_that_a_tracker_finds() -> None:
    """Edge by edge the same sums, in pose steps of other units."""
    found = np.zeros((600, 4), np.float32)
    rng = np.random.default_rng(5)
    found[:, 1], found[:, 2:] = np.log(0.2), rng.normal(0, 0.3, (600, 2))
    jacobian = rng.normal(0, 1, (600, 6))
    shifts = found[:, 2:] @ np.array([0.8, -1.2]) + 0.1 * rng.standard_normal(600) + jacobian @ np.full(6, 0.2)
    told = traits_of(
        torch.from_numpy(found), torch.from_numpy(shifts.astype(np.float32)),
        torch.from_numpy(jacobian.astype(np.float32)), torch.zeros(600, dtype=torch.int64), torch.ones(600, dtype=bool),
    )  # fmt: skip
    config = ProfileConfig()
    traits = EdgeTraits(2, config.evidence_share, config.trait_memory, config.trait_shift_mm)
    px = np.array([*[0.1] * 3, *[20.0] * 2, 100.0])  # what is thought of each step beforehand, here 1 px
    slopes, spreads = found[:, 2:].astype(float), np.full(600, 0.2)
    traits.learn(TraitEvidence(-shifts, slopes, spreads, jacobian / px, 500.0, np.zeros(2)))
    np.testing.assert_allclose(traits.values, told, atol=0.03)
    np.testing.assert_allclose(traits.values, [0.8, -1.2], atol=0.1)


def test_training_is_the_same_every_time() -> None:
    config = ProfileTraining(hidden=8, epochs=1)
    one, other = (train(made_scenes(5), config)(made_examples(1).features) for _ in range(2))
    np.testing.assert_array_equal(one, other)


def test_the_shipped_network_is_of_the_configured_size() -> None:
    config = ProfileTraining()
    assert [weight.shape[1] for weight in shipped_network().weights] == [config.hidden] * 2 + [2 + config.traits]


@pytest.mark.slow
def test_the_command_renders_what_is_missing_and_trains(
    tmp_path: Path, stills: Stills, capsys: pytest.CaptureFixture[str]
) -> None:
    for number in range(3):
        write_stills(edge_profiles.scene_file(tmp_path, number), stills)
    weights = tmp_path / "weights.safetensors"
    asked = ["--out", str(tmp_path), "--scenes", "4", "--smeared", "0", "--epochs", "1", "--weights", str(weights)]
    assert edge_profiles.main(asked) == 0
    found = capsys.readouterr()
    assert "scene_00003: " in found.err
    assert "scene_00002: " not in found.err
    assert "loss on scenes held out" in found.out
    assert load_file(weights)["mean"].shape == (FEATURES,)


def test_too_few_scenes_are_refused(tmp_path: Path, stills: Stills, capsys: pytest.CaptureFixture[str]) -> None:
    write_stills(edge_profiles.scene_file(tmp_path, 0), stills)
    assert edge_profiles.main(["--out", str(tmp_path), "--scenes", "1", "--smeared", "0"]) == 2
    assert capsys.readouterr().err.startswith("error: --scenes 1: ")
