"""The shutter's share of the time between frames, told by how far moving edges are smeared."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from acp_lab.errors import TrackingError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.imaging.edge_search import AS_THEY_ARE, ImagePatch, SearchConfig, image_patch
from acp_lab.tracking.learning.motion_blur import BlurConfig, MotionBlur

WIDTH, HEIGHT = 160, 120
GAMMA = 1.8
SEARCH = replace(AS_THEY_ARE, gamma=GAMMA)
SHARPENED = SearchConfig(gamma=GAMMA)


def stripes(smear_px: float, seed: int = 0, search: SearchConfig = SEARCH) -> tuple[ImagePatch, FloatArray, FloatArray]:
    """An image of upright edges that moved sideways by smear_px, points on these, and their normals."""
    fine, rng = 8, np.random.default_rng(seed)
    x = (np.arange(WIDTH * fine) + 0.5) / fine - 0.5
    places = np.array([40.3, 79.6, 119.1])
    covered = [np.clip((x - at) / max(smear_px, 1e-3) + 0.5, 0.0, 1.0) for at in places]
    light = 30.0 + 150.0 * (covered[0] - covered[1] + covered[2])
    row = 255.0 * (light.reshape(WIDTH, fine).mean(1) / 255.0) ** (1.0 / GAMMA)
    image = row[None, :, None] + rng.normal(0.0, 2.0, (HEIGHT, WIDTH, 1))
    image = np.repeat(np.clip(np.round(image), 0, 255).astype(np.uint8), 3, 2)
    rows = np.arange(10.0, HEIGHT - 10.0, 3.0)
    points = np.array([[at, y] for at in places for y in rows])
    normals = np.tile([1.0, 0.0], (len(points), 1))
    return image_patch(image, (0, 0, WIDTH, HEIGHT), search), points, normals


@pytest.mark.parametrize("share", [0.0, 0.2, 0.5, 0.9])
@pytest.mark.parametrize("motion_px", [12.0, -18.0])
@pytest.mark.parametrize("off_px", [0.0, 1.5])
@pytest.mark.parametrize("search", [SEARCH, SHARPENED], ids=["as it is", "sharpened"])
def test_the_share_is_told(share: float, motion_px: float, off_px: float, search: SearchConfig) -> None:
    patch, points, normals = stripes(share * abs(motion_px), search=search)
    blur = MotionBlur(BlurConfig())
    blur.learn(patch, points + np.array([off_px, 0.0]), normals, np.full(len(points), motion_px))
    # An edge at rest is itself as wide as a share of .1 of such motions.
    assert blur.share == pytest.approx(share, abs=0.11)


def test_edges_are_smeared_by_their_share_of_the_motion() -> None:
    blur = MotionBlur(BlurConfig())
    assert blur.smear_px(np.array([10.0])) is None
    patch, points, normals = stripes(7.0)
    blur.learn(patch, points, normals, np.full(len(points), 14.0))
    found = blur.smear_px(np.array([-10.0, 0.0, 20.0]))
    assert found is not None
    np.testing.assert_allclose(found, blur.share * np.array([10.0, 0.0, 20.0]))


def test_slow_and_few_edges_tell_nothing() -> None:
    patch, points, normals = stripes(7.0)
    slow, few = MotionBlur(BlurConfig()), MotionBlur(BlurConfig())
    slow.learn(patch, points, normals, np.full(len(points), 7.9))
    few.learn(patch, points[:30], normals[:30], np.full(30, 14.0))
    assert slow.share == few.share == 0.0
    few.learn(patch, points[30:60], normals[30:60], np.full(30, 14.0))
    assert few.share == pytest.approx(0.5, abs=0.11)


def test_a_blank_image_tells_nothing() -> None:
    _, points, normals = stripes(7.0)
    blur = MotionBlur(BlurConfig())
    patch = image_patch(np.full((HEIGHT, WIDTH, 3), 90, np.uint8), (0, 0, WIDTH, HEIGHT), SEARCH)
    blur.learn(patch, points, normals, np.full(len(points), 14.0))
    assert blur.share == 0.0


def test_a_shutter_that_changes_is_followed() -> None:
    blur = MotionBlur(BlurConfig())
    for smear_px, expected in ((11.2, 0.8), (2.8, 0.2)):
        patch, points, normals = stripes(smear_px)
        for _ in range(12):
            blur.learn(patch, points, normals, np.full(len(points), 14.0))
        assert blur.share == pytest.approx(expected, abs=0.11)


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e12])
def test_motions_that_are_none_do_no_harm(value: float) -> None:
    patch, points, normals = stripes(7.0)
    blur = MotionBlur(BlurConfig())
    blur.learn(patch, points, normals, np.full(len(points), value))
    assert blur.share == 0.0


@pytest.mark.parametrize(
    "setting", [{"least_px": 0.5}, {"least_px": 50.0}, {"evidence": 0.0}, {"memory": 1.0}, {"most_px": np.nan}], ids=str
)
def test_settings_are_checked(setting: dict[str, float]) -> None:
    with pytest.raises(TrackingError, match=r"learning\.blur\."):
        BlurConfig(**setting)
