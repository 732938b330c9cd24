"""Bands of light: when they are told from what moves, what is left of them, and what it gains."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np
import pytest

from acp_lab.errors import TrackingError
from acp_lab.geometry.arrays import ByteImage
from acp_lab.geometry.pose import transform
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.bands import Bands, _brighten, _copy, _medians, _spread_of_change
from acp_lab.tracking.method import ACP
from acp_lab.tracking.tones import ToneMatching, Tones
from acp_lab.tracking.tracker import Tracker
from benchmarks.light_bands import banded
from tests.prepared_sample import sample_model, sample_scene
from tests.tracking.rendered import CAMERA

CONFIG = ToneMatching()


@pytest.fixture
def scene(rng: np.random.Generator) -> Frame:
    """Blobs of some px, everywhere, none black or white."""
    coarse = rng.integers(60, 180, (CAMERA.height // 8, CAMERA.width // 8, 3)).astype(np.uint8)
    return Frame(0, np.asarray(cv2.resize(coarse, (CAMERA.width, CAMERA.height)), np.uint8), CAMERA)


def bands_after(*frames: Frame, keep: float = CONFIG.keep) -> Bands:
    found = Bands(CONFIG.band_least, CONFIG.band_unexplained, keep)
    for frame in frames:
        found.steady(frame)
    return found


def off(image: ByteImage, other: ByteImage) -> float:
    """Mean absolute difference, grey levels."""
    return float(np.abs(image.astype(np.float64) - other).mean())


@pytest.mark.parametrize("share", [0.06, 0.25])
def test_a_frame_is_seen_in_the_light_of_the_one_before(scene: Frame, share: float) -> None:
    first, second = (banded(scene, number, share, 1.5) for number in (0, 1))
    seen = bands_after(first, keep=1.0).steady(second).image
    assert off(seen, first.image) < 0.1 * off(second.image, first.image)
    half = bands_after(first, keep=0.5).steady(second).image
    assert off(half, first.image) == pytest.approx(0.5 * off(second.image, first.image), rel=0.2)


def test_its_own_light_comes_back_when_the_bands_stop(scene: Frame) -> None:
    bands = bands_after(banded(scene, 0, 0.25, 1.5))
    left = [off(bands.steady(scene).image, scene.image) for _ in range(12)]
    assert left[0] > 3.0
    assert all(after <= before for before, after in pairwise(left))
    assert left[-1] < 0.3 * left[0]


def test_light_that_stays_or_changes_everywhere_leaves_the_frame_as_it_is(scene: Frame) -> None:
    for other in (scene, banded(scene, 1, 0.25, 0.0), banded(scene, 1, 0.005, 1.5)):
        assert bands_after(scene).steady(other) is other


@pytest.mark.parametrize("shift", [(0, 9), (9, 0), (40, 25)])
def test_a_camera_that_turns_makes_no_bands(scene: Frame, shift: tuple[int, int]) -> None:
    turned = replace(scene, image=np.roll(scene.image, shift, axis=(0, 1)))
    assert bands_after(scene).steady(turned) is turned


def test_a_large_part_that_moves_aside_makes_no_bands(scene: Frame) -> None:
    with_part = []
    for left in (20, 60):
        image = scene.image.copy()
        image[20:110, left : left + 120] = 230
        with_part.append(replace(scene, image=image))
    assert bands_after(with_part[0]).steady(with_part[1]) is with_part[1]


PART = (60, 40, 140, 110)
"""Px, where the part is."""


def with_part(ground: ByteImage, down: int = 0) -> Frame:
    """A part of blobs before a ground."""
    x0, y0, x1, y1 = PART
    coarse = np.random.default_rng(1).integers(60, 180, ((y1 - y0) // 8, (x1 - x0) // 8, 3)).astype(np.uint8)
    image = ground.copy()
    image[y0 + down : y1 + down, x0:x1] = cv2.resize(coarse, (x1 - x0, y1 - y0))
    return Frame(0, image, CAMERA)


def stripes(shift: int) -> ByteImage:
    """A ground of soft stripes across, as of shelves that a camera passes."""
    rows = 110.0 + 60.0 * np.sin(2.0 * np.pi * (np.arange(CAMERA.height) + shift) / 70.0)
    return np.repeat(np.repeat(rows[:, None, None], CAMERA.width, 1), 3, 2).astype(np.uint8)


def test_a_ground_of_stripes_that_goes_by_makes_no_bands_on_the_part() -> None:
    before, now = with_part(stripes(0)), with_part(stripes(4))
    assert bands_after(before).steady(now) is not now, "the ground alone cannot tell"
    assert bands_after(before).steady(now, PART) is now


@pytest.mark.parametrize("down", [0, 4])
def test_bands_are_on_the_part_too_where_it_moves_a_little(down: int) -> None:
    ground = np.full((CAMERA.height, CAMERA.width, 3), 120, np.uint8)
    first, second = banded(with_part(ground), 0, 0.25, 1.5), banded(with_part(ground, down), 1, 0.25, 1.5)
    seen = bands_after(first).steady(second, PART).image
    still = banded(with_part(ground, down), 0, 0.25, 1.5).image
    assert off(seen, still) < 0.3 * off(second.image, still)


@pytest.mark.parametrize("box", [(-50, -50, -10, -10), (500, 500, 600, 600), (60, 40, 61, 41)])
def test_a_part_that_is_not_in_sight_has_no_say(scene: Frame, box: tuple[int, int, int, int]) -> None:
    first, second = (banded(scene, number, 0.25, 1.5) for number in (0, 1))
    assert bands_after(first).steady(second, box) is not second


def test_a_picture_that_is_cut_off_tells_nothing(scene: Frame) -> None:
    for grey in (0, 255):
        flat = replace(scene, image=np.full_like(scene.image, grey))
        other = banded(scene, 1, 0.25, 1.5)
        assert bands_after(flat).steady(other) is other


def test_frames_of_another_size_and_after_a_new_start_are_as_they_are(scene: Frame) -> None:
    second = banded(scene, 1, 0.25, 1.5)
    small = Frame(0, np.ascontiguousarray(scene.image[::8, ::8]), CAMERA.shrunk(8))
    small = replace(small, image=small.image[: small.camera.height, : small.camera.width])
    assert bands_after(small).steady(second) is second
    bands = bands_after(scene)
    bands.forget()
    assert bands.steady(second) is second


def test_a_preview_changes_nothing(scene: Frame) -> None:
    first, second = scene, banded(scene, 1, 0.25, 1.5)
    tones = Tones(CONFIG)
    tones.steady(first)
    shown = tones.preview(second)
    assert off(shown.image, second.image) > 3.0
    np.testing.assert_array_equal(tones.steady(second).image, shown.image)


def test_the_kernels_do_what_numpy_does(rng: np.random.Generator) -> None:
    image = rng.integers(0, 256, (13, 21, 3)).astype(np.uint8)
    grid, means = np.empty_like(image[::2, 1::3]), np.empty(7)
    _copy(image[::2, 1::3], grid, means)
    np.testing.assert_array_equal(grid, image[::2, 1::3])
    np.testing.assert_allclose(means, image[::2, 1::3].mean((1, 2)))
    gains, brightened = rng.uniform(0.5, 2.0, 13), np.empty_like(image)
    _brighten(image, gains, brightened)
    expected = np.floor(image * gains[:, None, None] + 0.5).clip(0, 255)
    np.testing.assert_array_equal(brightened, expected.astype(np.uint8))
    change, told, middle = rng.normal(size=(9, 14)), rng.random((9, 14)) < 0.6, np.empty(9)
    _medians(change, told, middle)
    np.testing.assert_array_equal(middle, np.nanmedian(np.where(told, change, np.nan), axis=1))
    before, now, taken = rng.uniform(0.0, 255.0, 9), rng.uniform(0.0, 255.0, 9), rng.normal(size=9)
    spread = (np.log((now + 4.0) / (before + 4.0)) + taken).std()
    assert _spread_of_change(before, now, taken) == pytest.approx(spread, rel=1e-12)


@pytest.mark.parametrize(
    ("config", "words"), [({"band_least": 0.0}, "band_least = 0"), ({"band_unexplained": 1.0}, "band_unexplained = 1")]
)
def test_settings_that_no_light_has_are_refused(config: dict[str, float], words: str) -> None:
    with pytest.raises(TrackingError, match=f"tones.{words}"):
        ToneMatching(**config)


def test_a_tracker_sees_frames_without_bands() -> None:
    scene, model = sample_scene(), sample_model()
    truth = scene.truth(0, 1)
    assert truth is not None
    first, second = (banded(frame, k, 0.25, 1.5) for k, frame in enumerate(scene.frames(2)) if isinstance(frame, Frame))
    changes = {}
    for least in (CONFIG.band_least, 100.0):
        tracker = Tracker(model, replace(ACP, tones=replace(CONFIG, band_least=least)))
        tracker.start(first, truth)
        seen = tracker.look(second, truth)
        assert seen is not None
        changes[least] = off(seen.view.image, first.image)
    assert changes[CONFIG.band_least] < 0.5 * changes[100.0]


def test_a_tracker_asks_the_middle_of_the_part(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, model = sample_scene(), sample_model()
    first, second = (frame for frame in scene.frames(2) if isinstance(frame, Frame))
    truths = [scene.truth(number, 1) for number in (0, 1)]
    asked: list[tuple[int, int, int, int]] = []

    def steady(self: Bands, frame: Frame, around: tuple[int, int, int, int] | None = None) -> Frame:
        assert around is not None
        asked.append(around)
        return frame

    monkeypatch.setattr(Bands, "steady", steady)
    tracker = Tracker(model)
    assert truths[0] is not None
    tracker.start(first, truths[0])
    tracker.track(second)
    for (x0, y0, x1, y1), truth in zip(asked, truths, strict=True):
        assert truth is not None
        shown = first.camera.project(transform(truth, model.part.vertices))
        low, high = shown.min(0), shown.max(0)
        assert (low < (x0, y0)).all()
        assert (high > (x1, y1)).all()
        assert (np.array([x1 - x0, y1 - y0]) > 0.4 * (high - low)).all()
