"""The two directions of I that no rigid motion makes, and how far a run has gone along them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from acp_lab.control_points.coplanar_points import mid_section_points
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import make_pose, so3_exp, transform
from acp_lab.geometry.pose_step import move_pose
from acp_lab.studies.redundancy import drift, misfit_px, redundant_directions, rigid_share
from acp_lab.tracking.method import ACP_PAPER_SAMPLES
from acp_lab.tracking.motions import ControlPointVariables
from acp_lab.tracking.session import TrackRun
from acp_lab.tracking.sources.rigid import CadSamples
from acp_lab.tracking.tracker import Tracker
from tests.prepared_sample import sample_model, sample_scene

CENTRE = np.array([3.0, -4.0, 5.0])
HALF_SIZE = np.array([30.0, 20.0, 10.0])
POINTS = mid_section_points(CENTRE - HALF_SIZE, CENTRE + HALF_SIZE, 2)
POSE = make_pose(so3_exp(np.array([0.3, -0.4, 0.2])), np.array([10.0, -5.0, 400.0]))


def seen(camera: Camera, pose: np.ndarray) -> np.ndarray:
    return camera.project(transform(pose, POINTS))


def test_rigid_motions_do_not_touch_the_redundant_directions(camera: Camera) -> None:
    redundant = redundant_directions(POINTS, POSE, CENTRE, camera)
    np.testing.assert_allclose(redundant @ redundant.T, np.eye(2), atol=1e-12)
    for step in 1e-5 * np.eye(6) * [1, 1, 1, 100, 100, 100]:
        moved = (seen(camera, move_pose(POSE, CENTRE, step)) - seen(camera, POSE)).reshape(8)
        assert rigid_share(moved, redundant) > 1.0 - 1e-6
    assert rigid_share(redundant[0] - 2.0 * redundant[1], redundant) == pytest.approx(0.0, abs=1e-12)


def test_shares_of_all_directions_add_up_to_six(camera: Camera) -> None:
    redundant = redundant_directions(POINTS, POSE, CENTRE, camera)
    assert sum(rigid_share(unit, redundant) for unit in np.eye(8)) == pytest.approx(6.0)


def test_misfit_is_a_root_mean_square_over_the_points(camera: Camera) -> None:
    points = seen(camera, POSE)
    assert misfit_px(points, POINTS, POSE, camera) == pytest.approx(0.0, abs=1e-9)
    points[0] += (3.0, 4.0)
    assert misfit_px(points, POINTS, POSE, camera) == pytest.approx(2.5)


def test_drift_of_a_run() -> None:
    scene, model = sample_scene(), sample_model()
    method = replace(
        ACP_PAPER_SAMPLES,
        source=CadSamples("templates", inset_outlines=True),
        control_points="mid-section",
        variables=ControlPointVariables(carry="points"),
    )
    tracker = Tracker(model, method)
    results = (tracker.start(scene.frame(0), scene.first_pose), *(tracker.track(scene.frame(i)) for i in (1, 2)))
    run = TrackRun("sample", 1, "points", {1: results})
    one = drift(run, scene, model.part, lambda region: model.control_points(region, "mid-section"))
    assert one.frame_ids.tolist() == [0, 1, 2]
    assert (one.misfits_px > 0.01).all()
    assert (one.errors < 0.1).all()
