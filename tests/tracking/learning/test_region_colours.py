"""Colours of part and background: what known histograms say of a pixel."""

from __future__ import annotations

import numpy as np
import pytest

from acp_lab.errors import TrackingError
from acp_lab.geometry.arrays import IntArray
from acp_lab.tracking.learning.region_colours import ColourConfig, RegionColours

RED, GREEN, BLUE, GREY = (
    int(bin)
    for bin in RegionColours.bins(np.array([[[200, 10, 10], [10, 200, 10], [10, 10, 200], [90, 90, 90]]], np.uint8))[0]
)
# Nothing is added to the shares, and hardly anything is cut off.
EXACT = ColourConfig(rate=0.25, least_share=1e-12, certainty=1.0 - 1e-9)


def pixels(*counts: tuple[int, int]) -> IntArray:
    """Bins, each so many times."""
    return np.concatenate([np.full(count, colour) for colour, count in counts])


def test_a_bin_is_eight_levels_of_each_channel() -> None:
    image = np.array([[[0, 0, 0], [7, 7, 7], [8, 0, 0]], [[0, 8, 0], [0, 0, 8], [255, 255, 255]]], np.uint8)
    np.testing.assert_array_equal(RegionColours.bins(image), [[0, 0, 1024], [32, 1, 32**3 - 1]])


def test_log_odds_are_those_of_the_shares() -> None:
    colours = RegionColours(EXACT)
    assert not colours.is_known
    # Of different numbers of pixels: a share of its own region is what counts.
    colours.learn(pixels((RED, 60), (GREY, 20)), pixels((BLUE, 5), (GREY, 15)))
    assert colours.is_known
    assert colours.log_odds[GREY] == pytest.approx(np.log(0.25 / 0.75), rel=1e-5)
    assert colours.log_odds[RED] > 15.0
    assert colours.log_odds[BLUE] < -15.0


def test_probabilities_are_those_of_the_log_odds(rng: np.random.Generator) -> None:
    colours = RegionColours(ColourConfig())
    np.testing.assert_array_equal(colours.probability, 0.5)
    for _ in range(3):
        colours.learn(rng.integers(0, 60, 400), rng.integers(40, 100, 400))
        np.testing.assert_allclose(colours.probability, 1.0 / (1.0 + np.exp(-colours.log_odds.astype(np.float64))))
    assert len(np.unique(colours.probability)) > 5


def test_a_colour_never_seen_says_nothing_and_a_rare_one_little() -> None:
    colours = RegionColours(ColourConfig(least_share=0.01))
    colours.learn(pixels((RED, 999), (GREEN, 1)), pixels((BLUE, 1000)))
    assert colours.log_odds[GREY] == 0.0
    assert colours.log_odds[GREEN] == pytest.approx(np.log(0.011 / 0.010), rel=1e-4)


def test_no_colour_is_surer_than_the_certainty() -> None:
    colours = RegionColours(ColourConfig(certainty=0.9))
    colours.learn(pixels((RED, 10)), pixels((BLUE, 10)))
    assert colours.log_odds[RED] == pytest.approx(np.log(9.0), rel=1e-5)
    assert colours.log_odds[BLUE] == pytest.approx(-np.log(9.0), rel=1e-5)


def test_histograms_are_running_means() -> None:
    colours = RegionColours(EXACT)
    colours.learn(pixels((RED, 10)), pixels((BLUE, 10)))
    colours.learn(pixels((GREY, 10)), pixels((BLUE, 8), (RED, 32)))
    # A quarter of the new frame: red is 0.75 of the part and 0.25 * 0.8 of the background.
    assert colours.log_odds[RED] == pytest.approx(np.log(0.75 / 0.2), rel=1e-5)
    colours.learn(pixels((GREY, 10)), pixels((RED, 10)))
    assert colours.log_odds[RED] == pytest.approx(np.log(0.5625 / 0.4), rel=1e-5)


def test_one_side_alone_teaches_nothing() -> None:
    colours = RegionColours(EXACT)
    none = np.zeros(0, np.int64)
    colours.learn(pixels((RED, 10)), none)
    colours.learn(none, pixels((RED, 10)))
    assert not colours.is_known
    assert not colours.log_odds.any()


@pytest.mark.parametrize(
    ("setting", "value"), [("rate", 0.0), ("rate", 1.5), ("reach_px", 1), ("least_share", 0.0), ("certainty", 0.5)]
)
def test_settings_that_teach_nothing_are_refused(setting: str, value: float) -> None:
    with pytest.raises(TrackingError, match=f"colours.{setting} = "):
        ColourConfig(**{setting: value})


def test_shares_and_odds_are_those_of_whole_histograms(rng: np.random.Generator) -> None:
    colours, shares = RegionColours(ColourConfig(rate=0.3)), np.zeros((2, 32768))
    for frame in range(12):
        # Colours that come, and others that go until they are forgotten.
        sides = [rng.integers(40 * frame, 40 * frame + 150 + 300 * side, 200 + side) for side in (0, 1)]
        colours.learn(*sides)
        for share, bins in zip(shares, sides, strict=True):
            share *= 0.7 if frame else 0.0
            share += (0.3 if frame else 1.0) * np.bincount(bins, minlength=32768) / len(bins)
        odds = np.log((shares[0] + 2e-5) / (shares[1] + 2e-5))
        np.testing.assert_allclose(colours.log_odds, odds.clip(-np.log(97 / 3), np.log(97 / 3)), atol=1e-4)
