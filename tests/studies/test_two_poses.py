"""PnP's two poses while a part tilts past the camera."""

from __future__ import annotations

import numpy as np

from acp_lab.geometry.camera import Camera
from acp_lab.studies.two_poses import tilt_past_the_camera
from tests.made_parts import box

CAMERA = Camera(320, 240, 400.0, 400.0, 159.5, 119.5)
TILTS = np.linspace(-40.0, 40.0, 17)


def test_without_noise_the_better_pose_is_the_true_one() -> None:
    moments = tilt_past_the_camera(box(), CAMERA, 300.0, TILTS, noise_px=0.0)
    assert [one.true_deg for one in moments] == TILTS.tolist()
    assert not any(one.is_flipped for one in moments)
    tilted = [one for one in moments if abs(one.true_deg) > 15.0]
    for one in tilted:
        np.testing.assert_allclose(one.poses[0], one.cam_T_true, atol=1e-3)
        assert abs(one.tilts_deg[0] - one.true_deg) < 0.01
        assert np.sign(one.tilts_deg[1]) == -np.sign(one.true_deg), "the other one tilts the other way"
        assert one.errors_px[0] < 1e-3 < one.errors_px[1]


def test_far_away_and_with_noise_the_wrong_one_often_fits_better() -> None:
    near = tilt_past_the_camera(box(), CAMERA, 150.0, TILTS, noise_px=0.3, seed=2)
    far = tilt_past_the_camera(box(), CAMERA, 1500.0, TILTS, noise_px=0.3, seed=2)
    assert sum(one.is_flipped for one in near) < sum(one.is_flipped for one in far)
