"""Coarse to fine: levels in px, and in shares of the part's diameter in the image."""

from __future__ import annotations

import pytest

from acp_lab.errors import TrackingError
from acp_lab.tracking.schedule import Level, PixelSchedule, ShareSchedule, scaled

LEVELS = (Level(20, 6.0, 250), Level(8, 2.0, 400))


def test_levels_are_as_they_are_on_a_part_of_full_size() -> None:
    assert PixelSchedule(LEVELS).at(150.0) == PixelSchedule(LEVELS).at(4000.0) == LEVELS


def test_levels_are_shorter_on_a_small_part_but_never_too_fine() -> None:
    assert PixelSchedule(LEVELS).at(112.5) == (Level(15, 4.5, 250), Level(6, 1.5, 400))
    # Down to half, and not below 5 px of search or 1 px of capture.
    assert scaled((*LEVELS, Level(6, 1.2)), 1.0) == (Level(10, 3.0, 250), Level(5, 1.0, 400), Level(5, 1.0))


def test_alpha_is_a_share_of_the_diameter_in_the_image() -> None:
    """The paper: 5 to 10% of the projected diameter; the capture range sigma is half of it."""
    for size_px in (100.0, 400.0):
        levels = ShareSchedule(alpha=0.08, shares=(1.0, 0.5), samples=123).at(size_px)
        assert [level.alpha_px for level in levels] == pytest.approx([0.08 * size_px, 0.04 * size_px])
        assert [level.sigma_px for level in levels] == pytest.approx([0.04 * size_px, 0.02 * size_px])
        assert [level.samples for level in levels] == [123, 123]


def test_annealing_stops_where_the_pixels_of_the_edge_map_would_show() -> None:
    assert [level.alpha_px for level in ShareSchedule(0.05, (1.0, 0.4)).at(40.0)] == [2.0, 1.5]


@pytest.mark.parametrize(("alpha_px", "reach_px"), [(2.0, 5), (6.0, 10), (30.0, 20)])
def test_a_search_beside_a_distance_map_reaches_somewhat_beyond_alpha(alpha_px: float, reach_px: int) -> None:
    (level,) = ShareSchedule(alpha_px / 200.0, (1.0,)).at(200.0)
    assert level.reach_px == reach_px


@pytest.mark.parametrize(
    ("made", "words"),
    [
        (lambda: PixelSchedule(()), "schedule.levels: is empty"),
        (lambda: PixelSchedule((Level(0, 1.0),)), "give reach, sigma and samples above 0"),
        (lambda: PixelSchedule((Level(5, 0.0),)), "give reach, sigma and samples above 0"),
        (lambda: PixelSchedule((Level(5, float("nan")),)), "give reach, sigma and samples above 0"),
        (lambda: PixelSchedule((Level(5, 1.0, 0),)), "give reach, sigma and samples above 0"),
        (lambda: ShareSchedule(alpha=0.0), "schedule.alpha = 0: give a share of the diameter"),
        (lambda: ShareSchedule(alpha=1.5), "schedule.alpha = 1.5"),
        (lambda: ShareSchedule(alpha=float("nan")), "schedule.alpha = nan"),
        (lambda: ShareSchedule(shares=()), "schedule.shares: give one or more above 0"),
        (lambda: ShareSchedule(shares=(1.0, 0.0)), "schedule.shares: give one or more above 0"),
        (lambda: ShareSchedule(samples=19), "schedule.samples = 19: give 20 or more"),
    ],
)
def test_what_makes_no_schedule_is_named(made, words: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(TrackingError) as caught:
        made()
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
