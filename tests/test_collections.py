"""While a video is tracked, Python's garbage collector passes over what is new only."""

from __future__ import annotations

import gc

import pytest

from acp_lab.machine import short_collections


class Node:
    """Refers to itself: only a collection frees it."""

    def __init__(self) -> None:
        self.itself = self


def test_what_was_there_is_left_alone_until_the_end() -> None:
    there = [Node() for _ in range(100)]
    assert gc.get_freeze_count() == 0
    with short_collections():
        frozen = gc.get_freeze_count()
        assert frozen > len(there)
        assert not any(one is there[0] for one in gc.get_objects())
        fresh = Node()
        assert any(one is fresh for one in gc.get_objects())
    assert gc.get_freeze_count() == 0
    assert any(one is there[0] for one in gc.get_objects())


def test_it_ends_with_an_error_too() -> None:
    with pytest.raises(ValueError, match="in a frame"), short_collections():
        raise ValueError("in a frame")
    assert gc.get_freeze_count() == 0
