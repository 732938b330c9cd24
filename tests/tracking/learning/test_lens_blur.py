"""How soft a camera is, learnt from its pictures."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from acp_lab.errors import TrackingError
from acp_lab.imaging.edge_search import AS_THEY_ARE, ImagePatch, SearchConfig, image_patch
from acp_lab.tracking.learning.lens_blur import LensBlur, LensConfig


def picture(blur_px: float, config: SearchConfig = AS_THEY_ARE, side: int = 120) -> ImagePatch:
    """Dark and bright bars, 40 px wide, behind a lens."""
    x = np.arange(160) - 0.3
    off = np.abs((x + 20.0) % 80.0 - 40.0) - 20.0
    row = np.round(60.0 + 120.0 * norm.cdf(off, scale=max(blur_px, 1e-3))).astype(np.uint8)
    return image_patch(np.tile(row[None, :, None], (120, 1, 3)), (0, 0, 160, side), config)


def noise() -> ImagePatch:
    grey = np.random.default_rng(0).normal(90.0, 4.0, (120, 160, 1))
    return image_patch(np.repeat(np.round(grey).astype(np.uint8), 3, axis=2), (0, 0, 160, 120), AS_THEY_ARE)


def learnt(*patches: ImagePatch, config: LensConfig | None = None) -> float | None:
    lens = LensBlur(LensConfig() if config is None else config)
    for patch in patches:
        lens.learn(patch)
    return lens.blur_px


def test_nothing_is_known_before_the_first_picture_and_all_after_it() -> None:
    assert learnt() is None
    assert learnt(picture(1.6)) == pytest.approx(1.6, abs=0.2)


def test_how_much_pictures_are_sharpened_has_no_say_in_it() -> None:
    assert learnt(picture(1.6, SearchConfig(sharpening=4.0))) == learnt(picture(1.6))


@pytest.mark.parametrize("odd", [noise(), picture(2.4)], ids=["noise", "motion"])
def test_a_few_odd_pictures_have_no_say(odd: ImagePatch) -> None:
    usual = picture(1.6)
    assert odd.edge_blur_px != pytest.approx(1.6, abs=0.5)
    assert learnt(odd, usual, usual) == learnt(usual)
    assert learnt(usual, usual, odd, odd, usual) == learnt(usual)


def test_what_tells_nothing_has_no_say() -> None:
    tiny = picture(1.6, side=12)
    assert learnt(tiny) is None
    assert learnt(picture(1.6), tiny, tiny, tiny) == learnt(picture(1.6))


def test_a_lens_that_goes_out_of_focus_is_noticed() -> None:
    sharp, soft = picture(1.0), picture(2.0)
    assert learnt(*[sharp] * 9, *[soft] * 60) == learnt(soft)


def test_after_the_first_pictures_only_some_are_asked() -> None:
    config = LensConfig(pictures=1, every=3)
    first, second = picture(1.0), picture(2.0)
    assert learnt(first, second, config=config) == learnt(first)
    assert learnt(first, first, second, config=config) == learnt(second)
    assert learnt(first, first, second, first, first, config=config) == learnt(second)


@pytest.mark.parametrize("setting", [{"pictures": 0}, {"every": 0}, {"every": 5000}])
def test_an_impossible_lens_is_refused(setting: dict[str, int]) -> None:
    with pytest.raises(TrackingError, match=f"learning.lens.{next(iter(setting))}"):
        LensConfig(**setting)
