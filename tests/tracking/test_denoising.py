"""Pictures full of noise are smoothed, others are not touched, and a part is kept that noise would lose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from prepared_sample import sample_model, sample_scene

from acp_lab.errors import TrackingError
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.denoising import Denoising, NoiseFilter
from acp_lab.tracking.learning.knowledge import Off
from acp_lab.tracking.method import ACP
from acp_lab.tracking.tracker import Tracker

NOISY = 14.0


def frames(count: int, levels: float = 0.0) -> list[Frame]:
    found = [frame for frame in sample_scene().frames(count) if isinstance(frame, Frame)]
    return [replace(frame, image=noisy(frame.image, levels, frame.index)) for frame in found]


def noisy(image: np.ndarray, levels: float, seed: int) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(0.0, levels, (*image.shape[:2], 1))
    return np.clip(image + noise, 0, 255).round().astype(np.uint8)


def off(image: np.ndarray, truth: np.ndarray) -> float:
    return float(np.abs(image.astype(float) - truth).mean())


def test_a_picture_in_good_light_is_the_very_same() -> None:
    sieve = NoiseFilter(Denoising())
    for frame in frames(3):
        assert sieve.smoothed(frame) is frame


def test_a_noisy_picture_is_nearer_to_what_it_shows() -> None:
    sieve = NoiseFilter(Denoising())
    for clean, seen in zip(frames(3), frames(3, NOISY), strict=True):
        assert off(sieve.smoothed(seen).image, clean.image) < 0.6 * off(seen.image, clean.image)


def test_the_more_noise_the_wider_the_gaussian_up_to_a_limit() -> None:
    config = Denoising(above=3.0, full=9.0, most_px=1.2)
    widths = [config.blur_px(noise) for noise in (0.0, 3.0, 4.0, 6.0, 9.0, 100.0)]
    assert widths[:2] == [0.0, 0.0]
    assert widths == sorted(widths)
    assert widths[3] == pytest.approx(1.2 * np.sqrt(0.5))
    assert widths[4:] == [1.2, 1.2]


def test_one_picture_among_others_decides_nothing() -> None:
    sieve, clean, grainy = NoiseFilter(Denoising(every=1)), frames(6), frames(6, NOISY)
    for frame in clean[:3]:
        sieve.smoothed(frame)
    assert sieve.smoothed(grainy[3]) is grainy[3]
    for frame in grainy[:3]:
        sieve.smoothed(frame)
    assert sieve.blur_px > 0.5


def test_a_camera_that_turns_up_its_gain_is_noticed_within_some_frames() -> None:
    sieve, clean, grainy = NoiseFilter(Denoising()), frames(1)[0], frames(1, NOISY)[0]
    for _ in range(30):
        sieve.smoothed(clean)
    for _ in range(14):
        last = sieve.smoothed(grainy)
    assert last is not grainy
    for _ in range(14):
        last = sieve.smoothed(clean)
    assert last is clean


def test_a_preview_changes_nothing() -> None:
    sieve, (first, second) = NoiseFilter(Denoising()), frames(2, NOISY)
    assert sieve.preview(first) is first
    sieve.smoothed(first)
    shown, width = sieve.preview(second), sieve.blur_px
    np.testing.assert_array_equal(sieve.smoothed(second).image, shown.image)
    assert width > 0.5


def test_a_new_track_knows_nothing_of_the_last_ones_noise() -> None:
    sieve, grainy, clean = NoiseFilter(Denoising()), frames(1, NOISY)[0], frames(1)[0]
    sieve.smoothed(grainy)
    sieve.forget()
    assert sieve.smoothed(clean) is clean


@pytest.mark.parametrize(
    ("config", "words"),
    [
        ({"above": 9.0}, "above = 9"), ({"full": 256.0}, "full = 256"), ({"most_px": 0.1}, "most_px = 0.1"),
        ({"pictures": 0}, "pictures = 0"), ({"every": 0}, "every = 0"), ({"above": float("nan")}, "above = nan"),
    ],
)  # fmt: skip
def test_settings_that_make_no_sense_are_refused(config: dict[str, float], words: str) -> None:
    with pytest.raises(TrackingError, match=f"denoising.*{words}"):
        Denoising(**config)  # type: ignore[arg-type]


def test_a_tracker_sees_smoothed_frames_and_forgets_them_with_the_track() -> None:
    truth = sample_scene().truth(0, 1)
    assert truth is not None
    clean, grainy = frames(2), frames(2, NOISY)
    tracker, plain = Tracker(sample_model()), Tracker(sample_model(), replace(ACP, denoising=Off()))
    errors = []
    for one in (tracker, plain):
        one.start(grainy[0], truth)
        seen = one.look(grainy[1], truth)
        assert seen is not None
        errors.append(off(seen.view.image, clean[1].image))
    assert errors[0] < 0.6 * errors[1]
    tracker.start(clean[0], truth)
    seen = tracker.look(clean[1], truth)
    assert seen is not None
    assert seen.view.image is clean[1].image


def test_ordinary_pictures_are_tracked_as_without_it() -> None:
    poses = []
    for method in (ACP, replace(ACP, denoising=Off())):
        tracker, truth = Tracker(sample_model(), method), sample_scene().truth(0, 1)
        assert truth is not None
        seen = frames(4)
        tracker.start(seen[0], truth)
        poses.append([tracker.track(frame).cam_T_obj for frame in seen[1:]])
    np.testing.assert_array_equal(poses[0], poses[1])
