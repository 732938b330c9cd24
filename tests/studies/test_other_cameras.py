"""What another camera makes of a picture."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from acp_lab.errors import ParameterError, SequenceError
from acp_lab.geometry.camera import Camera
from acp_lab.sequences.frame import Frame
from acp_lab.studies.other_cameras import CAMERAS, CameraStudy, OtherCamera, track_as_taken
from tests.made_parts import bracket, looking_at
from tests.tracking.rendered import MadeSequence, draw, poses, prepared

CAMERA = Camera(65, 48, 80.0, 80.0, 32.0, 23.5)


def picture(grey: np.ndarray | float) -> Frame:
    image = np.empty((CAMERA.height, CAMERA.width, 3), np.uint8)
    image[:] = np.broadcast_to(grey, image.shape)
    return Frame(3, image, CAMERA)


def step() -> Frame:
    """Dark on the left, bright from column 32 on."""
    return picture(np.where(np.arange(CAMERA.width) < 32, 60, 200)[None, :, None])


def test_a_plain_camera_takes_the_same_picture() -> None:
    frame = picture(np.random.default_rng(0).integers(0, 256, (CAMERA.height, CAMERA.width, 3)))
    taken = OtherCamera().take(frame)
    assert np.array_equal(taken.image, frame.image)
    assert taken.camera == CAMERA
    assert taken.index == 3


def test_light_is_measured_before_it_is_encoded() -> None:
    # A quarter of the light is about half the grey level.
    assert OtherCamera(exposure=0.25).take(picture(200)).image[0, 0, 0] == round(200 * 0.25 ** (1 / 2.2))
    assert OtherCamera(gamma=1.0).take(picture(128)).image[0, 0, 0] == round(255 * (128 / 255) ** 2.2)
    assert (OtherCamera(exposure=4.0).take(picture(200)).image == 255).all()


def test_a_blurred_step_keeps_the_mean_of_the_light_not_of_the_grey() -> None:
    row = OtherCamera(blur_px=2.0).take(step()).image[24, :, 0].astype(float)
    assert (np.diff(row) >= 0).all()
    assert 0 < np.diff(row).max() < 40
    middle = 0.5 * (row[31] + row[32])
    expected = 255.0 * (0.5 * ((60 / 255) ** 2.2 + (200 / 255) ** 2.2)) ** (1 / 2.2)
    assert middle == pytest.approx(expected, abs=3.0)
    assert middle > 140.0


def test_half_the_pixels_see_the_same_place() -> None:
    image = np.zeros((CAMERA.height, CAMERA.width, 3), np.uint8)
    image[20:24, 30:34] = 255
    taken = OtherCamera(is_half=True).take(Frame(0, image, CAMERA))
    assert (taken.camera.width, taken.camera.height) == (32, 24) == taken.image.shape[1::-1]
    point_cam = np.array([[(31.5 - CAMERA.cx) / CAMERA.fx, (21.5 - CAMERA.cy) / CAMERA.fy, 1.0]])  # the middle of it
    rows, columns = np.nonzero(taken.image[..., 0] == 255)
    assert np.allclose([columns.mean(), rows.mean()], taken.camera.project(point_cam)[0])


def test_noise_is_the_seeds_and_grows_where_electrons_are_few() -> None:
    few, many = OtherCamera(electrons=500.0), OtherCamera(electrons=50_000.0)
    frame = picture(120)
    assert np.array_equal(few.take(frame, 1).image, few.take(frame, 1).image)
    assert not np.array_equal(few.take(frame, 1).image, few.take(frame, 2).image)
    assert not np.array_equal(few.take(frame, 1).image, few.take(replace(frame, index=4), 1).image)
    assert few.take(frame).image.std() > 4 * many.take(frame).image.std() > 0
    assert few.take(frame).image.mean() == pytest.approx(120, abs=4)


def test_colours_sharpening_and_small_files() -> None:
    coloured = picture(np.array([200, 90, 30]))
    grey = OtherCamera(is_grey=True).take(coloured).image
    assert (grey == grey[..., :1]).all()
    sharp = OtherCamera(sharpening=1.0).take(step()).image[24, :, 0]
    assert sharp.min() < 60
    assert sharp.max() > 200
    assert sharp[5] == 60
    stored = OtherCamera(jpeg_quality=30).take(coloured).image
    # Red stays red: written blue first and read red first.
    assert np.abs(stored.astype(int) - coloured.image).max() < 12
    assert not np.array_equal(OtherCamera(jpeg_quality=30).take(step()).image, step().image)


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_every_camera_changes_the_picture(camera: OtherCamera) -> None:
    frame = picture(np.random.default_rng(0).integers(20, 230, (CAMERA.height, CAMERA.width, 3)))
    taken = camera.take(frame)
    assert taken.image.shape != frame.image.shape or not np.array_equal(taken.image, frame.image)


@pytest.mark.parametrize("wrong", [{"blur_px": -1}, {"exposure": 0}, {"gamma": 9}, {"jpeg_quality": 101}])
def test_impossible_cameras_are_refused(wrong: dict[str, float]) -> None:
    name, value = next(iter(wrong.items()))
    with pytest.raises(ParameterError, match=rf"camera\.{name} = {value}: give"):
        OtherCamera(**wrong)  # type: ignore[arg-type]


def test_what_becomes_of_a_tracker() -> None:
    part = bracket()
    truth = poses(part, looking_at(part, np.array([0.8, 0.6, 1.0]), 330.0, 0.3), 6)
    sequence = MadeSequence([draw([(part, pose)], seed) for seed, pose in enumerate(truth)], {1: truth})
    cameras = {"as it was": OtherCamera(), "blind": OtherCamera(exposure=1e-3, electrons=20.0)}

    def known(frame_id: int) -> np.ndarray | None:
        return sequence.truth(frame_id, 1) if frame_id != 4 else None

    model = prepared(part)
    study = track_as_taken(model, sequence, truth[0], cameras, known, max_frames=5)
    assert [len(errors) for errors in study.errors.values()] == [3, 3]
    assert study.recall("as it was", 0.02) == 1.0
    assert study.recall("blind", 0.02) < 1.0
    with pytest.raises(SequenceError, match="no frame behind the first has a known pose"):
        track_as_taken(model, sequence, truth[0], cameras, lambda frame_id: None, max_frames=2)


def test_the_table_says_what_was_reached() -> None:
    study = CameraStudy({"soft": np.array([0.01, 0.03, 0.07, np.inf])})
    assert str(study).splitlines() == [
        "camera  within 2%  within 5%  median ADD",
        "soft         0.25       0.50       5.00%",
    ]
