"""A sudden change of light is undone and fades back; what is no change of light is left alone."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from acp_lab.errors import TrackingError
from acp_lab.geometry.arrays import ByteImage
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.middle import counted_percentiles as _percentiles
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.learning.knowledge import Off
from acp_lab.tracking.method import ACP
from acp_lab.tracking.result import TrackState
from acp_lab.tracking.tones import (
    ToneMatching,
    Tones,
    _mean_difference,
    _mean_distance,
    _some_pixels,
    _spread,
)
from acp_lab.tracking.tracker import Tracker
from tests.made_parts import bracket, looking_at
from tests.tracking.rendered import add_percent, draw, poses, prepared

CAMERA = Camera(width=160, height=120, fx=200.0, fy=200.0, cx=79.5, cy=59.5)
LARGE = Camera(width=320, height=256, fx=420.0, fy=425.0, cx=159.5, cy=127.5)


def scene(shift: int = 0) -> ByteImage:
    """(120, 160, 3): smooth shades of several colours, and a block that can move."""
    y, x = np.mgrid[0:120, 0:160]
    image = np.stack([60 + x / 2, 50 + y, 90 + 40 * np.sin(x / 25.0 + y / 40.0)], axis=-1)
    image[40:80, 30 + shift : 70 + shift] = (200, 40, 30)
    return np.asarray(image.round().clip(0, 255), np.uint8)


def frame(image: ByteImage, index: int = 0) -> Frame:
    return Frame(index, image, CAMERA)


def dimmed(image: ByteImage, gain: float) -> ByteImage:
    return np.asarray((gain * image.astype(float)).round().clip(0, 255), np.uint8)


def mean_difference(a: ByteImage, b: ByteImage) -> float:
    return float(np.abs(a.astype(float) - b).mean())


@pytest.mark.parametrize("gain", [0.4, 0.7, 1.3])
def test_the_frame_after_a_step_looks_as_before(gain: float) -> None:
    tones = Tones(ToneMatching())
    tones.steady(frame(scene()))
    seen = tones.steady(frame(dimmed(scene(shift=6), gain))).image
    assert mean_difference(dimmed(scene(6), gain), scene(6)) > 20.0
    assert mean_difference(seen, scene(6)) < 4.0


def test_the_colour_of_the_light_may_change_too() -> None:
    tones = Tones(ToneMatching())
    tones.steady(frame(scene()))
    warm = np.asarray((scene() * np.array([1.2, 0.8, 0.5])).clip(0, 255), np.uint8)
    assert mean_difference(tones.steady(frame(warm)).image, scene()) < 3.0


def test_the_new_light_comes_back_slowly_and_wholly() -> None:
    tones, dark = Tones(ToneMatching(keep=0.8)), dimmed(scene(), 0.5)
    tones.steady(frame(scene()))
    far = [mean_difference(tones.steady(frame(dark)).image, dark) for _ in range(40)]
    assert all(later <= sooner for sooner, later in itertools.pairwise(far))
    assert far[5] > 0.2 * far[0] > 0.0  # no second step
    assert far[-1] == 0.0


def test_flicker_is_seen_in_the_first_light() -> None:
    tones = Tones(ToneMatching())
    tones.steady(frame(scene()))
    for gain in (0.6, 1.0, 0.7, 1.2, 0.6):
        assert mean_difference(tones.steady(frame(dimmed(scene(), gain))).image, scene()) < 10.0


def test_motion_is_no_change_of_light() -> None:
    tones = Tones(ToneMatching(least=1.0))
    tones.steady(frame(scene()))
    moved = frame(np.roll(scene(), 30, axis=1))
    assert tones.steady(moved) is moved


def test_another_picture_is_no_change_of_light() -> None:
    tones = Tones(ToneMatching())
    flat = np.full_like(scene(), 45)
    flat[50:70, 50:80] = scene()[50:70, 50:80]
    tones.steady(frame(flat))
    other = frame(scene()[::-1, ::-1].copy())
    assert tones.steady(other) is other


def test_a_blank_frame_says_nothing_and_neither_does_the_one_after() -> None:
    tones = Tones(ToneMatching())
    tones.steady(frame(scene()))
    for image in (np.full_like(scene(), 128), scene()):
        given = frame(image)
        assert tones.steady(given) is given


def test_a_new_track_begins_anew_and_sizes_may_differ() -> None:
    tones = Tones(ToneMatching())
    tones.steady(frame(scene()))
    smaller = Frame(0, dimmed(scene(), 0.4)[:60, :80], CAMERA.cropped(0, 0, 80, 60))
    assert tones.steady(smaller) is smaller
    tones.steady(frame(scene()))
    tones.forget()
    dark = frame(dimmed(scene(), 0.4))
    assert tones.steady(dark) is dark


@pytest.mark.parametrize(
    "values", [{"least": 0.0}, {"least": float("nan")}, {"unexplained": 1.0}, {"of_constant": -0.1}, {"keep": 1.0}]
)
def test_nonsense_is_refused(values: dict[str, float]) -> None:
    with pytest.raises(TrackingError, match=f"tones.{next(iter(values))}"):
        ToneMatching(**values)


def test_a_tracker_goes_on_through_a_step_that_it_would_be_lost_at() -> None:
    part = bracket()
    truths = poses(part, looking_at(part, np.array([0.8, 0.6, 1.0]), 330.0, 0.3), 12)
    images = [draw([(part, pose)], seed, LARGE) for seed, pose in enumerate(truths)]
    images = [image if k < 5 else dimmed(image, 0.03) for k, image in enumerate(images)]
    model, worst, states = prepared(part), dict[str, float](), dict[str, set[TrackState]]()
    for name, method in {"with": ACP, "without": replace(ACP, tones=Off())}.items():
        tracker = Tracker(model, method)
        tracker.start(Frame(0, images[0], LARGE), truths[0])
        results = [tracker.track(Frame(k, image, LARGE)) for k, image in enumerate(images) if k]
        worst[name] = max(add_percent(part, r.cam_T_obj, t) for r, t in zip(results, truths[1:], strict=True))
        states[name] = {result.state for result in results}
    assert worst["with"] < 2.0 < 5.0 < worst["without"]
    assert states["with"] == {TrackState.TRACKING}


def test_percentiles_of_counted_pixels_are_numpys(rng: np.random.Generator) -> None:
    for pixels in (rng.integers(0, 256, 5001), rng.normal(120.0, 3.0, 400).astype(int), np.full(7, 255), np.arange(2)):
        counts, ranks = np.bincount(pixels, minlength=256), np.linspace(0.0, 100.0, 65)
        np.testing.assert_allclose(_percentiles(counts, ranks), np.percentile(pixels, ranks), atol=1e-9)
        assert _spread(counts) == pytest.approx(float(np.abs(pixels - np.median(pixels)).mean()), abs=1e-9)


def test_a_look_ahead_changes_nothing() -> None:
    tones = Tones(ToneMatching())
    tones.steady(frame(scene()))
    dark = frame(dimmed(scene(), 0.4))
    ahead = [tones.preview(dark).image for _ in range(3)]
    np.testing.assert_array_equal(ahead[2], ahead[0])
    np.testing.assert_array_equal(tones.steady(dark).image, ahead[0])
    assert mean_difference(ahead[0], scene()) < 4.0


@pytest.mark.parametrize("is_writable", [True, False])
def test_loops_over_pixels_give_what_numpy_gives(is_writable: bool) -> None:
    before, now = np.random.default_rng(3).integers(0, 256, (2, 203, 311, 3), dtype=np.uint8)
    now = now // 2
    now.flags.writeable = is_writable
    grids = [image[2::4, 2::4].reshape(-1, 3) for image in (before, now)]  # 63133 px: every fourth, some 5000 in all
    counts = [np.stack([np.bincount(channel, minlength=256) for channel in grid.T]) for grid in grids]
    samples = [_some_pixels(image) for image in (before, now)]
    for sample, grid, counted in zip(samples, grids, counts, strict=True):
        np.testing.assert_array_equal(sample.pixels, grid)
        np.testing.assert_array_equal(sample.counts, counted)
    change = np.abs(grids[1].astype(int) - grids[0]).mean()
    apart = np.mean([np.abs(np.cumsum(b - n)).sum() / n.sum() for b, n in zip(*counts, strict=True)])
    assert _mean_difference(samples[0].pixels, samples[1].pixels) == change
    assert _mean_distance(samples[0].counts, samples[1].counts) == apart
