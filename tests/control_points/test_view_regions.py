"""View regions: six pyramids that share out the sphere, with hysteresis, sampled evenly."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from acp_lab.control_points.view_regions import (
    ALL_REGIONS,
    HYSTERESIS,
    REGION_NAMES,
    ViewRegion,
    choose_region,
    region_scores,
    sample_directions,
    sphere_directions,
)
from acp_lab.geometry.arrays import FloatArray
from tests.geometry.geometry_strategies import directions

HALF = np.array([20.0, 15.0, 10.0])


def in_pyramid(direction: FloatArray, half_size: FloatArray, region: ViewRegion) -> bool:
    """Whether a direction is a sum, with no negative share, of three corners of the region's face."""
    first, second = (region.axis + 1) % 3, (region.axis + 2) % 3
    corners = np.zeros((4, 3))
    corners[:, region.axis] = region.sign
    corners[:, first] = [-1, 1, 1, -1]
    corners[:, second] = [-1, -1, 1, 1]
    corners *= half_size
    triangles = (corners[[0, 1, 2]], corners[[0, 2, 3]])
    return any((np.linalg.solve(triangle.T, direction) >= 0.0).all() for triangle in triangles)


def angle_between(first: FloatArray, second: FloatArray) -> FloatArray:
    """(n, m) rad between unit vectors (n, 3) and (m, 3)."""
    return np.arccos(np.clip(first @ second.T, -1.0, 1.0))


def test_numbers_axes_and_names_of_the_regions() -> None:
    assert [region.name for region in ALL_REGIONS] == ["+x", "-x", "+y", "-y", "+z", "-z"] == list(REGION_NAMES)
    for region in ALL_REGIONS:
        assert choose_region(region.sign * np.eye(3)[region.axis], HALF) == region.index
        assert region.up_obj[region.axis] == 0.0
        assert np.linalg.norm(region.up_obj) == 1.0


@pytest.mark.parametrize("half_size", [(20.0, 15.0, 10.0), (1.0, 1.0, 1.0), (50.0, 30.0, 1.0)], ids=str)
def test_the_pyramids_of_the_box_share_out_the_sphere(half_size: tuple[float, float, float]) -> None:
    # A plate counts as at least a quarter as thick as it is wide.
    half = np.maximum(half_size, 0.25 * max(half_size))
    for direction in np.random.default_rng(3).standard_normal((200, 3)):
        of = [region.index for region in ALL_REGIONS if in_pyramid(direction, half, region)]
        assert of == [choose_region(direction, np.array(half_size))]


@given(direction=directions(), length=st.floats(1e-3, 1e4))
def test_only_the_direction_counts(direction: FloatArray, length: float) -> None:
    scores = np.sort(region_scores(direction, HALF))
    assume(scores[-1] - scores[-2] > 1e-9)
    assert choose_region(direction, HALF) == choose_region(length * direction, HALF)


def test_scores_of_many_directions_at_once() -> None:
    many = np.random.default_rng(4).standard_normal((5, 7, 3))
    scores = region_scores(many, HALF)
    assert scores.shape == (5, 7, 6)
    np.testing.assert_allclose(scores[2, 3], region_scores(many[2, 3], HALF))


@given(direction=directions(), current=st.integers(0, 5))
def test_the_current_region_is_kept_until_another_leads_clearly(direction: FloatArray, current: int) -> None:
    scores = region_scores(direction, HALF)
    chosen = choose_region(direction, HALF, current)
    best = int(scores.argmax())
    assert chosen in (current, best)
    assert (chosen == current) == (best == current or scores[best] < HYSTERESIS * scores[current])


@given(direction=directions(), current=st.none() | st.integers(0, 5), among=st.sets(st.integers(0, 5), min_size=1))
def test_the_choice_is_that_of_the_scores(direction: FloatArray, current: int | None, among: set[int]) -> None:
    scores = np.full(6, -np.inf)
    scores[list(among)] = region_scores(direction, HALF)[list(among)]
    best = int(np.argmax(scores))
    kept = current is not None and scores[best] < HYSTERESIS * scores[current]
    assert choose_region(direction, HALF, current, among=tuple(among)) == (current if kept else best)


def test_a_view_that_hovers_at_a_border_does_not_swap_regions() -> None:
    half = np.ones(3)
    border = [np.array([1.0, 0.1, 1.0 + offset]) for offset in (0.05, -0.05, 0.05, -0.05)]
    region, chosen = 0, []
    for direction in border:
        region = choose_region(direction, half, region)
        chosen.append(region)
    assert chosen == [0, 0, 0, 0]
    assert [choose_region(direction, half) for direction in border] == [4, 0, 4, 0]
    assert choose_region(np.array([1.0, 0.1, 1.2]), half, 0) == 4


@pytest.mark.parametrize("region", ALL_REGIONS, ids=lambda region: region.name)
def test_samples_lie_in_their_region(region: ViewRegion) -> None:
    found = sample_directions(region, HALF, 300)
    assert found.shape == (300, 3)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0)
    assert (region_scores(found, HALF).argmax(1) == region.index).all()


def test_overlap_reaches_as_far_as_the_hysteresis_and_no_further_than_asked() -> None:
    found = sample_directions(ALL_REGIONS[4], HALF, 600, overlap=0.3)
    scores = region_scores(found, HALF)
    lead = scores.max(1) / scores[:, 4]
    assert lead.max() <= 1.3 + 1e-9
    assert lead.max() > HYSTERESIS
    assert (lead == 1.0).sum() > 300


def test_samples_cover_their_region_evenly() -> None:
    half = np.ones(3)
    found = sample_directions(ALL_REGIONS[2], half, 500)
    anywhere = sphere_directions(6000)
    inside = anywhere[region_scores(anywhere, half).argmax(1) == 2]
    # 500 samples of a sixth of the sphere stand for a cap of 0.037 rad each.
    gap = angle_between(inside, found).min(1)
    assert gap.max() < 0.13
    assert gap.mean() < 0.05
    # The region's four quarters are alike and so are their shares.
    quarters = np.bincount(2 * (found[:, 0] > 0) + (found[:, 2] > 0), minlength=4)
    assert np.abs(quarters - 125).max() < 25


def test_a_thin_plate_still_gives_samples_at_its_rim() -> None:
    half = np.array([50.0, 50.0, 0.5])
    found = sample_directions(ALL_REGIONS[0], half, 40)
    assert found.shape == (40, 3)
    assert (found[:, 0] > 0.6).all()
    # Not nearer to edge-on than the widened control points stand.
    assert (np.abs(found[:, 2]) < 0.25).all()
    assert np.abs(found[:, 2]).max() > 0.15


def test_samples_are_the_same_for_the_same_seed() -> None:
    first, again, other = (sample_directions(ALL_REGIONS[1], HALF, 50, seed=seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


@pytest.mark.parametrize("count", [1, 10, 1000])
def test_the_sphere_is_covered_evenly(count: int) -> None:
    found = sphere_directions(count, turn_rad=0.7)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0)
    if count == 1000:
        apart = angle_between(found, found) + 10.0 * np.eye(count)
        assert apart.min() > 0.7 * np.sqrt(4.0 * np.pi / count)
        assert np.abs(found.mean(0)).max() < 1e-3
