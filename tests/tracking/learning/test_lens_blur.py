"""How soft a camera is, learnt from its pictures."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from acp_lab.errors import TrackingError
from acp_lab.imaging.edge_search import AS_THEY_ARE, ImagePatch, SearchConfig, image_patch
from acp_lab.tracking.learning.lens_blur import LensBlur, LensConfig


def picture(blur_px: float, config: SearchConfig = AS_THEY_ARE) -> ImagePatch:
    """Dark and bright bars, 40 px wide, behind a lens."""
    x = np.arange(160) - 0.3
    off = np.abs((x + 20.0) % 80.0 - 40.0) - 20.0
    row = np.round(60.0 + 120.0 * norm.cdf(off, scale=max(blur_px, 1e-3))).astype(np.uint8)
    return image_patch(np.tile(row[None, :, None], (120, 1, 3)), (0, 0, 160, 120), config)


def learnt(*blurs_px: float, config: LensConfig | None = None) -> float:
    lens = LensBlur(LensConfig(every=1) if config is None else config)
    for blur_px in blurs_px:
        lens.learn(picture(blur_px))
    assert lens.blur_px is not None
    return lens.blur_px


def test_nothing_is_known_before_the_first_picture_and_all_after_it() -> None:
    assert LensBlur(LensConfig()).blur_px is None
    assert learnt(1.6) == pytest.approx(1.6, abs=0.2)


def test_how_much_pictures_are_sharpened_has_no_say_in_it() -> None:
    sharp = picture(1.6, SearchConfig(sharpening=4.0))
    assert sharp.edge_blur_px == picture(1.6).edge_blur_px


def test_pictures_in_motion_hardly_make_a_camera_soft() -> None:
    still, moving = learnt(1.0), learnt(2.3)
    assert learnt(1.0, 2.3, 2.3, 1.0) == pytest.approx(still, abs=0.25 * (moving - still))


def test_a_first_picture_in_motion_is_soon_forgotten() -> None:
    assert learnt(2.3, *[1.0] * 5) == pytest.approx(learnt(1.0), abs=0.1)


def test_a_lens_that_goes_out_of_focus_is_noticed_in_time() -> None:
    assert learnt(1.0, *[2.0] * 40) == pytest.approx(learnt(2.0), abs=0.1)


def test_only_some_frames_are_asked() -> None:
    every_third = LensConfig(every=3, fall=1.0, rise=1.0)
    assert learnt(1.0, 2.0, 2.0, config=every_third) == pytest.approx(learnt(1.0))
    assert learnt(1.0, 2.0, 2.0, 1.5, config=every_third) == pytest.approx(learnt(1.5))


@pytest.mark.parametrize("setting", [{"every": 0}, {"fall": 0.0}, {"rise": 1.5}, {"rise": float("nan")}])
def test_an_impossible_lens_is_refused(setting: dict[str, float]) -> None:
    with pytest.raises(TrackingError, match=f"learning.lens.{next(iter(setting))}"):
        LensConfig(**setting)  # type: ignore[arg-type]
