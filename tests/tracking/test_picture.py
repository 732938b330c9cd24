"""The part's last picture, searched in the next frame; and how a Kalman filter takes in what it says."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from acp_lab.cad.part import box_corners
from acp_lab.errors import TrackingError
from acp_lab.geometry.arrays import ByteImage, FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import make_pose, transform
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.kalman import KalmanPrediction, PoseKalman
from acp_lab.tracking.picture import Picture, PictureSearch, take_picture
from tests.made_parts import box

CONFIG = PictureSearch()
CAMERA = Camera(320, 240, 300.0, 310.0, 159.5, 119.5)
PART = box((60.0, 40.0, 20.0))
CORNERS = box_corners(PART)
NOWHERE = np.zeros(2)


def pose_at(x: float, y: float, z: float = 250.0) -> FloatArray:
    return make_pose(np.eye(3), np.array([x, y, z]) - PART.box_centre)


@pytest.fixture
def scene(rng: np.random.Generator) -> ByteImage:
    """Coloured blobs of some px, everywhere."""
    coarse = rng.integers(0, 255, (40, 54, 3)).astype(np.uint8)
    return np.asarray(cv2.resize(coarse, (320, 240), interpolation=cv2.INTER_CUBIC), np.uint8)


def moved(image: ByteImage, shift: tuple[float, float]) -> ByteImage:
    into = np.array([[1.0, 0.0, shift[0]], [0.0, 1.0, shift[1]]])
    return np.asarray(cv2.warpAffine(image, into, (320, 240), borderMode=cv2.BORDER_REFLECT), np.uint8)


def taken(image: ByteImage, pose: FloatArray, config: PictureSearch = CONFIG) -> Picture:
    found = take_picture(Frame(0, image, CAMERA), CORNERS, pose, config)
    assert found is not None
    return found


@pytest.mark.parametrize("shift", [(0.0, 0.0), (14.0, -9.0), (-22.5, 17.5), (31.0, 3.0)])
@pytest.mark.parametrize("place", [(0.0, 0.0), (-40.0, 25.0)])
def test_a_picture_is_found_where_it_went(
    scene: ByteImage, shift: tuple[float, float], place: tuple[float, float]
) -> None:
    picture = taken(scene, pose_at(*place))
    found = picture.shift_in(moved(scene, shift), NOWHERE - 40.0, CONFIG)
    assert found is not None
    np.testing.assert_allclose(found, shift, atol=1.5)


def test_blur_and_other_light_do_not_hide_it(scene: ByteImage) -> None:
    picture = taken(scene, pose_at(0.0, 0.0))
    later = cv2.blur(moved(scene, (18.0, 6.0)), (11, 3)).astype(np.float64) * 0.5 + 40.0
    found = picture.shift_in(later.astype(np.uint8), NOWHERE, CONFIG)
    assert found is not None
    np.testing.assert_allclose(found, (18.0, 6.0), atol=3.0)


def test_what_is_not_recognised_is_not_found(scene: ByteImage, rng: np.random.Generator) -> None:
    picture = taken(scene, pose_at(0.0, 0.0))
    other = np.asarray(rng.integers(0, 255, scene.shape), np.uint8)
    for image in (other, np.zeros_like(scene), np.full_like(scene, 255)):
        assert picture.shift_in(image, NOWHERE - 40.0, CONFIG) is None


def test_a_picture_that_fits_where_it_is_expected_says_nothing(scene: ByteImage) -> None:
    """Along a bar it fits everywhere: what moves there is not seen."""
    bar = np.full((240, 320, 3), 60, np.uint8)
    bar[105:135] = (200, 190, 180)
    picture = taken(bar, pose_at(0.0, 0.0))
    assert picture.shift_in(bar, np.array([15.0, 0.0]), CONFIG) is None
    # Across the bar it is seen.
    found = picture.shift_in(moved(bar, (0.0, 9.0)), NOWHERE, CONFIG)
    assert found is not None
    assert found[1] == pytest.approx(9.0, abs=1.5)


def test_a_part_outside_the_image_has_no_picture(scene: ByteImage) -> None:
    frame = Frame(0, scene, CAMERA)
    for pose in (pose_at(400.0, 0.0), pose_at(0.0, 0.0, -250.0), pose_at(0.0, 0.0, 1e5)):
        assert take_picture(frame, CORNERS, pose, CONFIG) is None
    assert take_picture(frame, CORNERS, pose_at(-125.0, 0.0), CONFIG) is not None, "half of it is inside"


@pytest.mark.parametrize("side_px", [12, 24, 48])
def test_pictures_are_as_large_as_asked(scene: ByteImage, side_px: int) -> None:
    picture = taken(scene, pose_at(0.0, 0.0), replace(CONFIG, side_px=side_px))
    assert max(picture.pixels.shape[:2]) in (side_px - 1, side_px)


@pytest.mark.parametrize(
    ("setting", "value"), [("side_px", 2), ("reach", 0.0), ("core", 1.5), ("least_match", 2.0), ("scatter_px", 0.0)]
)
def test_settings_that_find_nothing_are_refused(setting: str, value: float) -> None:
    with pytest.raises(TrackingError, match=f"sight.{setting}"):
        PictureSearch(**{setting: value})  # type: ignore[arg-type]


# ---- what the filter makes of it -----------------------------------------------------------------------------


def started() -> PoseKalman:
    motion = KalmanPrediction().predictor(PART.box_centre)
    motion.restart(pose_at(0.0, 0.0))
    return motion


def centre_px(motion: PoseKalman) -> FloatArray:
    found: FloatArray = CAMERA.project(transform(motion.predict(), PART.box_centre[None]))[0]
    return found


def test_the_prediction_moves_towards_what_is_seen_by_how_sure_both_are() -> None:
    motion = started()
    before = centre_px(motion)
    spread = np.linalg.inv(motion.information())
    variance_px = CAMERA.fx**2 / 250.0**2 * spread[3, 3]
    motion.sight(CAMERA, before + np.array([10.0, 0.0]), 4.0, 4.0)
    share = variance_px / (variance_px + 4.0**2)
    assert centre_px(motion) - before == pytest.approx((10.0 * share, 0.0), abs=0.05)
    assert 0.5 < share < 1.0
    after = np.linalg.inv(motion.information())
    assert after[3, 3] == pytest.approx((1.0 - share) * spread[3, 3], rel=1e-6)
    # Neither the distance nor the turn was seen.
    np.testing.assert_allclose(after[5, 5], spread[5, 5], rtol=1e-6)
    np.testing.assert_allclose(after[:3, :3], spread[:3, :3], rtol=1e-6)
    # It was motion, and goes on.
    assert motion.moves


def test_what_lies_too_far_away_is_not_believed() -> None:
    motion = started()
    before, information = motion.predict(), motion.information()
    motion.sight(CAMERA, centre_px(motion) + np.array([150.0, 0.0]), 4.0, 4.0)
    np.testing.assert_array_equal(motion.predict(), before)
    np.testing.assert_array_equal(motion.information(), information)
    motion.sight(CAMERA, centre_px(motion) + np.array([150.0, 0.0]), 4.0, 40.0)
    assert np.abs(motion.predict() - before).max() > 10.0
