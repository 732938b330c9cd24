"""Aligning one frame: what is seen at a pose, where the solver goes from there, and when it gives up."""

from __future__ import annotations

from dataclasses import replace

import acp_lab.tracking.alignment as alignment_module
import numpy as np
import pytest
from acp_lab.tracking.alignment import Aligner, Level, SolverConfig, Stopwatch

from acp_lab.cad.part import Part
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import disturb_pose, transform
from acp_lab.geometry.pose_step import centre_position, move_pose
from acp_lab.imaging.edge_search import ImagePatch
from acp_lab.prepared_part import PreparedPart
from acp_lab.tracking.recovery import shifted_poses, try_poses
from acp_lab.tracking.tracker import Tracker, TrackerConfig
from tests.tracking.rendered import CAMERA, MadeSequence, add_percent

REGION = 4


@pytest.fixture
def aligner(model: PreparedPart) -> Aligner:
    return Tracker(model).aligner


@pytest.fixture
def truth(sequence: MadeSequence) -> FloatArray:
    return sequence.first_pose


@pytest.fixture
def patch(aligner: Aligner, sequence: MadeSequence, truth: FloatArray) -> ImagePatch:
    (frame,) = sequence.frames(1)
    found = aligner.patch(frame.image, CAMERA, truth, 32.0)  # type: ignore[union-attr]
    assert found is not None
    return found


# ---- one frame -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("angle_deg", "shift_mm"), [(0.0, 0.0), (2.0, 2.0), (4.0, 4.0)])
def test_the_solver_comes_back_to_the_truth(
    part: Part,
    aligner: Aligner,
    patch: ImagePatch,
    truth: FloatArray,
    angle_deg: float,
    shift_mm: float,
) -> None:
    for seed in range(3):
        start = disturb_pose(truth, part.box_centre, angle_deg, shift_mm, np.random.default_rng(seed))
        found = aligner.align(patch, CAMERA, start, REGION, Stopwatch(), use_memory=False)
        assert found is not None
        assert add_percent(part, found.cam_T_obj, truth) < 1.5
        assert found.quality > 0.7
        assert 0.0 <= found.loss < 0.4
        solver = aligner.solver
        assert found.iterations == len(solver.levels) * solver.steps_per_level


def test_a_fit_is_judged_worse_away_from_the_truth(
    part: Part, aligner: Aligner, patch: ImagePatch, truth: FloatArray
) -> None:
    seen = aligner.observe(patch, CAMERA, truth, REGION, Level(8, 1.0, 500), Stopwatch(), use_memory=False)
    assert seen is not None
    there = aligner.judge(seen, CAMERA, truth)
    aside = aligner.judge(seen, CAMERA, move_pose(truth, part.box_centre, np.array([0.0, 0, 0, 3.0, 0, 0])))
    assert there.quality > 1.5 * aside.quality
    assert there.loss < aside.loss
    residuals = there.residuals_px()
    assert np.nanmedian(np.abs(residuals)) < 0.3
    assert np.isfinite(residuals).mean() > 0.8


def test_what_is_seen_has_one_row_per_sample(aligner: Aligner, patch: ImagePatch, truth: FloatArray) -> None:
    seen = aligner.observe(patch, CAMERA, truth, REGION, Level(8, 1.0, 60), Stopwatch(), use_memory=True)
    assert seen is not None
    n, m = seen.scores.shape
    assert n == len(seen.visible.ids) == 60
    assert seen.points.shape == seen.normals.shape == (n, 2)
    assert seen.targets.shape == seen.candidates.offsets.shape == (n, m)
    edges = aligner.generator.edges
    np.testing.assert_allclose(
        seen.points, CAMERA.project(transform(truth, edges.points_obj[seen.visible.ids])), atol=1e-9
    )
    tangents = edges.tangents_obj[seen.visible.ids] @ truth[:3, :3].T
    ahead = CAMERA.project(transform(truth, edges.points_obj[seen.visible.ids]) + 1e-3 * tangents) - seen.points
    assert np.abs((ahead * seen.normals).sum(1)).max() < 1e-5
    np.testing.assert_allclose(np.linalg.norm(seen.normals, axis=1), 1.0)


def test_generated_edges_lie_at_the_solved_pose(
    part: Part, aligner: Aligner, patch: ImagePatch, truth: FloatArray
) -> None:
    start = disturb_pose(truth, part.box_centre, 2.0, 2.0, np.random.default_rng(0))
    found = aligner.align(patch, CAMERA, start, REGION, Stopwatch(), use_memory=False)
    assert found is not None
    edges = aligner.generated(found, CAMERA)
    points_obj = aligner.generator.edges.points_obj[edges.sample_ids]
    np.testing.assert_allclose(edges.points, CAMERA.project(transform(found.cam_T_obj, points_obj)), atol=1e-9)
    assert len(edges) == len(found.residuals_px())


def test_time_is_booked_by_stage(aligner: Aligner, patch: ImagePatch, truth: FloatArray) -> None:
    clock = Stopwatch()
    aligner.align(patch, CAMERA, truth, REGION, clock, use_memory=False)
    assert min(clock.generate_s, clock.search_s, clock.solve_s) > 0.0
    assert clock.image_s == clock.learn_s == 0.0


# ---- where nothing can be seen -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "shift",
    [(0.0, 0.0, -330.0), (0.0, 0.0, -900.0), (400.0, 0.0, 0.0), (0.0, -400.0, 0.0), (np.nan, 0.0, 0.0)],
    ids=["in the camera", "behind", "right of the image", "above it", "nowhere"],
)
def test_no_patch_where_the_part_is_not_in_view(
    part: Part, aligner: Aligner, truth: FloatArray, shift: tuple[float, float, float]
) -> None:
    pose = move_pose(truth, part.box_centre, np.array([0.0, 0.0, 0.0, *shift]))
    assert aligner.patch(np.zeros((160, 200, 3), np.uint8), CAMERA, pose, 32.0) is None


def test_a_part_much_larger_than_the_image_still_has_a_patch(part: Part, aligner: Aligner, truth: FloatArray) -> None:
    close = replace(CAMERA, fx=90_000.0, fy=90_000.0)
    patch = aligner.patch(np.zeros((160, 200, 3), np.uint8), close, truth, 32.0)
    assert patch is not None
    assert patch.channels.shape == (160, 200, 3)


def test_a_black_image_moves_nothing(aligner: Aligner, truth: FloatArray) -> None:
    patch = aligner.patch(np.zeros((160, 200, 3), np.uint8), CAMERA, truth, 32.0)
    assert patch is not None
    found = aligner.align(patch, CAMERA, truth, REGION, Stopwatch(), use_memory=False)
    assert found is not None
    np.testing.assert_allclose(found.cam_T_obj, truth, atol=1e-9)
    assert found.quality == 0.0
    assert np.isnan(found.residuals_px()).all()
    assert np.isfinite(found.loss)


@pytest.mark.parametrize("to_centre_mm", [10.0, 3.0, -50.0, np.nan])
def test_a_step_into_the_camera_is_no_pose(
    part: Part,
    aligner: Aligner,
    patch: ImagePatch,
    truth: FloatArray,
    monkeypatch: pytest.MonkeyPatch,
    to_centre_mm: float,
) -> None:
    """Some samples are behind the camera then, where nothing can be said of them."""
    depth = float(centre_position(truth, part.box_centre)[2])
    step = np.array([0.0, 0.0, 0.0, 0.0, 0.0, to_centre_mm - depth])
    monkeypatch.setattr(alignment_module, "gauss_newton_step", lambda *_: step)
    aligner.solver = SolverConfig(levels=(Level(8, 1.0),), steps_per_level=1)
    assert aligner.align(patch, CAMERA, truth, REGION, Stopwatch(), use_memory=False) is None


def test_too_few_visible_samples_are_not_enough(aligner: Aligner, patch: ImagePatch, truth: FloatArray) -> None:
    assert aligner.observe(patch, CAMERA, truth, REGION, Level(8, 1.0, 11), Stopwatch()) is None
    assert aligner.align(patch, CAMERA, truth, REGION, Stopwatch(), (Level(8, 1.0, 11),)) is None


# ---- recovery ------------------------------------------------------------------------------------------------


def test_shifted_poses_appear_beside_in_all_directions(part: Part, truth: FloatArray) -> None:
    camera = Camera(640, 512, 600.0, 620.0, 319.5, 250.25)
    shifted = shifted_poses(truth, part.box_centre, camera, 14.0)
    assert len(shifted) == 8
    centre = camera.project(centre_position(truth, part.box_centre)[None])[0]
    moved = np.array([camera.project(centre_position(pose, part.box_centre)[None])[0] for pose in shifted]) - centre
    np.testing.assert_allclose(np.hypot(*moved.T), 14.0, atol=1e-6)
    np.testing.assert_allclose(moved.sum(0), 0.0, atol=1e-6)
    for pose in shifted:
        np.testing.assert_allclose(pose[:3, :3], truth[:3, :3])


def test_from_several_starts_the_best_wins(part: Part, aligner: Aligner, patch: ImagePatch, truth: FloatArray) -> None:
    far = disturb_pose(truth, part.box_centre, 0.0, 28.0, np.random.default_rng(2))
    starts = (far, *shifted_poses(far, part.box_centre, CAMERA, 20.0), truth)
    found = try_poses(aligner, patch, CAMERA, starts, REGION)
    assert found is not None
    assert add_percent(part, found.cam_T_obj, truth) < 1.5
    assert try_poses(aligner, patch, CAMERA, [], REGION) is None
    behind = move_pose(truth, part.box_centre, np.array([0.0, 0, 0, 0, 0, -900.0]))
    assert try_poses(aligner, patch, CAMERA, [behind], REGION) is None


def test_the_settings_reach_the_solver(model: PreparedPart) -> None:
    config = TrackerConfig(solver=SolverConfig(steps_per_level=5))
    assert Tracker(model, config).aligner.solver.steps_per_level == 5
