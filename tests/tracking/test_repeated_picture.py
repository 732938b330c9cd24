"""Pictures that a video shows again: when they are the same, and what a tracker makes of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from acp_lab.cad.part import Part
from acp_lab.geometry.arrays import ByteImage, FloatArray
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.method import ACP, DIRECT_6DOF
from acp_lab.tracking.prediction import LastPosePrediction
from acp_lab.tracking.repeated_picture import REPEATED, ShownPicture
from acp_lab.tracking.result import TrackResult, TrackState
from acp_lab.tracking.sources.rigid import CadSamples
from acp_lab.tracking.tracker import Tracker
from tests.made_parts import box, looking_at
from tests.tracking.rendered import CAMERA, MadeSequence, add_percent

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
    assert not shown.is_again_in(frame(buffer))
    assert shown.is_again_in(frame(SCENE))


def test_a_part_out_of_the_picture_is_not_kept() -> None:
    shown, beside = seen(SCENE), POSE.copy()
    beside[0, 3] += 5000.0
    shown.keep(frame(SCENE), beside)
    assert not shown.is_again_in(frame(SCENE))


def images_of(sequence: MadeSequence) -> list[ByteImage]:
    return [one.image for one in sequence.frames() if isinstance(one, Frame)]


def tracked(tracker: Tracker, images: list[ByteImage], start: FloatArray) -> list[TrackResult]:
    first = tracker.start(frame(images[0]), start)
    return [first, *(tracker.track(frame(image, k)) for k, image in enumerate(images[1:], 1))]


@pytest.mark.parametrize("scatter", [0.0, 0.25])
def test_a_video_may_show_every_picture_twice(model: PreparedPart, sequence: MadeSequence, scatter: float) -> None:
    images, start = images_of(sequence), sequence.truth(0, 1)
    assert start is not None
    results = tracked(Tracker(model), [one for image in images for one in (image, noisy(image, scatter))], start)
    # What compression leaves is told from a motion only when it is known how pictures change.
    repeats = results[3 if scatter else 1 :: 2]
    assert all(result.note == REPEATED for result in repeats)
    for before, again in zip(results[2 if scatter else 0 :: 2], repeats, strict=True):
        np.testing.assert_allclose(again.cam_T_obj, before.cam_T_obj)
        assert (again.quality, again.state, again.frame_id) == (before.quality, before.state, before.frame_id + 1)
        assert again.iterations == 0
    for number, result in enumerate(results[2::2], 1):
        truth = sequence.truth(2 * number, 1)
        assert truth is not None
        assert add_percent(model.part, result.cam_T_obj, truth) < 2.0


def test_whoever_changes_a_result_does_not_change_its_repeat(model: PreparedPart, sequence: MadeSequence) -> None:
    images, start = images_of(sequence), sequence.truth(0, 1)
    assert start is not None
    tracker = Tracker(model)
    tracker.records_steps = True
    tracker.start(frame(images[0]), start)
    result = tracker.track(frame(images[1], 1))
    pose = result.cam_T_obj.copy()
    result.cam_T_obj[:3, 3] /= 1000.0
    again = tracker.track(frame(images[1], 2))
    np.testing.assert_allclose(again.cam_T_obj, pose)
    assert result.steps
    assert again.steps == ()


def test_a_picture_that_fits_poorly_is_looked_at_again(model: PreparedPart, sequence: MadeSequence) -> None:
    images, start = images_of(sequence), sequence.truth(0, 1)
    assert start is not None
    clutter = np.random.default_rng(3).integers(0, 255, images[0].shape, dtype=np.uint8)
    results = tracked(Tracker(model), [*images[:3], *[clutter] * 30], start)
    assert REPEATED not in {result.note for result in results if result.state is not TrackState.TRACKING}
    assert results[-1].state is TrackState.LOST


def test_a_method_that_goes_by_no_motion_looks_at_every_frame(model: PreparedPart, sequence: MadeSequence) -> None:
    images, start = images_of(sequence), sequence.truth(0, 1)
    assert start is not None
    resting = replace(DIRECT_6DOF, source=CadSamples(), control_points="mid-section", prediction=LastPosePrediction())
    results = tracked(Tracker(model, resting), [images[0], images[1], images[1]], start)
    assert all(result.note != REPEATED for result in results)
    assert results[-1].iterations > 0


def test_after_a_repeat_the_prediction_stays_but_is_unsure_by_a_step() -> None:
    predictor = ACP.prediction.predictor(BOX.box_centre)
    predictor.restart(POSE)
    moved = POSE.copy()
    for _ in range(4):
        moved = moved.copy()
        moved[:3, 3] += (3.0, 0.0, 0.0)
        predictor.observe(moved, 1.0, 1e4 * np.eye(6))
    before, expected, step = predictor.information(), predictor.predict(), predictor.motion
    predictor.repeat()
    after = predictor.information()
    assert before is not None
    assert after is not None
    assert step is not None
    np.testing.assert_allclose(predictor.predict(), expected)
    np.testing.assert_allclose(
        np.linalg.inv(after), np.linalg.inv(before) + np.outer(step, step), rtol=1e-6, atol=1e-12
    )
