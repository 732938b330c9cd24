"""How a camera encodes light, told by smeared edges that were drawn with a known exponent."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from acp_lab.errors import TrackingError
from acp_lab.geometry.arrays import FloatArray
from acp_lab.imaging.edge_search import ImagePatch, SearchConfig, image_patch
from acp_lab.tracking.learning.encoding import _EXPONENTS, EncodingConfig, LightEncoding, _add_up_bends

SMEAR_PX = 7.0
ROWS = 120


def smeared(exponent: float, smear_px: float = SMEAR_PX, noise: float = 0.0, seed: int = 0) -> ImagePatch:
    """Stripes that are dark on the left and bright from column 40 on, each with its own light, smeared by motion.

    Grey is light to the power of 1 / exponent.
    """
    rng = np.random.default_rng(seed)
    dark, bright = rng.uniform(0.03, 0.12, ROWS // 10), rng.uniform(0.35, 0.8, ROWS // 10)
    ramp = np.clip((np.arange(81) - 40.0) / max(smear_px, 1e-6) + 0.5, 0.0, 1.0)
    light = dark[:, None] + (bright - dark)[:, None] * ramp
    light = cv2.GaussianBlur(np.repeat(light, 10, axis=0), (0, 0), sigmaX=0.8, sigmaY=0.01)
    grey = 255.0 * light ** (1.0 / exponent) + rng.normal(0.0, noise, light.shape)
    image = np.repeat(grey.clip(0, 255).round().astype(np.uint8)[..., None], 3, 2)
    return image_patch(image, (0, 0, 81, ROWS), SearchConfig())


def edges(towards: float = 1.0) -> tuple[FloatArray, FloatArray]:
    """Points (n, 2) in the middle of the stripes, normals (n, 2)."""
    rows = np.arange(5.0, ROWS, 10.0)
    return np.stack([np.full(len(rows), 40.0), rows], 1), np.tile([towards, 0.0], (len(rows), 1))


def learnt(patch: ImagePatch, frames: int = 40, towards: float = 1.0, told_px: float = SMEAR_PX) -> LightEncoding:
    encoding, (points, normals) = LightEncoding(EncodingConfig()), edges(towards)
    for _ in range(frames):
        encoding.learn(patch, points, normals, np.full(len(points), told_px))
    return encoding


@pytest.mark.parametrize("towards", [1.0, -1.0])
@pytest.mark.parametrize("exponent", [1.0, 1.4, 1.8, 2.2])
def test_it_finds_the_exponent_whichever_side_is_bright(exponent: float, towards: float) -> None:
    assert learnt(smeared(exponent), towards=towards).told == pytest.approx(exponent, abs=0.15)


def test_light_that_is_stored_as_it_is_is_believed() -> None:
    assert learnt(smeared(1.0)).gamma == pytest.approx(1.0, abs=0.11)
    assert learnt(smeared(1.0, noise=4.0)).gamma == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("exponent", [1.5, 1.8, 2.2])
def test_cameras_that_encode_for_displays_stay_what_the_search_takes_them_for(exponent: float) -> None:
    assert learnt(smeared(exponent)).gamma is None


def test_a_few_frames_in_which_something_else_bends_the_smears_do_not_matter() -> None:
    encoding, (points, normals) = learnt(smeared(2.0)), edges()
    for _ in range(10):
        encoding.learn(smeared(0.7), points, normals, np.full(len(points), SMEAR_PX))
    assert encoding.told == pytest.approx(2.0, abs=0.2)
    assert encoding.gamma is None


def test_few_edges_are_not_believed() -> None:
    encoding = learnt(smeared(1.0), frames=5)
    assert encoding.told is None
    assert encoding.gamma is None


def test_edges_that_stand_still_say_nothing() -> None:
    assert learnt(smeared(1.0, 0.5), told_px=0.5).told is None


def test_smears_that_are_hardly_longer_than_the_lens_blurs_say_nothing() -> None:
    (points, normals), told = edges(), []
    for lens_px in (2.0, 4.0):
        encoding = LightEncoding(EncodingConfig())
        for _ in range(40):
            encoding.learn(smeared(1.0), points, normals, np.full(len(points), SMEAR_PX), lens_px)
        told.append(encoding.told)
    assert told[0] is not None
    assert told[1] is None


def test_an_edge_that_is_wider_or_narrower_than_its_smear_is_another_one() -> None:
    assert learnt(smeared(1.0, 2.0), told_px=12.0).told is None
    assert learnt(smeared(1.0, 14.0), told_px=4.0).told is None


def test_what_is_cut_off_says_nothing() -> None:
    patch = smeared(1.0)
    patch.channels[..., 2] = np.minimum(3.0 * patch.channels[..., 2], 255.0)
    bright = patch.channels[5::10, -1, 2] > 245.0
    points, normals = edges()
    assert bright.sum() > 3
    bent = np.zeros(len(_EXPONENTS))
    seen = _add_up_bends(
        patch.channels, points[bright], normals[bright], np.full(bright.sum(), SMEAR_PX), _EXPONENTS, bent
    )
    assert seen == 0
    assert not bent.any()


def test_one_camera_after_another_is_told_apart() -> None:
    encoding, (points, normals) = learnt(smeared(1.0)), edges()
    assert encoding.gamma is not None
    patch = smeared(2.2)
    for _ in range(100):
        encoding.learn(patch, points, normals, np.full(len(points), SMEAR_PX))
    assert encoding.gamma is None


def test_the_kernel_is_its_numpy_twin() -> None:
    patch, (points, normals) = smeared(1.4, noise=2.0), edges()
    rng = np.random.default_rng(1)
    points = points + rng.uniform(-0.5, 0.5, points.shape)
    smear_px = rng.uniform(6.5, 8.0, len(points))
    bent = np.zeros(len(_EXPONENTS))
    seen = _add_up_bends(patch.channels, points, normals, smear_px, _EXPONENTS, bent)
    rows = [row for i in range(len(points)) if (row := bends(patch, points[i], smear_px[i])) is not None]
    assert seen == len(rows) > 6
    np.testing.assert_allclose(bent, np.sum(rows, axis=0), rtol=1e-2, atol=5e-3)


def bends(patch: ImagePatch, point: FloatArray, smear_px: float) -> FloatArray | None:
    """(k,) of one edge whose normal leads along the row."""
    reach = int(0.5 * smear_px + 1.0) + 3
    x = point[0] + np.arange(-reach, reach + 1.0)
    row = int(point[1])
    upper, lower = (np.interp(x, np.arange(81.0), patch.channels[row + k, :, 2]) for k in range(2))
    greys = upper + (point[1] - row) * (lower - upper)
    greys = greys if greys[-1] > greys[0] else greys[::-1]
    rise = greys[-1] - greys[0]
    still = max(abs(greys[1] - greys[0]), abs(greys[-1] - greys[-2]))
    if rise < 25.0 or greys[0] < 6.0 or greys[-1] > 245.0 or still > 0.1 * rise or np.diff(greys).min() < -0.06 * rise:
        return None
    wide = (greys - greys[0] < 0.75 * rise).sum() - (greys - greys[0] < 0.25 * rise).sum()
    if not 0.35 * smear_px - 1.0 <= wide <= 0.75 * smear_px + 1.0:
        return None
    found = []
    for exponent in _EXPONENTS:
        light = np.maximum.accumulate(greys**exponent)
        share = (light - light[0]) / (light[-1] - light[0])
        first, half, three = np.interp([0.25, 0.5, 0.75], share + 1e-12 * np.arange(len(share)), np.arange(len(share)))
        found.append((three + first - 2.0 * half) / (three - first))
    return min(np.log(greys[-1] / greys[0]), 1.5) * np.array(found)


@pytest.mark.parametrize(
    ("config", "words"),
    [
        ({"least_px": 0.5}, "least_px = 0.5"), ({"times_lens": -1.0}, "times_lens = -1"),
        ({"evidence": 0.0}, "evidence = 0"), ({"frames": 0}, "frames = 0"), ({"below": 0.9}, "below = 0.9"),
    ],
)  # fmt: skip
def test_settings_that_make_no_sense_are_refused(config: dict[str, float], words: str) -> None:
    with pytest.raises(TrackingError, match=f"learning.encoding.{words}"):
        EncodingConfig(**config)
