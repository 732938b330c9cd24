"""Pictures that a video shows again: when they are the same, and what a tracker makes of them."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from acp_lab.cad.part import Part
from acp_lab.cad.raycast import hit_map, make_caster
from acp_lab.geometry.arrays import ByteImage, FloatArray
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.kalman import KalmanPrediction, PoseKalman
from acp_lab.tracking.repeated_picture import ShownPicture
from acp_lab.tracking.result import TrackResult
from acp_lab.tracking.tracker import Tracker
from tests.made_parts import box, looking_at
from tests.tracking.rendered import CAMERA, MadeSequence, add_percent, draw, prepared

BOX: Part = box((40.0, 30.0, 20.0))
POSE = looking_at(BOX, np.array([0.8, 0.6, 1.0]), 330.0, 0.3)
RNG = np.random.default_rng(0)
SCENE: ByteImage = RNG.integers(0, 255, (CAMERA.height, CAMERA.width, 3), dtype=np.uint8)


def frame(image: ByteImage, index: int = 0) -> Frame:
    return Frame(index, image, CAMERA)


def noisy(image: ByteImage, scatter: float, seed: int = 1) -> ByteImage:
    grey = image + np.random.default_rng(seed).normal(0.0, scatter, image.shape)
    return grey.round().clip(0, 255).astype(np.uint8)


def seen(*images: ByteImage) -> ShownPicture:
    """One that was shown these, and keeps the last."""
    shown = ShownPicture(BOX, 10.0)
    for image in images:
        shown.is_again_in(frame(image))
        shown.keep(frame(image), POSE)
    return shown


def test_a_picture_is_asked_about_once() -> None:
    shown = seen(SCENE)
    assert shown.is_again_in(frame(SCENE))
    assert not shown.is_again_in(frame(SCENE))  # nothing was kept since


def test_the_same_bytes_are_the_same_picture_from_the_first_on() -> None:
    assert seen(SCENE).is_again_in(frame(SCENE.copy()))
    assert not ShownPicture(BOX, 10.0).is_again_in(frame(SCENE))
    assert not seen(SCENE).is_again_in(frame(noisy(SCENE, 0.3)))  # how pictures differ as a rule is not known yet


def test_what_compression_leaves_is_no_change_where_pictures_change_and_is_one_where_they_do_not() -> None:
    moving = seen(np.roll(SCENE, 5, axis=1), SCENE)
    assert moving.is_again_in(frame(noisy(SCENE, 0.4)))
    resting = seen(noisy(SCENE, 0.4, seed=2), SCENE)
    assert not resting.is_again_in(frame(noisy(SCENE, 0.4)))


def test_a_sensor_noise_is_a_change_as_it_is_in_all_pictures() -> None:
    shown = seen(noisy(np.roll(SCENE, 5, axis=1), 8.0), SCENE)
    assert not shown.is_again_in(frame(noisy(SCENE, 12.0)))


def test_a_part_that_moves_in_the_dark_is_seen_to() -> None:
    """The lights went out: all that changes is as dark as the rest."""
    shown = seen(*(np.roll(SCENE, k, axis=1) for k in (9, 6, 3)), SCENE // 25)
    assert not shown.is_again_in(frame(np.roll(SCENE, 3, axis=1) // 25))


def test_only_what_is_around_the_part_counts() -> None:
    elsewhere, there = SCENE.copy(), SCENE.copy()
    elsewhere[:20, :20] = 0
    centre = CAMERA.project((POSE[:3, :3] @ BOX.box_centre + POSE[:3, 3])[None])[0].astype(int)
    there[centre[1] - 4 : centre[1] + 4, centre[0] - 4 : centre[0] + 4] ^= 255
    assert seen(SCENE).is_again_in(frame(elsewhere))
    assert not seen(SCENE).is_again_in(frame(there))


def test_another_camera_is_another_picture() -> None:
    again = Frame(1, SCENE, replace(CAMERA, fx=CAMERA.fx + 1.0))
    assert not seen(SCENE).is_again_in(again)


def test_a_picture_is_kept_though_its_array_is_written_into() -> None:
    buffer = SCENE.copy()
    shown = seen(buffer)
    buffer[:] = np.roll(SCENE, 3, axis=0)
    assert shown.is_again_in(frame(SCENE))


def test_a_part_out_of_the_picture_is_not_kept() -> None:
    shown, beside = seen(SCENE), POSE.copy()
    beside[0, 3] += 5000.0
    shown.keep(frame(SCENE), beside)
    assert not shown.is_again_in(frame(SCENE))


def images_of(sequence: MadeSequence) -> list[ByteImage]:
    return [one.image for one in sequence.frames() if isinstance(one, Frame)]


@pytest.mark.parametrize("scatter", [0.0, 0.25])
def test_a_video_may_show_every_picture_twice(
    model: PreparedPart, sequence: MadeSequence, scatter: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With what compression leaves or without; each picture is found where it was, and the next where it goes."""
    images, start = images_of(sequence), sequence.truth(0, 1)
    assert start is not None
    repeats: list[int] = []
    repeat = PoseKalman.repeat
    monkeypatch.setattr(PoseKalman, "repeat", lambda self: (repeats.append(len(results)), repeat(self)))
    tracker, results = Tracker(model), list[TrackResult]()
    results.append(tracker.start(frame(images[0]), start))
    for index in range(1, 2 * len(images)):
        image = images[index // 2]
        results.append(tracker.track(frame(noisy(image, scatter) if index % 2 else image, index)))
    # What compression leaves is told from a motion only when it is known how pictures change.
    assert repeats == list(range(3 if scatter else 1, len(results), 2))
    for index, result in enumerate(results):
        truth = sequence.truth(2 * (index // 2), 1)
        assert truth is not None
        assert add_percent(model.part, result.cam_T_obj, truth) < 2.0
        if index % 2 and index > 3:
            np.testing.assert_allclose(result.predicted, results[index - 1].cam_T_obj, atol=1.0)
        elif index > 6:  # as far ahead as it goes from picture to picture
            step_mm = np.linalg.norm(result.cam_T_obj[:3, 3] - results[index - 1].cam_T_obj[:3, 3])
            off_mm = np.linalg.norm(result.cam_T_obj[:3, 3] - result.predicted[:3, 3])
            assert off_mm < 0.7 * step_mm


def moving() -> tuple[PoseKalman, FloatArray]:
    """A filter of a part that moves by 3 mm a frame, and the last pose."""
    predictor, pose = KalmanPrediction().predictor(BOX.box_centre), POSE
    predictor.restart(pose)
    for _ in range(4):
        pose = pose.copy()
        pose[:3, 3] += (3.0, 0.0, 0.0)
        predictor.observe(pose, 1.0, 1e4 * np.eye(6))
    return predictor, pose


def test_in_a_repeated_picture_a_part_is_expected_where_it_was_and_goes_on_after_it_unsure_by_a_step() -> None:
    predictor, pose = moving()
    before, ahead, step = predictor.information(), predictor.predict(), predictor.motion
    assert step is not None
    predictor.repeat()
    np.testing.assert_allclose(predictor.predict(), pose)
    np.testing.assert_allclose(predictor.motion, step)  # its edges are smeared as they were
    found = pose.copy()
    found[:3, 3] += (0.1, 0.0, 0.0)
    predictor.observe(found, 1.0, 1e4 * np.eye(6))
    np.testing.assert_allclose(predictor.last, found)
    np.testing.assert_allclose(predictor.predict()[:3, 3] - ahead[:3, 3], (0.1, 0.0, 0.0), atol=0.02)
    spread = np.linalg.inv(predictor.information())
    np.testing.assert_allclose(spread, np.linalg.inv(before) + np.outer(step, step), rtol=1e-6, atol=1e-12)


def test_a_part_that_moves_in_what_seemed_a_repeated_picture_is_observed() -> None:
    """Such as before a background that moved, too, and now does not."""
    predictor, pose = moving()
    plain, _ = moving()
    predictor.repeat()
    moved = pose.copy()
    moved[:3, 3] += (2.0, 0.0, 0.0)
    for one in (predictor, plain):
        one.observe(moved, 1.0, 1e4 * np.eye(6))
    np.testing.assert_allclose(predictor.predict(), plain.predict())
    np.testing.assert_allclose(predictor.information(), plain.information())


def test_a_repeated_picture_that_fits_poorly_holds_the_part_as_any_does() -> None:
    predictor, pose = moving()
    predictor.repeat()
    predictor.observe(pose, 0.0)
    assert not predictor.moves
    np.testing.assert_allclose(predictor.predict(), pose)


def test_after_a_repeat_nothing_of_it_is_left_when_the_track_begins_anew() -> None:
    predictor, pose = moving()
    predictor.repeat()
    predictor.restart(pose)
    moved = pose.copy()
    moved[:3, 3] += (1.0, 0.0, 0.0)
    predictor.observe(moved, 1.0, 1e4 * np.eye(6))
    assert predictor.predict()[0, 3] > moved[0, 3]


def test_a_part_whose_background_stood_still_at_last_is_followed() -> None:
    """The background made pictures change a lot; then it stands, and the part alone moves by half a pixel a frame."""
    part = box((90.0, 14.0, 14.0))
    start = looking_at(part, np.array([0.5, 0.3, 1.0]), 330.0, 0.6)
    model, tracker = prepared(part), None
    texture = np.random.default_rng(1).normal(size=(CAMERA.height, 2 * CAMERA.width, 3))
    texture = (128.0 + 45.0 * cv2.GaussianBlur(texture, (0, 0), 2.0) * 7.0).clip(0, 255)
    for index in range(22):
        pose = start.copy()
        pose[0, 3] += max(index - 9, 0) * 0.5 * start[2, 3] / CAMERA.fx
        shown = cv2.GaussianBlur(mask(part, pose), (0, 0), 0.6)[..., None]
        shift = 4 * min(index, 9)
        ground = texture[:, shift : shift + CAMERA.width]
        image = (draw([(part, pose)], 5) * shown + ground * (1.0 - shown)).round().astype(np.uint8)
        if tracker is None:
            tracker = Tracker(model)
            tracker.start(frame(image), pose)
        else:
            found = tracker.track(frame(image, index)).cam_T_obj
            off_px = CAMERA.project(found[None, :3, 3]) - CAMERA.project(pose[None, :3, 3])
            assert np.linalg.norm(off_px) < 1.0


def mask(part: Part, pose: FloatArray) -> FloatArray:
    """(h, w) 1 where the part is."""
    _, faces = hit_map(part, make_caster(part), CAMERA, pose)
    return (faces >= 0).astype(np.float64)
