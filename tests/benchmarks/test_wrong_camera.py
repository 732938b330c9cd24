"""Which pose explains an image through a wrong camera, and what is made of the runs."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import transform
from benchmarks.wrong_camera import CAMERAS, CameraRun, _row, explained
from tests.made_parts import bracket, looking_at

CAMERA = Camera(640, 512, 700.0, 700.0, 319.5, 255.5)


def test_through_the_true_camera_it_is_the_true_pose() -> None:
    part = bracket()
    truth = looking_at(part, np.array([0.8, 0.6, 1.0]), 330.0, 0.3)
    found = explained(part, truth, CAMERA, CAMERAS["as it is"](CAMERA))
    np.testing.assert_allclose(found.cam_T_obj, truth, atol=1e-6)
    assert found.rms_px < 1e-6


@pytest.mark.parametrize(("camera", "farther"), [("focal length x0.95", 0.95), ("focal length x1.15", 1.15)])
def test_a_longer_focal_length_puts_the_part_farther_away(camera: str, farther: float) -> None:
    part = bracket()
    truth = looking_at(part, np.array([0.8, 0.6, 1.0]), 330.0, 0.3)
    found = explained(part, truth, CAMERA, CAMERAS[camera](CAMERA))
    depths = [transform(pose, part.box_centre)[2] for pose in (found.cam_T_obj, truth)]
    assert depths[0] / depths[1] == pytest.approx(farther, abs=0.01)
    assert 0.001 < found.rms_px < 1.0


def test_what_no_pose_explains_grows_with_the_error() -> None:
    part = bracket()
    truth = looking_at(part, np.array([0.8, 0.6, 1.0]), 330.0, 0.3)
    names = "as it is", "pixels 0.01 too high", "pixels 0.03 too high"
    misfits = [explained(part, truth, CAMERA, CAMERAS[name](CAMERA)).rms_px for name in names]
    assert misfits[0] < 0.1 * misfits[1] < 0.1 * misfits[2]
    assert explained(part, truth, CAMERA, CAMERAS["distortion 0.1"](CAMERA)).rms_px > 1e-3


def test_a_row_counts_frames_and_lost_runs() -> None:
    errors = np.array([0.01, 0.03, 0.2, 0.01])
    runs = [CameraRun("as it is", "5", some, np.full(4, 0.25), np.full(4, 0.5)) for some in (errors, errors * 2.0)]
    row = _row(runs)
    assert row == pytest.approx({"@2": 0.25, "@5": 0.625, "lost": 1, "runs": 2, "misfit": 0.5, "moved": 0.25})
