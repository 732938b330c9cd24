"""The state machine: hysteresis, patience, and when to search."""

from __future__ import annotations

import re
from collections.abc import Iterable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from acp_lab.errors import TrackingError
from acp_lab.tracking.method import METHODS
from acp_lab.tracking.result import TrackState
from acp_lab.tracking.states import StateConfig, StateMachine

CONFIG = StateConfig(weak_below=0.4, tracking_above=0.5, lost_below=0.2, found_above=0.3, patience=3)
T, W, L = TrackState.TRACKING, TrackState.WEAK, TrackState.LOST


def states(qualities: Iterable[float]) -> list[TrackState]:
    machine = StateMachine(CONFIG)
    found = []
    for quality in qualities:
        machine.update(quality)
        found.append(machine.state)
    return found


def test_a_part_is_tracked_from_the_start() -> None:
    assert StateMachine(CONFIG).state is T


def test_weak_and_back_with_hysteresis() -> None:
    assert states([0.6, 0.45, 0.39, 0.45, 0.5, 0.51, 0.45]) == [T, T, W, W, W, T, T]


def test_lost_only_after_the_patience_is_spent() -> None:
    assert states([0.1, 0.1, 0.3, 0.1, 0.1, 0.1, 0.1]) == [W, W, W, W, W, L, L]


def test_found_again_with_hysteresis() -> None:
    lost = [0.1] * 3
    assert states([*lost, 0.25, 0.29, 0.35, 0.35, 0.6])[3:] == [L, L, L, W, T]
    assert states([*lost, 0.6, 0.6])[3:] == [L, T]


@pytest.mark.parametrize("values", [{"patience": 0}, {"proof": 0}])
def test_nonsense_is_refused(values: dict[str, int]) -> None:
    with pytest.raises(TrackingError, match="give 1 or more"):
        StateConfig(**values)


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({"weak_below": 0.7}, "weak_below = 0.7, tracking_above = 0.6"),
        ({"lost_below": 0.55}, "lost_below = 0.55, found_above = 0.5"),
        ({"weak_below": 0.2}, "lost_below = 0.25, weak_below = 0.2"),
        ({"lost_below": -0.1}, "lost_below = -0.1, found_above = 0.5"),
        ({"lost_below": float("nan")}, "lost_below = nan"),
    ],
)
def test_thresholds_have_their_order(values: dict[str, float], told: str) -> None:
    with pytest.raises(TrackingError, match=re.escape(told)):
        StateConfig(**values)  # type: ignore[arg-type]


def test_methods_without_a_probability_need_no_proof() -> None:
    for name, proof in (("acp-paper", 1), ("region", 1), ("slet", 1), ("direct-6dof", 1), ("acp", 2), ("acp-edges", 2)):
        assert METHODS[name].states.proof == proof


def test_one_good_frame_proves_nothing() -> None:
    lost = [0.1] * 3
    assert states([*lost, 0.9, 0.1, 0.9, 0.25, 0.9, 0.9])[3:] == [L, L, L, L, L, T]


def test_the_reason_is_told_when_the_state_changes_and_only_then() -> None:
    machine = StateMachine(CONFIG)
    assert machine.update(0.6) == ""
    assert machine.update(0.35) == "tracking -> weak: quality 0.35"
    assert machine.update(0.35) == ""
    assert [machine.update(0.0) for _ in range(3)] == ["", "", "weak -> lost: quality 0.00"]
    assert machine.update(0.9) == ""
    assert machine.update(0.8) == "lost -> tracking: quality 0.80"


@pytest.mark.parametrize(("quality", "state"), [(0.6, T), (0.45, T), (0.39, W), (0.2, W), (0.1, L), (0.0, L)])
def test_the_first_frame_says_what_was_seen(quality: float, state: TrackState) -> None:
    machine = StateMachine(CONFIG)
    note = machine.begin(quality)
    assert machine.state is state
    assert (note == "") is (state is T)


@given(qualities=st.lists(st.floats(0.0, 1.0), max_size=40))
def test_a_state_is_never_at_odds_with_its_quality(qualities: list[float]) -> None:
    before = T
    for quality, state in zip(qualities, states(qualities), strict=True):
        assert state is not T or quality >= CONFIG.weak_below
        assert state is not W or quality <= CONFIG.tracking_above
        # A lost part that looks well is lost until a second frame says so.
        assert state is not L or quality <= CONFIG.tracking_above or before is L
        before = state


def test_searches_grow_rarer_while_the_part_stays_lost() -> None:
    machine = StateMachine(CONFIG)
    searched = []
    for frame in range(1, 40):
        if machine.is_time_to_search():
            searched.append(frame)
        machine.update(0.0)
    # Lost after the third frame, so the fourth is the first lost one.
    assert searched == [3 + n for n in (1, 2, 4, 8, 16, 32)]


@pytest.mark.parametrize("quality", [0.9, 0.35])
def test_no_search_unless_lost(quality: float) -> None:
    machine = StateMachine(CONFIG)
    for _ in range(5):
        assert not machine.is_time_to_search()
        machine.update(quality)


def test_a_lost_part_that_fits_a_little_is_searched_too() -> None:
    """A wrong pose that hovers between lost and found must not keep the search away for ever."""
    machine = StateMachine(CONFIG)
    for _ in range(3):
        machine.update(0.0)
    searched = 0
    for _ in range(16):
        searched += machine.is_time_to_search()
        machine.update(0.25)
    assert machine.state is L
    assert searched >= 4


def test_a_doubted_part_is_weak_at_best() -> None:
    machine = StateMachine(CONFIG)
    machine.doubted = True
    machine.update(0.9)
    assert machine.state is W
    machine.doubted = False
    machine.update(0.9)
    assert machine.state is T


def test_a_part_that_is_elsewhere_is_lost_at_once_and_needs_its_proof_again() -> None:
    machine = StateMachine(CONFIG)
    machine.doubted = True
    assert machine.lose("it is elsewhere") == "tracking -> lost: it is elsewhere"
    assert machine.state is L
    assert not machine.doubted
    assert machine.is_time_to_search()
    for _ in range(CONFIG.proof - 1):
        machine.update(0.9)
        assert machine.state is L
    machine.update(0.9)
    assert machine.state is T


def test_a_weak_part_may_begin_to_be_tracked_only_where_it_fits() -> None:
    machine = StateMachine(CONFIG)
    assert not machine.may_begin_to_track(0.9)  # it is tracked already
    machine.update(0.35)
    assert machine.state is W
    assert not machine.may_begin_to_track(0.45)
    assert machine.may_begin_to_track(0.55)
    machine.doubted = True
    assert not machine.may_begin_to_track(0.55)
    machine.lose("")
    assert machine.may_begin_to_track(0.0)
